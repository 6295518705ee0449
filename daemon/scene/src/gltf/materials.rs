//! glTF materials and the extensions of theirs that are read.

use gltf::json::material::{AlphaMode, Material as Json};
use gltf::json::validation::Checked;
use gltf::json::{Index, Root, texture};

use super::error::{Located, bad, item};
use super::images::Images;
use super::warnings::Warnings;
use crate::material::{Material, absorption_per_m};
use crate::pack::{GpuMaterial, NO_TEXTURE};
use crate::texture::Texture;

/// The materials of a document, and one more where a primitive has none.
pub(super) struct Materials<'a> {
    root: &'a Root,
    default_used: bool,
}

impl<'a> Materials<'a> {
    pub(super) fn new(root: &'a Root) -> Self {
        Self { root, default_used: false }
    }

    /// A primitive's material number.
    pub(super) fn number_of(&mut self, material: Option<Index<Json>>, object: &str) -> Result<u32, Located> {
        match material {
            Some(material) => {
                item(&self.root.materials, "material", material.value(), object)?;
                Ok(material.value() as u32)
            }
            None => {
                self.default_used = true;
                Ok(self.root.materials.len() as u32)
            }
        }
    }

    /// Reads them all, with the textures that they need.
    pub(super) fn load(
        self,
        images: &mut Images<'_, '_>,
        warnings: &mut Warnings,
    ) -> Result<(Vec<Material>, Vec<Texture>), Located> {
        let mut textures = Textures { images, loaded: vec![], keys: vec![] };
        let mut materials = vec![];
        for (index, json) in self.root.materials.iter().enumerate() {
            let object = format!("material {index}");
            let name = json.name.clone().filter(|name| !name.is_empty()).unwrap_or_else(|| object.clone());
            let gpu = read(json, &object, &mut textures, warnings)?;
            materials.push(Material { name, gpu });
        }
        if self.default_used {
            materials.push(Material::gltf_default("default"));
        }
        Ok((materials, textures.loaded))
    }
}

/// The textures in use; one that is read both as sRGB and as linear counts twice.
struct Textures<'i, 'a, 'b> {
    images: &'i mut Images<'a, 'b>,
    loaded: Vec<Texture>,
    keys: Vec<(usize, bool)>,
}

impl Textures<'_, '_, '_> {
    fn number(&mut self, texture: Index<texture::Texture>, srgb: bool, object: &str) -> Result<u32, Located> {
        let key = (texture.value(), srgb);
        if let Some(known) = self.keys.iter().position(|known| *known == key) {
            return Ok(known as u32);
        }
        self.loaded.push(self.images.texture(texture.value(), srgb, object)?);
        self.keys.push(key);
        Ok(self.keys.len() as u32 - 1)
    }

    /// The number behind a reference, or none where its coordinates are not read.
    fn info(
        &mut self,
        info: &Option<texture::Info>,
        srgb: bool,
        object: &str,
        warnings: &mut Warnings,
    ) -> Result<u32, Located> {
        let Some(info) = info else { return Ok(NO_TEXTURE) };
        if info.extensions.as_ref().is_some_and(|extensions| extensions.texture_transform.is_some()) {
            warnings.add(
                "texture transforms (KHR_texture_transform) are ignored; textures are not shifted, turned or scaled",
            );
        }
        self.at_set(info.index, info.tex_coord, srgb, object, warnings)
    }

    fn at_set(
        &mut self,
        texture: Index<texture::Texture>,
        set: u32,
        srgb: bool,
        object: &str,
        warnings: &mut Warnings,
    ) -> Result<u32, Located> {
        if set != 0 {
            warnings.add(format!("a texture laid by TEXCOORD_{set} is ignored; TEXCOORD_0 alone is read"));
            return Ok(NO_TEXTURE);
        }
        self.number(texture, srgb, object)
    }
}

