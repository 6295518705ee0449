//! Materials by name, and what an edit may change of them.

use lantern_proto as proto;

use crate::edit::{Fault, bad_value};
use crate::pack::{GpuMaterial, NO_TEXTURE};

/// A named glTF material.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// As the file or builtin calls it; `material N` where the file does not.
    pub name: String,
    /// Its values. Texture numbers are the scene's in a [`crate::Scene`], its file's own before.
    pub gpu: GpuMaterial,
}

impl Material {
    /// What glTF 2.0 (section 3.9) says of a material that says nothing: a white, fully rough metal.
    pub fn gltf_default(name: impl Into<String>) -> Self {
        let gpu = GpuMaterial {
            base_color: [1.0; 4],
            emissive: [0.0; 3],
            metallic: 1.0,
            absorption_per_m: [0.0; 3],
            roughness: 1.0,
            transmission: 0.0,
            thickness: 0.0,
            ior: 1.5,
            clearcoat: 0.0,
            clearcoat_roughness: 0.0,
            normal_scale: 1.0,
            specular: 1.0,
            base_color_texture: NO_TEXTURE,
            metallic_roughness_texture: NO_TEXTURE,
            emissive_texture: NO_TEXTURE,
            normal_texture: NO_TEXTURE,
            pad0: 0,
            pad1: [0; 4],
        };
        Self { name: name.into(), gpu }
    }

    /// A matte surface of a linear colour.
    pub fn matte(name: impl Into<String>, base_color: [f32; 3]) -> Self {
        let mut material = Self::gltf_default(name);
        let [r, g, b] = base_color;
        material.gpu.base_color = [r, g, b, 1.0];
        material.gpu.metallic = 0.0;
        material
    }

    /// True where no light passes through.
    pub fn is_opaque(&self) -> bool {
        self.gpu.transmission <= 0.0
    }
}

/// Absorption per metre inside a body whose light turns to `color` after `distance_m` (KHR_materials_volume):
/// −ln(color) / distance. A channel that is black counts as 10⁻⁶.
pub fn absorption_per_m(color: [f32; 3], distance_m: f32) -> [f32; 3] {
    // Nothing is absorbed over an infinite distance, and −ln 1 would leave a −0.
    color.map(|c| if distance_m.is_finite() { (-c.clamp(1e-6, 1.0).ln() / distance_m).max(0.0) } else { 0.0 })
}

/// Applies an edit to the values of one material.
///
/// # Errors
/// `bad-value` where a number is out of its range, naming the field.
pub(crate) fn apply(edit: &proto::Material, gpu: &mut GpuMaterial) -> Result<(), Fault> {
    if let Some(proto::ColorAlpha(color)) = edit.base_color {
        if !color.iter().all(|c| (0.0..=1.0).contains(c)) {
            return Err(bad_value(
                "base_color",
                format_args!("{color:?} leaves 0 to 1"),
                "linear RGB and alpha, each 0 to 1",
            ));
        }
        gpu.base_color = color.map(|c| c as f32);
    }
    if let Some(proto::Color(color)) = edit.emissive {
        if !color.iter().all(|c| (0.0..=1e6).contains(c)) {
            return Err(bad_value("emissive", format_args!("{color:?} leaves 0 to 1e6"), "linear RGB, 0 or more"));
        }
        gpu.emissive = color.map(|c| c as f32);
    }

    let unit = |field, value: Option<f64>, into: &mut f32| ranged(field, value, 0.0, 1.0, into);
    unit("metallic", edit.metallic, &mut gpu.metallic)?;
    unit("roughness", edit.roughness, &mut gpu.roughness)?;
    unit("transmission", edit.transmission, &mut gpu.transmission)?;
    unit("clearcoat", edit.clearcoat, &mut gpu.clearcoat)?;
    unit("clearcoat_roughness", edit.clearcoat_roughness, &mut gpu.clearcoat_roughness)?;
    ranged("thickness", edit.thickness, 0.0, 1e6, &mut gpu.thickness)?;
    ranged("ior", edit.ior, 1.0, 10.0, &mut gpu.ior)
}

fn ranged(field: &'static str, value: Option<f64>, min: f64, max: f64, into: &mut f32) -> Result<(), Fault> {
    let Some(value) = value else { return Ok(()) };
    if !(min..=max).contains(&value) {
        return Err(bad_value(
            field,
            format_args!("{value} leaves {min} to {max}"),
            "see the glTF material of that name",
        ));
    }
    *into = value as f32;
    Ok(())
}

/// The edit that turns `from` into `to`, under `name`; `None` where they agree.
pub(crate) fn difference(name: String, from: &GpuMaterial, to: &GpuMaterial) -> Option<proto::Material> {
    let scalar = |from: f32, to: f32| (from != to).then_some(f64::from(to));
    let edit = proto::Material {
        base_color: (from.base_color != to.base_color).then(|| proto::ColorAlpha(to.base_color.map(f64::from))),
        metallic: scalar(from.metallic, to.metallic),
        roughness: scalar(from.roughness, to.roughness),
        emissive: (from.emissive != to.emissive).then(|| proto::Color(to.emissive.map(f64::from))),
        transmission: scalar(from.transmission, to.transmission),
        thickness: scalar(from.thickness, to.thickness),
        ior: scalar(from.ior, to.ior),
        clearcoat: scalar(from.clearcoat, to.clearcoat),
        clearcoat_roughness: scalar(from.clearcoat_roughness, to.clearcoat_roughness),
        name: String::new(),
    };
    (edit != proto::Material::default()).then_some(proto::Material { name, ..edit })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absorption_turns_white_into_the_attenuation_colour_at_its_distance() {
        let absorption = absorption_per_m([0.5, 1.0, 0.25], 0.1);
        for (a, expected) in absorption.iter().zip([0.5f32, 1.0, 0.25]) {
            assert!(((-a * 0.1).exp() - expected).abs() < 1e-6);
        }
        assert_eq!(absorption_per_m([0.0, 0.5, 1.0], f32::INFINITY), [0.0; 3]);
        assert!(absorption_per_m([0.0; 3], 1.0)[0].is_finite());
    }

    #[test]
    fn a_difference_applied_gives_the_other_material() {
        let from = Material::gltf_default("a").gpu;
        let mut to = from;
        to.roughness = 0.1;
        to.base_color = [0.1, 0.2, 0.3, 1.0];
        to.ior = 1.33;
        let edit = difference("a".into(), &from, &to).unwrap();
        assert_eq!(edit.metallic, None);
        let mut rebuilt = from;
        apply(&edit, &mut rebuilt).unwrap();
        assert_eq!(rebuilt, to);
        assert_eq!(difference("a".into(), &from, &from), None);
    }

    #[test]
    fn values_out_of_range_are_refused_by_field() {
        let mut gpu = Material::gltf_default("a").gpu;
        let before = gpu;
        let edits = [
            (proto::Material { roughness: Some(1.5), ..Default::default() }, "roughness"),
            (proto::Material { ior: Some(0.5), ..Default::default() }, "ior"),
            (proto::Material { thickness: Some(f64::NAN), ..Default::default() }, "thickness"),
            (
                proto::Material { base_color: Some(proto::ColorAlpha([2.0, 0.0, 0.0, 1.0])), ..Default::default() },
                "base_color",
            ),
        ];
        for (edit, field) in edits {
            let fault = apply(&edit, &mut gpu).unwrap_err();
            assert_eq!((fault.code, fault.field), ("bad-value", field));
        }
        assert_eq!(gpu, before);
    }
}
