//! What bad files give: an error that names the file, the object, the cause and the remedy; never a panic.

use proptest::prelude::*;
use serde_json::{Value, json};

use super::load;
use super::sample::{Sample, png};
use crate::file::Access;
use crate::limits::Limits;
use crate::structures::Structures;

/// The error of a file, whose form is checked.
fn refused(bytes: &[u8], limits: &Limits) -> (String, &'static str) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    std::fs::write(&path, bytes).unwrap();
    let roots = [folder.path().canonicalize().unwrap()];
    let error = load(&path, Access::Roots(&roots), limits, &Structures::default()).unwrap_err();
    let message = error.to_string();
    let rest = message.strip_prefix(&format!("{}: ", path.display())).expect("the file comes first").to_owned();
    let (said, hint) = rest.split_once("; hint: ").expect("a hint comes last");
    assert!(said.contains(": ") && hint.len() > 10 && !message.ends_with('.'), "{message}");
    (rest, error.code())
}

/// The error of the sample with one value replaced.
fn spoiled(pointer: &str, value: Value) -> String {
    let mut sample = Sample::new();
    *sample.json.pointer_mut(pointer).unwrap_or_else(|| panic!("no {pointer}")) = value;
    refused(&sample.glb(), &Limits::default()).0
}

#[test]
fn indices_out_of_range_are_named() {
    for (pointer, object) in [
        ("/scene", "scene: refers to scene 99"),
        ("/scenes/0/nodes/0", "scene: refers to node 99"),
        ("/nodes/0/children/0", "node 0: refers to node 99"),
        ("/nodes/0/mesh", "node 0: refers to mesh 99"),
        ("/nodes/1/extensions/KHR_lights_punctual/light", "node 1: refers to light 99"),
        ("/meshes/0/primitives/0/attributes/POSITION", "mesh 0 primitive 0: refers to accessor 99"),
        ("/meshes/0/primitives/0/attributes/NORMAL", "mesh 0 primitive 0: refers to accessor 99"),
        ("/meshes/0/primitives/0/indices", "mesh 0 primitive 0: refers to accessor 99"),
        ("/meshes/0/primitives/0/material", "mesh 0 primitive 0: refers to material 99"),
        ("/materials/0/pbrMetallicRoughness/baseColorTexture/index", "material 0: refers to texture 99"),
        ("/textures/0/source", "texture 0: refers to image 99"),
        ("/textures/0/sampler", "texture 0: refers to sampler 99"),
        ("/images/0/bufferView", "image 0: refers to buffer view 99"),
        ("/accessors/0/bufferView", "mesh 0 primitive 0, accessor 0: refers to buffer view 99"),
        ("/bufferViews/0/buffer", "buffer view 0: refers to buffer 99"),
    ] {
        let message = spoiled(pointer, json!(99));
        assert!(message.starts_with(object), "{pointer}: {message}");
    }
}

#[test]
fn bounds_that_do_not_hold_are_named() {
    for (pointer, value, expected) in [
        (
            "/accessors/0/count",
            json!(5),
            "mesh 0 primitive 0, accessor 0: needs 60 bytes of buffer view 0, which has 48",
        ),
        ("/accessors/3/count", json!(9), "mesh 0 primitive 0, accessor 3: needs 18 bytes"),
        ("/accessors/0/count", json!(4_000_000_000u64), "mesh 0 primitive 0, accessor 0: elements: 4000000000, above"),
        ("/accessors/0/count", json!(u64::MAX), "mesh 0 primitive 0, accessor 0: elements"),
        ("/bufferViews/0/byteLength", json!(100_000), "buffer view 0: needs 100000 bytes of buffer 0"),
        ("/bufferViews/0/byteOffset", json!(u64::MAX), "buffer view 0: declares offsets and counts that overflow"),
        ("/buffers/0/byteLength", json!(5_000_000_000u64), "buffer 0: needs 5000000000 bytes of its data"),
        ("/accessors/0/max", json!([1, 0.5, 0]), "mesh 0 primitive 0, accessor 0: vertex 2 at"),
        ("/accessors/0/min", json!([0.25, 0, 0]), "mesh 0 primitive 0, accessor 0: vertex 0 at"),
        ("/accessors/1/count", json!(3), "mesh 0 primitive 0: has 3 normals for 4 positions"),
        ("/accessors/0/type", json!("VEC2"), "mesh 0 primitive 0, accessor 0: holds Vec2 where Vec3"),
        ("/accessors/0/componentType", json!(7), "mesh 0 primitive 0, accessor 0: has a component type"),
        ("/accessors/3/componentType", json!(5126), "mesh 0 primitive 0, accessor 3: holds indices of type F32"),
        ("/accessors/3/count", json!(5), "mesh 0 primitive 0: has 5 corners"),
    ] {
        let message = spoiled(pointer, value);
        assert!(message.starts_with(expected), "{pointer}: {message}");
    }
    // An offset whose sum with the rest overflows.
    let mut sample = Sample::new();
    sample.json["accessors"][0]["byteOffset"] = json!(u64::MAX - 3);
    assert!(refused(&sample.glb(), &Limits::default()).0.contains("overflow"));
}

