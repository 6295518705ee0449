//! What good files give.

use std::path::Path;

use glam::DVec3;
use lantern_proto::{LightKind, Role};
use serde_json::json;

use super::load;
use super::sample::{Sample, png};
use crate::asset::Asset;
use crate::file::Access;
use crate::limits::Limits;
use crate::structures::Structures;
use crate::texture::Wrap;

fn loaded(sample: &Sample) -> Asset {
    let folder = tempfile::tempdir().unwrap();
    load(&sample.write(&folder), Access::Anywhere(&[]), &Limits::default(), &Structures::default()).unwrap()
}

#[test]
fn nodes_compose_and_share_their_meshes() {
    let asset = loaded(&Sample::new());
    assert_eq!(asset.meshes.len(), 2);
    assert_eq!(asset.parts.iter().map(|part| part.mesh).collect::<Vec<_>>(), [0, 0, 1]);
    assert_eq!(asset.triangle_count(), 3);
    let at = |part: usize| asset.parts[part].asset_from_object.transform_point3(DVec3::new(1.0, 0.0, 0.0));
    assert_eq!(at(0), DVec3::new(1.0, 0.0, 5.0));
    assert_eq!(at(1), DVec3::new(-1.0, 0.0, 5.0));
    assert_eq!(asset.parts.iter().map(|part| part.role).collect::<Vec<_>>(), [None, None, Some(Role::Mask)]);
}

#[test]
fn a_role_reaches_the_whole_subtree() {
    let mut sample = Sample::new();
    sample.json["nodes"][0]["extras"] = json!({"lantern": {"role": "virtual"}});
    let roles: Vec<_> = loaded(&sample).parts.iter().map(|part| part.role).collect();
    assert_eq!(roles, [Some(Role::Virtual), Some(Role::Virtual), Some(Role::Mask)]);
}

#[test]
fn materials_take_in_their_extensions() {
    let asset = loaded(&Sample::new());
    let paint = &asset.materials[0];
    assert_eq!(paint.name, "paint");
    let gpu = &paint.gpu;
    assert_eq!((gpu.base_color, gpu.metallic, gpu.roughness), ([0.5, 0.25, 1.0, 1.0], 0.25, 1.0));
    assert_eq!((gpu.clearcoat, gpu.clearcoat_roughness), (0.75, 0.1));
    assert_eq!((gpu.transmission, gpu.thickness, gpu.ior, gpu.specular), (0.5, 0.02, 1.33, 0.5));
    assert_eq!(gpu.emissive, [1.0, 2.0, 3.0]);
    assert!((gpu.absorption_per_m[0] - 10.0 * std::f32::consts::LN_2).abs() < 1e-4);
    assert_eq!(gpu.absorption_per_m[1], 0.0);
    assert_eq!(gpu.base_color_texture, 0);
    // The bare triangle has the default of glTF: a rough metal.
    let bare = &asset.materials[asset.meshes[1].used_materials[0] as usize];
    assert_eq!((bare.name.as_str(), bare.gpu.metallic, bare.gpu.roughness), ("default", 1.0, 1.0));
}

#[test]
fn textures_carry_their_sampler() {
    let asset = loaded(&Sample::new());
    let [texture] = asset.textures.as_slice() else { panic!("one texture") };
    assert_eq!((texture.wrap, texture.srgb, texture.nearest), ([Wrap::Clamp, Wrap::Repeat], true, true));
    assert_eq!(texture.image.texels, [[0, 0, 200, 255], [1, 0, 200, 255], [0, 1, 200, 255], [1, 1, 200, 255]]);
    assert_eq!(asset.texel_count(), 4);
}

#[test]
fn a_triangle_without_normals_is_flat() {
    let asset = loaded(&Sample::new());
    assert_eq!(asset.meshes[1].normals, [[0.0, 1.0, 0.0]; 3]);
    // Two triangles that share an edge: without normals each has three corners of its own.
    let mut sample = Sample::new();
    sample.json["meshes"][0]["primitives"][0]["attributes"] = json!({"POSITION": 0});
    assert_eq!(loaded(&sample).meshes[0].positions.len(), 6);
}

#[test]
fn lights_are_placed_and_named_apart() {
    let asset = loaded(&Sample::new());
    let names: Vec<&str> = asset.lights.iter().map(|light| light.name.as_str()).collect();
    assert_eq!(names, ["lamp", "light 1", "light 1 2"]);
    let lamp = &asset.lights[0];
    assert_eq!((lamp.kind, lamp.intensity, lamp.range_m), (LightKind::Spot, 40.0, 7.0));
    assert!((lamp.cones_rad[0] - 0.2).abs() < 1e-6 && (lamp.cones_rad[1] - 0.4).abs() < 1e-6);
    // The sun's matrix turns −Z, along which it shines, to −Y.
    let sun = asset.lights[2].asset_from_light;
    assert!((sun.transform_vector3(DVec3::NEG_Z) - DVec3::NEG_Y).length() < 1e-9, "{sun:?}");
    assert_eq!(sun.translation, DVec3::new(0.0, 9.0, 0.0));
}

