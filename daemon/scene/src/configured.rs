//! The scene of a configuration as edits.

use lantern_config as config;
use lantern_proto as proto;
use lantern_proto::Edit;

use crate::limits::Limits;

/// One edit an entry, each with the name of its entry: nodes first, since materials and lights may name theirs.
pub(crate) fn edits(scene: &config::Scene) -> Vec<(String, Edit)> {
    let nodes = scene.nodes.iter().map(|node| (format!("scene.node {:?}", node.name), Edit::Add(add(node))));
    let materials = scene.materials.iter();
    let materials = materials.map(|m| (format!("scene.material {:?}", m.name), Edit::Material(material(m))));
    let lights = scene.lights.iter().map(|l| (format!("scene.light {:?}", l.name), Edit::Light(light(l))));
    let environment = scene.environment.iter().map(|environment| {
        let (config::Environment::Uri(uri) | config::Environment::Color(uri)) = environment;
        let edit = proto::Environment { uri: Some(uri.clone()), color: None };
        ("scene.environment".to_owned(), Edit::Environment(edit))
    });
    nodes.chain(materials).chain(lights).chain(environment).collect()
}

fn add(node: &config::SceneNode) -> proto::Add {
    proto::Add {
        node: node.name.clone(),
        uri: node.uri.clone(),
        role: node.role.map(|role| match role {
            config::Role::Prop => proto::Role::Prop,
            config::Role::Virtual => proto::Role::Virtual,
            config::Role::Raster => proto::Role::Raster,
            config::Role::Mask => proto::Role::Mask,
        }),
        translation_m: node.translation_m,
        rotation: node.rotation,
        scale: node.scale,
    }
}

fn material(material: &config::SceneMaterial) -> proto::Material {
    proto::Material {
        name: material.name.clone(),
        base_color: material.base_color.map(proto::ColorAlpha),
        metallic: material.metallic,
        roughness: material.roughness,
        emissive: material.emissive.map(proto::Color),
        transmission: material.transmission,
        thickness: material.thickness,
        ior: material.ior,
        clearcoat: material.clearcoat,
        clearcoat_roughness: material.clearcoat_roughness,
    }
}

fn light(light: &config::SceneLight) -> proto::Light {
    proto::Light {
        name: light.name.clone(),
        kind: Some(match light.kind {
            config::LightKind::Directional => proto::LightKind::Directional,
            config::LightKind::Point => proto::LightKind::Point,
            config::LightKind::Spot => proto::LightKind::Spot,
        }),
        position_m: light.position_m,
        direction: light.direction,
        color: light.color.map(proto::Color),
        intensity: light.intensity,
        inner_cone_rad: light.inner_cone_rad,
        outer_cone_rad: light.outer_cone_rad,
        remove: None,
    }
}

impl From<&config::Limits> for Limits {
    fn from(limits: &config::Limits) -> Self {
        let count = |limit: u64| usize::try_from(limit).unwrap_or(usize::MAX);
        Self {
            max_file_bytes: u64::from(limits.max_file_mib) << 20,
            max_triangles: count(limits.max_triangles),
            max_texels: count(limits.max_texels),
            max_nodes: limits.max_nodes as usize,
            max_lights: limits.max_lights as usize,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_configuration_without_limits_has_the_default_ones() {
        assert_eq!(Limits::from(&config::Limits::default()), Limits::default());
    }

    #[test]
    fn the_scene_of_the_demo_loads() {
        let nowhere = std::path::Path::new("/nonexistent");
        let demo = config::Config::parse(config::DEMO_TOML, "demo.toml", nowhere).unwrap();
        let scene = crate::Editor::from_config(&demo.scene, nowhere, (&demo.limits).into(), vec![]).unwrap().current();
        assert_eq!(scene.nodes.len(), demo.scene.nodes.len());
        let glass = scene.materials.iter().find(|material| !material.is_opaque()).unwrap();
        assert_eq!((glass.gpu.ior, glass.gpu.thickness), (1.5, 0.5));
        assert_eq!(scene.lights.len(), demo.scene.lights.len());
    }

    #[test]
    fn the_scene_of_every_example_loads() {
        let folder = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/examples"));
        let mut count = 0;
        for entry in std::fs::read_dir(folder).unwrap() {
            let example = config::Config::load(&entry.unwrap().path()).unwrap();
            let limits = (&example.limits).into();
            let editor = crate::Editor::from_config(&example.scene, &example.base_dir, limits, vec![]).unwrap();
            assert!(!editor.current().instances.is_empty());
            count += 1;
        }
        assert!(count >= 2);
    }
}