#[test]
fn values_that_cannot_be_are_named() {
    for (pointer, value, expected) in [
        ("/nodes/0/translation", json!([0, 1e39, 0]), "JSON: its JSON cannot be read: number out of range"),
        ("/nodes/3/matrix/3", json!(0.5), "node 3: has a matrix whose last row"),
        ("/nodes/2/extras/lantern/role", json!("ghost"), "node 2: has extras.lantern.role \"ghost\""),
        ("/materials/0/pbrMetallicRoughness/metallicFactor", json!(7), "material 0: has a metallicFactor"),
        ("/materials/0/extensions/KHR_materials_ior/ior", json!(0.2), "material 0: has an ior of 0.2"),
        (
            "/materials/0/extensions/KHR_materials_volume/attenuationDistance",
            json!(0),
            "material 0: has an attenuationDistance",
        ),
        (
            "/materials/0/extensions/KHR_materials_clearcoat/clearcoatFactor",
            json!("a"),
            "material 0: has a clearcoatFactor",
        ),
        ("/extensions/KHR_lights_punctual/lights/0/type", json!("area"), "light 0: is of a type"),
        ("/extensions/KHR_lights_punctual/lights/0/intensity", json!(-1), "light 0: has a color, intensity"),
        ("/extensions/KHR_lights_punctual/lights/0/spot/innerConeAngle", json!(2), "light 0: has cone angles"),
        ("/samplers/0/wrapS", json!(3), "texture 0: has a sampler"),
        ("/asset/version", json!("1.0"), "asset: is glTF of version \"1.0\""),
        ("/extensionsUsed", json!(7), "JSON: its JSON cannot be read"),
    ] {
        let message = spoiled(pointer, value);
        assert!(message.starts_with(expected), "{pointer}: {message}");
    }
    let mut sample = Sample::new();
    sample.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    let (message, code) = refused(&sample.glb(), &Limits::default());
    assert!(message.contains("requires the extension KHR_draco_mesh_compression"), "{message}");
    assert_eq!(code, "bad-gltf");
}

#[test]
fn vertices_that_are_not_finite_and_corners_that_are_none_are_named() {
    for (bytes, expected) in [
        (f32::NAN, "mesh 0 primitive 0, accessor 0: vertex 1 is [NaN, 0.0, 0.0], which is not finite"),
        (f32::INFINITY, "mesh 0 primitive 0, accessor 0: vertex 1 is [inf"),
        (-1e30, "mesh 0 primitive 0, accessor 0: vertex 1 is [-1e30"),
    ] {
        let mut sample = Sample::new();
        sample.bin[12..16].copy_from_slice(&f32::to_le_bytes(bytes));
        let message = refused(&sample.glb(), &Limits::default()).0;
        assert!(message.starts_with(expected), "{message}");
    }
    let mut sample = Sample::new();
    let indices = sample.json["bufferViews"][3]["byteOffset"].as_u64().unwrap() as usize;
    sample.bin[indices + 2] = 4;
    let message = refused(&sample.glb(), &Limits::default()).0;
    assert!(message.starts_with("mesh 0 primitive 0: index 1 is 4, of 4 vertices"), "{message}");
}

#[test]
fn nodes_that_are_no_tree_are_refused_and_deep_ones_bear() {
    assert!(spoiled("/nodes/0/children", json!([1, 2, 0])).starts_with("node 0: is reached twice"));
    assert!(spoiled("/nodes/0/children", json!([1, 1])).starts_with("node 1: is reached twice"));

    let mut sample = Sample::new();
    let deep = 50_000;
    let mut nodes: Vec<Value> = (0..deep).map(|i| json!({"children": [i + 1]})).collect();
    nodes.push(json!({"mesh": 0}));
    sample.json["nodes"] = json!(nodes);
    sample.json["scenes"] = json!([{"nodes": [0]}]);
    let folder = tempfile::tempdir().unwrap();
    let path = sample.write(&folder);
    assert_eq!(load(&path, Access::Anywhere(&[]), &Limits::default(), &Structures::default()).unwrap().parts.len(), 1);
    let few = Limits { max_nodes: 1000, ..Limits::default() };
    let (message, code) = refused(&sample.glb(), &few);
    assert!(message.contains("nodes: 50001, above the limit of 1000"), "{message}");
    assert_eq!(code, "too-large");
}

