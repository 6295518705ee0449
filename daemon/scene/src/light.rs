//! Lights by name: made by edits, or imported with a file and then following its node.

use glam::{DAffine3, DVec3};
use lantern_proto as proto;
use lantern_proto::LightKind;

use crate::asset::AssetLight;
use crate::edit::{Fault, MAX_DISTANCE_M, bad_value};
use crate::pack::{GpuLight, LIGHT_DIRECTIONAL, LIGHT_POINT, LIGHT_SPOT};

/// What edits have said of a light; what they have not is the file's, or the default.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct LightState {
    /// An imported light that was taken away; one of our own is forgotten instead.
    pub(crate) removed: bool,
    pub(crate) said: Said,
}

/// The fields of a `light` edit, checked.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Said {
    kind: Option<LightKind>,
    position_m: Option<DVec3>,
    direction: Option<DVec3>,
    color: Option<[f64; 3]>,
    intensity: Option<f64>,
    inner_cone_rad: Option<f64>,
    outer_cone_rad: Option<f64>,
}

impl LightState {
    /// Takes in an edit; `exists` says whether the light is there without it.
    ///
    /// # Errors
    /// `bad-value` where a number cannot be, or a new light has no kind.
    pub(crate) fn apply(&mut self, edit: &proto::Light, exists: bool) -> Result<(), Fault> {
        if edit.remove == Some(true) {
            *self = Self { removed: true, said: Said::default() };
            return Ok(());
        }
        if edit.kind.is_none() && !exists {
            return Err(bad_value(
                "kind",
                "is missing, and there is no such light yet",
                "\"directional\", \"point\" or \"spot\"",
            ));
        }
        self.removed = false;
        let said = &mut self.said;
        said.kind = edit.kind.or(said.kind);
        if let Some(position_m) = edit.position_m {
            if !position_m.iter().all(|x| x.abs() <= MAX_DISTANCE_M) {
                return Err(bad_value(
                    "position_m",
                    format_args!("{position_m:?} is not a place within 1e8 m"),
                    "three finite numbers, metres",
                ));
            }
            said.position_m = Some(position_m.into());
        }
        if let Some(direction) = edit.direction {
            let length = DVec3::from(direction).length();
            if !(1e-9..=1e9).contains(&length) {
                return Err(bad_value(
                    "direction",
                    format_args!("{direction:?} points nowhere"),
                    "the way the light travels, any length but 0",
                ));
            }
            said.direction = Some(direction.into());
        }
        if let Some(proto::Color(color)) = edit.color {
            if !color.iter().all(|c| (0.0..=1e6).contains(c)) {
                return Err(bad_value("color", format_args!("{color:?} leaves 0 to 1e6"), "linear RGB, 0 or more"));
            }
            said.color = Some(color);
        }
        if let Some(intensity) = edit.intensity {
            if !(0.0..=1e9).contains(&intensity) {
                return Err(bad_value(
                    "intensity",
                    format_args!("{intensity} leaves 0 to 1e9"),
                    "lux for a directional light, else candela",
                ));
            }
            said.intensity = Some(intensity);
        }
        for (field, value, into) in [
            ("inner_cone_rad", edit.inner_cone_rad, &mut said.inner_cone_rad),
            ("outer_cone_rad", edit.outer_cone_rad, &mut said.outer_cone_rad),
        ] {
            let Some(angle) = value else { continue };
            if !(0.0..=std::f64::consts::FRAC_PI_2).contains(&angle) {
                return Err(bad_value(field, format_args!("{angle} leaves 0 to π/2"), "half the cone's opening, rad"));
            }
            *into = Some(angle);
        }
        Ok(())
    }

    /// The edit that brings a light as the file has it (or none) to this state; `None` where nothing was said.
    pub(crate) fn edit(&self, name: String) -> Option<proto::Light> {
        if self.removed {
            return Some(proto::Light { name, remove: Some(true), ..proto::Light::default() });
        }
        let said = &self.said;
        (*said != Said::default()).then(|| proto::Light {
            name,
            kind: said.kind,
            position_m: said.position_m.map(Into::into),
            direction: said.direction.map(Into::into),
            color: said.color.map(proto::Color),
            intensity: said.intensity,
            inner_cone_rad: said.inner_cone_rad,
            outer_cone_rad: said.outer_cone_rad,
            remove: None,
        })
    }