fn read(
    json: &Json,
    object: &str,
    textures: &mut Textures<'_, '_, '_>,
    warnings: &mut Warnings,
) -> Result<GpuMaterial, Located> {
    let pbr = &json.pbr_metallic_roughness;
    let mut gpu = Material::gltf_default("").gpu;
    gpu.base_color = checked(pbr.base_color_factor.0, "baseColorFactor", object, 1.0)?;
    [gpu.metallic] = checked([pbr.metallic_factor.0], "metallicFactor", object, 1.0)?;
    [gpu.roughness] = checked([pbr.roughness_factor.0], "roughnessFactor", object, 1.0)?;
    gpu.emissive = checked(json.emissive_factor.0, "emissiveFactor", object, 1e6)?;
    gpu.base_color_texture = textures.info(&pbr.base_color_texture, true, object, warnings)?;
    gpu.metallic_roughness_texture = textures.info(&pbr.metallic_roughness_texture, false, object, warnings)?;
    gpu.emissive_texture = textures.info(&json.emissive_texture, true, object, warnings)?;
    if let Some(normal) = &json.normal_texture {
        if !normal.scale.is_finite() {
            return Err(bad(object, "has a normal scale that is not finite"));
        }
        gpu.normal_scale = normal.scale;
        gpu.normal_texture = textures.at_set(normal.index, normal.tex_coord, false, object, warnings)?;
    }

    match json.alpha_mode {
        Checked::Invalid => return Err(bad(object, "has an alpha mode that glTF does not know")),
        Checked::Valid(AlphaMode::Opaque) => {}
        Checked::Valid(_) => warnings.add("alpha modes MASK and BLEND are ignored; such surfaces show opaque"),
    }
    if json.occlusion_texture.is_some() {
        warnings.add("occlusion textures are ignored; occlusion is traced");
    }
    read_extensions(json, object, &mut gpu, warnings)?;
    Ok(gpu)
}

fn read_extensions(json: &Json, object: &str, gpu: &mut GpuMaterial, warnings: &mut Warnings) -> Result<(), Located> {
    let Some(extensions) = &json.extensions else { return Ok(()) };
    let mut ignored = |present: bool, what: &str| {
        if present {
            warnings.add(format!("{what} are ignored; their factors are read"));
        }
    };
    if let Some(strength) = &extensions.emissive_strength {
        let [strength] = checked([strength.emissive_strength.0], "emissiveStrength", object, 1e6)?;
        gpu.emissive = gpu.emissive.map(|c| c * strength);
    }
    if let Some(transmission) = &extensions.transmission {
        [gpu.transmission] = checked([transmission.transmission_factor.0], "transmissionFactor", object, 1.0)?;
        ignored(transmission.transmission_texture.is_some(), "transmission textures");
    }
    if let Some(volume) = &extensions.volume {
        [gpu.thickness] = checked([volume.thickness_factor.0], "thicknessFactor", object, 1e6)?;
        let color = checked(volume.attenuation_color.0, "attenuationColor", object, 1.0)?;
        let distance_m = volume.attenuation_distance.0;
        if distance_m.is_nan() || distance_m <= 0.0 {
            return Err(bad(object, format!("has an attenuationDistance of {distance_m}; it is above 0")));
        }
        gpu.absorption_per_m = absorption_per_m(color, distance_m.max(1e-6));
        ignored(volume.thickness_texture.is_some(), "thickness textures");
    }
    if let Some(ior) = &extensions.ior {
        let ior = ior.ior.0;
        if !(1.0..=10.0).contains(&ior) {
            return Err(bad(object, format!("has an ior of {ior}; Lantern reads 1 to 10")));
        }
        gpu.ior = ior;
    }
    if let Some(specular) = &extensions.specular {
        [gpu.specular] = checked([specular.specular_factor.0], "specularFactor", object, 1.0)?;
        let coloured = specular.specular_color_factor.0 != [1.0; 3] || specular.specular_color_texture.is_some();
        ignored(coloured, "specular colours");
        ignored(specular.specular_texture.is_some(), "specular textures");
    }
    if let Some(clearcoat) = extensions.others.get("KHR_materials_clearcoat") {
        let factor = |name: &str| match clearcoat.get(name) {
            None => Ok(0.0),
            Some(value) => {
                let value = value.as_f64().ok_or_else(|| bad(object, format!("has a {name} that is no number")))?;
                checked([value as f32], name, object, 1.0).map(|[value]| value)
            }
        };
        gpu.clearcoat = factor("clearcoatFactor")?;
        gpu.clearcoat_roughness = factor("clearcoatRoughnessFactor")?;
        let textures = ["clearcoatTexture", "clearcoatRoughnessTexture", "clearcoatNormalTexture"];
        ignored(textures.iter().any(|name| clearcoat.get(name).is_some()), "clear coat textures");
    }
    if extensions.unlit.is_some() {
        warnings.add("unlit materials are lit like any other");
    }
    Ok(())
}

/// Values within 0 to `most`. A hair outside, as exporters round, is brought back in.
fn checked<const N: usize>(values: [f32; N], name: &str, object: &str, most: f32) -> Result<[f32; N], Located> {
    if !values.iter().all(|&value| (-1e-3..=most * 1.001).contains(&value)) {
        return Err(bad(object, format!("has a {name} of {values:?}; it lies between 0 and {most}")));
    }
    Ok(values.map(|value| value.clamp(0.0, most)))
}