#[test]
fn files_that_are_missing_or_out_of_bounds_are_named() {
    for (uri, expected) in [
        ("gone.png", "image 0: names \"gone.png\", which is not at"),
        ("/etc/passwd", "image 0: names \"/etc/passwd\", which is no relative path"),
        ("https://example.org/a.png", "image 0: names \"https://example.org/a.png\", which is no relative path"),
        ("data:image/png,abc", "image 0: names \"data:image/png,abc\", which is a data uri without base64"),
        ("data:image/png;base64,?", "image 0: names \"data:image/png;base64,?\", which is not base64"),
        ("a.glb", "image 0: is neither PNG nor JPEG"),
    ] {
        let mut sample = Sample::new();
        sample.json["images"][0] = json!({"uri": uri});
        let message = refused(&sample.glb(), &Limits::default()).0;
        assert!(message.starts_with(expected), "{message}");
    }
    // A client's model may not read beside its root.
    let mut sample = Sample::new();
    sample.json["images"][0] = json!({"uri": "../../../../../../../../etc/passwd"});
    let (message, code) = refused(&sample.glb(), &Limits::default());
    assert!(message.starts_with("image 0: names ") && message.contains("asset root"), "{message}");
    assert_eq!(code, "outside-asset-roots");
    // A buffer without a chunk, and a texture without an image.
    let mut sample = Sample::new();
    sample.json["buffers"] = json!([{"byteLength": 4}, {"byteLength": 4}]);
    assert!(refused(&sample.glb(), &Limits::default()).0.starts_with("buffer 1: has no uri"));
    let mut sample = Sample::new();
    sample.json["textures"][0] = json!({"sampler": 0});
    assert!(refused(&sample.glb(), &Limits::default()).0.starts_with("texture 0: names no image"));
}

#[test]
fn images_are_bounded_before_they_are_decoded() {
    let mut sample = Sample::new();
    let at = sample.bin.len();
    let mut picture = png(2, 2);
    // The header's width and height; its checksum no longer fits, nor do the data, and neither is reached.
    picture[16..24].copy_from_slice(&[0, 0, 0xff, 0xff, 0, 0, 0xff, 0xff]);
    sample.bin.extend(&picture);
    sample.json["bufferViews"][5] = json!({"buffer": 0, "byteOffset": at, "byteLength": picture.len()});
    sample.json["buffers"][0]["byteLength"] = json!(sample.bin.len());
    let message = refused(&sample.glb(), &Limits::default()).0;
    assert!(message.starts_with("image 0: "), "{message}");

    let few = Limits { max_texels: 3, ..Limits::default() };
    let (message, code) = refused(&Sample::new().glb(), &few);
    assert!(message.starts_with("image 0: texels so far: 4, above the limit of 3"), "{message}");
    assert_eq!(code, "too-large");
    let few = Limits { max_triangles: 1, ..Limits::default() };
    assert!(refused(&Sample::new().glb(), &few).0.contains("above the limit of"));
    let few = Limits { max_file_bytes: 100, ..Limits::default() };
    assert_eq!(refused(&Sample::new().glb(), &few).1, "too-large");
}

#[test]
fn damaged_containers_say_so() {
    let good = Sample::new().glb();
    for (bytes, expected) in [
        (&b""[..], "file: is neither GLB"),
        (b"hello", "file: is neither GLB"),
        (b"{\"asset\":", "JSON: its JSON cannot be read"),
        (b"{}", "JSON: its JSON cannot be read: missing field `asset`"),
        (b"glTF", "GLB header: needs 12 bytes of the file, which has 4"),
        (b"glTF\x01\0\0\0\x0c\0\0\0", "GLB header: is binary glTF of version 1"),
        (b"glTF\x02\0\0\0\0\0\0\0", "GLB chunk 0: needs 20 bytes"),
        (b"glTF\x02\0\0\0\xff\xff\xff\xff", "GLB header: needs 4294967295 bytes"),
        (&good[..good.len() - 8], "GLB header: needs"),
    ] {
        let message = refused(bytes, &Limits::default()).0;
        assert!(message.starts_with(expected), "{message}");
    }
    let nested = "[".repeat(100_000);
    let message = refused(format!("{{\"asset\":{nested}").as_bytes(), &Limits::default()).0;
    assert!(message.starts_with("JSON: "), "{message}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// Whatever happens to the bytes, loading ends in an asset or in an error.
    #[test]
    fn flipped_and_cut_bytes_never_panic(
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..12),
        cut in prop::option::weighted(0.2, any::<prop::sample::Index>()),
    ) {
        let mut bytes = Sample::new().glb();
        for (at, value) in flips {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        std::fs::write(&path, &bytes).unwrap();
        let limits = Limits { max_triangles: 1000, max_texels: 1 << 16, ..Limits::default() };
        if let Err(error) = load(&path, Access::Anywhere(&[]), &limits, &Structures::default()) {
            prop_assert!(error.to_string().contains("; hint: "));
        }
    }

    /// The same where only digits change, so that the JSON stays one and its numbers do the harm.
    #[test]
    fn other_numbers_never_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), "[0-9]"), 1..6),
    ) {
        let sample = Sample::new();
        let mut json = sample.json.to_string().into_bytes();
        let digits: Vec<usize> = (0..json.len()).filter(|&i| json[i].is_ascii_digit()).collect();
        for (at, digit) in changes {
            json[digits[at.index(digits.len())]] = digit.as_bytes()[0];
        }
        if let Ok(json) = serde_json::from_slice(&json) {
            let folder = tempfile::tempdir().unwrap();
            let path = Sample { json, bin: sample.bin }.write(&folder);
            let limits = Limits { max_triangles: 1000, ..Limits::default() };
            let _ = load(&path, Access::Anywhere(&[]), &limits, &Structures::default());
        }
    }
}