    /// The light as the GPU reads it, or `None` where it was removed. `imported` is the file's light with the placement
    /// of its node; without one, what edits did not say is: at the origin, downward, white, 1, a cone of π/4.
    pub(crate) fn resolve(&self, imported: Option<(&AssetLight, DAffine3)>, origin_m: DVec3) -> Option<GpuLight> {
        if self.removed {
            return None;
        }
        let said = &self.said;
        let world_from_light = imported.map(|(light, world_from_asset)| world_from_asset * light.asset_from_light);
        let position_m = said.position_m.or(world_from_light.map(|m| m.translation)).unwrap_or(DVec3::ZERO);
        let direction = said.direction.or(world_from_light.map(|m| m.transform_vector3(DVec3::NEG_Z)));
        let direction = direction.unwrap_or(DVec3::NEG_Y).normalize_or(DVec3::NEG_Y);
        let light = imported.map(|(light, _)| light);
        let kind = said.kind.or(light.map(|l| l.kind)).unwrap_or(LightKind::Point);
        let color = said.color.or(light.map(|l| l.color)).unwrap_or([1.0; 3]);
        let intensity = said.intensity.or(light.map(|l| l.intensity)).unwrap_or(1.0);
        let cones = light.map_or([0.0, std::f64::consts::FRAC_PI_4], |l| l.cones_rad);
        let outer = said.outer_cone_rad.unwrap_or(cones[1]);
        let inner = said.inner_cone_rad.unwrap_or(cones[0]).min(outer);
        Some(GpuLight {
            position: (position_m - origin_m).as_vec3().to_array(),
            kind: match kind {
                LightKind::Directional => LIGHT_DIRECTIONAL,
                LightKind::Point => LIGHT_POINT,
                LightKind::Spot => LIGHT_SPOT,
            },
            direction: direction.as_vec3().to_array(),
            range: light.map_or(0.0, |l| l.range_m) as f32,
            intensity: color.map(|c| (c * intensity) as f32),
            cos_outer: outer.cos() as f32,
            cos_inner: inner.cos() as f32,
            pad: [0.0; 3],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn imported() -> AssetLight {
        AssetLight {
            name: "lamp".into(),
            asset_from_light: DAffine3::from_translation(DVec3::X),
            kind: LightKind::Spot,
            color: [1.0, 0.5, 0.25],
            intensity: 100.0,
            range_m: 4.0,
            cones_rad: [0.1, 0.2],
        }
    }

    #[test]
    fn an_imported_light_follows_its_node_until_an_edit_places_it() {
        let light = imported();
        let world_from_asset = DAffine3::from_rotation_y(std::f64::consts::FRAC_PI_2);
        let mut state = LightState::default();
        let gpu = state.resolve(Some((&light, world_from_asset)), DVec3::ZERO).unwrap();
        // Turned a quarter about +Y, +X goes to −Z and −Z to −X.
        assert!((glam::Vec3::from(gpu.position) - glam::Vec3::NEG_Z).length() < 1e-6);
        assert!((glam::Vec3::from(gpu.direction) - glam::Vec3::NEG_X).length() < 1e-6);
        assert_eq!(gpu.intensity, [100.0, 50.0, 25.0]);

        let edit = proto::Light { position_m: Some([7.0, 0.0, 0.0]), ..Default::default() };
        state.apply(&edit, true).unwrap();
        let gpu = state.resolve(Some((&light, world_from_asset)), DVec3::new(5.0, 0.0, 0.0)).unwrap();
        assert_eq!(gpu.position, [2.0, 0.0, 0.0]);
        assert_eq!(gpu.kind, LIGHT_SPOT);
    }

    #[test]
    fn a_new_light_needs_a_kind_and_numbers_that_can_be() {
        let mut state = LightState::default();
        let fault = state.apply(&proto::Light::default(), false).unwrap_err();
        assert_eq!((fault.code, fault.field), ("bad-value", "kind"));
        let point = proto::Light { kind: Some(LightKind::Point), ..Default::default() };
        for (edit, field) in [
            (proto::Light { intensity: Some(-1.0), ..point.clone() }, "intensity"),
            (proto::Light { direction: Some([0.0; 3]), ..point.clone() }, "direction"),
            (proto::Light { position_m: Some([f64::NAN; 3]), ..point.clone() }, "position_m"),
            (proto::Light { outer_cone_rad: Some(2.0), ..point.clone() }, "outer_cone_rad"),
        ] {
            assert_eq!(LightState::default().apply(&edit, false).unwrap_err().field, field);
        }
    }

    #[test]
    fn the_edit_of_a_state_rebuilds_it() {
        let mut state = LightState::default();
        let edit =
            proto::Light { color: Some(proto::Color([0.1, 0.2, 0.3])), intensity: Some(3.0), ..Default::default() };
        state.apply(&edit, true).unwrap();
        let mut rebuilt = LightState::default();
        rebuilt.apply(&state.edit("x".into()).unwrap(), true).unwrap();
        assert_eq!(rebuilt, state);
        assert_eq!(LightState::default().edit("x".into()), None);
    }
}