#[test]
fn what_is_ignored_is_said_once() {
    let mut sample = Sample::new();
    sample.json["materials"][0]["alphaMode"] = json!("BLEND");
    sample.json["materials"].as_array_mut().unwrap().push(json!({"name": "second", "alphaMode": "MASK"}));
    sample.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] =
        json!({"KHR_texture_transform": {"scale": [2, 2]}});
    sample.json["animations"] = json!([{"channels": [], "samplers": []}]);
    let warnings = loaded(&sample).warnings;
    for (words, count) in [("EXT_unheard_of", 1), ("alpha modes", 1), ("animations", 1), ("KHR_texture_transform", 1)] {
        assert_eq!(warnings.iter().filter(|w| w.contains(words)).count(), count, "{words} in {warnings:?}");
    }
}

#[test]
fn gltf_with_files_and_data_uris_loads_like_its_glb() {
    let sample = Sample::new();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a b.bin"), &sample.bin).unwrap();
    std::fs::write(folder.path().join("t.png"), png(2, 2)).unwrap();
    let mut json = sample.json.clone();
    json["buffers"][0]["uri"] = json!("a%20b.bin");
    json["images"][0] = json!({"uri": "t.png"});
    let path = folder.path().join("a.gltf");
    std::fs::write(&path, json.to_string()).unwrap();
    let by_files = load(&path, Access::Anywhere(&[]), &Limits::default(), &Structures::default()).unwrap();

    use base64::Engine;
    let encoded = base64::engine::general_purpose::STANDARD.encode(&sample.bin);
    json["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{encoded}"));
    std::fs::write(&path, json.to_string()).unwrap();
    let by_data = load(&path, Access::Anywhere(&[]), &Limits::default(), &Structures::default()).unwrap();

    let glb = loaded(&sample);
    for other in [by_files, by_data] {
        assert_eq!(other.meshes, glb.meshes);
        assert_eq!(other.parts, glb.parts);
        assert_eq!(other.materials, glb.materials);
        assert_eq!(other.textures, glb.textures);
        assert_eq!(other.lights, glb.lights);
    }
}

#[test]
fn strips_fans_quantised_and_sparse_attributes_are_read() {
    let mut sample = Sample::new();
    let primitive = &mut sample.json["meshes"][0]["primitives"][0];
    primitive["mode"] = json!(5);
    assert_eq!(loaded(&sample).triangle_count(), 5);
    sample.json["meshes"][0]["primitives"][0]["mode"] = json!(6);
    assert_eq!(loaded(&sample).triangle_count(), 5);

    // Positions as normalised bytes, by KHR_mesh_quantization.
    let mut sample = Sample::new();
    sample.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let at = sample.bin.len();
    sample.bin.extend([0, 0, 0, 0, 127, 0, 0, 0, 0, 0, 129, 0]);
    sample.json["bufferViews"]
        .as_array_mut()
        .unwrap()
        .push(json!({"buffer": 0, "byteOffset": at, "byteLength": 12, "byteStride": 4}));
    sample.json["buffers"][0]["byteLength"] = json!(sample.bin.len());
    sample.json["accessors"][4] =
        json!({"bufferView": 6, "componentType": 5120, "normalized": true, "count": 3, "type": "VEC3"});
    let mesh = loaded(&sample).meshes[1].clone();
    assert_eq!(mesh.positions, [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]);

    // Two of the square's corners replaced.
    let mut sample = Sample::new();
    let at = sample.bin.len();
    sample.bin.extend([1u8, 3, 0, 0]);
    sample.bin.extend([2f32, 0., 0., 0., 2., 0.].iter().flat_map(|v| v.to_le_bytes()));
    let views = sample.json["bufferViews"].as_array_mut().unwrap();
    views.push(json!({"buffer": 0, "byteOffset": at, "byteLength": 2}));
    views.push(json!({"buffer": 0, "byteOffset": at + 4, "byteLength": 24}));
    sample.json["buffers"][0]["byteLength"] = json!(sample.bin.len());
    sample.json["accessors"][0]["max"] = json!([2, 2, 0]);
    sample.json["accessors"][0]["sparse"] =
        json!({"count": 2, "indices": {"bufferView": 6, "componentType": 5121}, "values": {"bufferView": 7}});
    let bounds = loaded(&sample).meshes[0].bounds_m.unwrap();
    assert_eq!(bounds, (DVec3::ZERO, DVec3::new(2.0, 2.0, 0.0)));
}

/// Real models lie beside the checkout where its owner put them.
fn real(name: &str) -> Option<Asset> {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/models")).join(name);
    let Ok(path) = path.canonicalize() else {
        eprintln!("skipped: {} is not there", path.display());
        return None;
    };
    Some(load(&path, Access::Anywhere(&[]), &Limits::default(), &Structures::default()).unwrap())
}

#[test]
fn the_bunny_has_all_its_triangles() {
    let Some(bunny) = real("stanford-bunny.glb") else { return };
    assert_eq!(bunny.triangle_count(), 69_451);
    let (min, max) = bunny.meshes[0].bounds_m.unwrap();
    assert!(min.y.abs() < 1e-3 && (max - min).max_element() < 0.31 && (max - min).max_element() > 0.29);
}

#[test]
fn spot_has_her_texture() {
    let Some(spot) = real("spot.glb") else { return };
    assert_eq!((spot.triangle_count(), spot.textures.len()), (5_856, 1));
}

#[test]
fn the_flight_helmet_has_its_materials_and_glass() {
    let Some(helmet) = real("FlightHelmet/FlightHelmet.gltf") else { return };
    assert_eq!(helmet.triangle_count(), 94_722);
    assert!(helmet.materials.len() >= 6, "{}", helmet.materials.len());
    assert!(helmet.materials.iter().all(|m| m.gpu.base_color_texture != crate::pack::NO_TEXTURE));
}
