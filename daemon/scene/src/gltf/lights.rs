//! KHR_lights_punctual.

use gltf::json::Root;
use gltf::json::extensions::scene::khr_lights_punctual::{Light, Type};
use gltf::json::validation::Checked;
use lantern_proto::LightKind;

use super::error::{Located, Problem, bad, here, item};
use super::nodes::Visit;
use crate::asset::AssetLight;
use crate::limits::Limits;

/// The lights of all shown nodes, in their order, under names that differ.
pub(super) fn place(root: &Root, visits: &[Visit], limits: &Limits) -> Result<Vec<AssetLight>, Located> {
    let lights: &[Light] = root.as_ref();
    let mut placed: Vec<AssetLight> = vec![];
    for visit in visits {
        let node = &root.nodes[visit.node];
        let reference = node.extensions.as_ref().and_then(|extensions| extensions.khr_lights_punctual.as_ref());
        let Some(index) = reference.map(|reference| reference.light.value()) else { continue };
        let object = format!("node {}", visit.node);
        let light = item(lights, "light", index, &object)?;
        if placed.len() >= limits.max_lights {
            let (count, limit) = (placed.len() as u64 + 1, limits.max_lights as u64);
            let (what, key) = ("lights so far", "what limits.max_lights leaves");
            return Err(here(object, Problem::TooMany { what, count, limit, key }));
        }
        let mut light = read(light, index, visit)?;
        let own_name = light.name.clone();
        let mut count = 1;
        while placed.iter().any(|other| other.name == light.name) {
            count += 1;
            light.name = format!("{own_name} {count}");
        }
        placed.push(light);
    }
    Ok(placed)
}

fn read(light: &Light, index: usize, visit: &Visit) -> Result<AssetLight, Located> {
    let object = format!("light {index}");
    let kind = match light.type_ {
        Checked::Valid(Type::Directional) => LightKind::Directional,
        Checked::Valid(Type::Point) => LightKind::Point,
        Checked::Valid(Type::Spot) => LightKind::Spot,
        Checked::Invalid => return Err(bad(object, "is of a type that KHR_lights_punctual does not know")),
    };
    let spot = light.spot.clone().unwrap_or_default();
    // The crate's default for a missing `spot` is 0, the extension's π/4.
    let outer = if light.spot.is_none() { std::f32::consts::FRAC_PI_4 } else { spot.outer_cone_angle };
    let inner = spot.inner_cone_angle;
    let range = light.range.unwrap_or(0.0);
    let sound = |value: f32, most: f32| (0.0..=most).contains(&value);
    if !light.color.iter().all(|&c| sound(c, 1e6)) || !sound(light.intensity, 1e9) || !sound(range, 1e9) {
        return Err(bad(object, "has a color, intensity or range that is negative or not finite"));
    }
    if !sound(outer, std::f32::consts::FRAC_PI_2 + 1e-6) || !sound(inner, outer) {
        return Err(bad(object, format!("has cone angles {inner} and {outer}; they ascend from 0 to π/2")));
    }
    Ok(AssetLight {
        name: light.name.clone().filter(|name| !name.is_empty()).unwrap_or_else(|| format!("light {index}")),
        asset_from_light: visit.asset_from_node,
        kind,
        color: light.color.map(f64::from),
        intensity: light.intensity.into(),
        range_m: range.into(),
        cones_rad: [inner.into(), outer.into()],
    })
}
