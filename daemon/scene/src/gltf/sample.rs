//! A small document that uses what is read, for tests to load and to spoil.

use std::io::Cursor;
use std::path::PathBuf;

use serde_json::{Value, json};

/// A document and its one buffer.
#[derive(Clone)]
pub(crate) struct Sample {
    pub(crate) json: Value,
    pub(crate) bin: Vec<u8>,
}

impl Sample {
    /// A textured square of two triangles in the plane z = 0 (mesh 0) and a bare triangle without normals, uvs, indices
    /// or material (mesh 1), under a node that moves, a node that mirrors and one that is masked, with three lights.
    pub(crate) fn new() -> Self {
        let mut bin = vec![];
        let mut views = vec![];
        let mut view = |bytes: &[u8]| {
            views.push(json!({"buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len()}));
            bin.extend_from_slice(bytes);
            bin.resize(bin.len().next_multiple_of(4), 0);
        };
        let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>();
        view(&floats(&[0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.]));
        view(&floats(&[0., 0., 1., 0., 0., 1., 0., 0., 1., 0., 0., 1.]));
        view(&floats(&[0., 1., 1., 1., 1., 0., 0., 0.]));
        view(&[0u16, 1, 2, 0, 2, 3].map(u16::to_le_bytes).concat());
        view(&floats(&[0., 0., 0., 0., 0., 1., 1., 0., 0.]));
        view(&png(2, 2));
        let float = 5126;
        let json = json!({
            "asset": {"version": "2.0"},
            "extensionsUsed": ["KHR_lights_punctual", "KHR_materials_clearcoat", "EXT_unheard_of"],
            "scene": 0,
            "scenes": [{"nodes": [0, 3]}],
            "nodes": [
                {"name": "moved", "translation": [0, 0, 5], "children": [1, 2], "mesh": 0},
                {"name": "mirrored", "scale": [-1, 1, 1], "mesh": 0,
                 "extensions": {"KHR_lights_punctual": {"light": 0}}},
                {"name": "masked", "mesh": 1, "extras": {"lantern": {"role": "mask"}},
                 "extensions": {"KHR_lights_punctual": {"light": 1}}},
                {"name": "sun", "matrix": [1,0,0,0, 0,0,-1,0, 0,1,0,0, 0,9,0,1],
                 "extensions": {"KHR_lights_punctual": {"light": 1}}},
            ],
            "meshes": [
                {"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2},
                                 "indices": 3, "material": 0}]},
                {"primitives": [{"attributes": {"POSITION": 4}}]},
            ],
            "materials": [{
                "name": "paint",
                "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 1, 1], "metallicFactor": 0.25,
                                         "baseColorTexture": {"index": 0}},
                "emissiveFactor": [0.1, 0.2, 0.3],
                "extensions": {
                    "KHR_materials_clearcoat": {"clearcoatFactor": 0.75, "clearcoatRoughnessFactor": 0.1},
                    "KHR_materials_emissive_strength": {"emissiveStrength": 10},
                    "KHR_materials_transmission": {"transmissionFactor": 0.5},
                    "KHR_materials_volume": {"thicknessFactor": 0.02, "attenuationDistance": 0.1,
                                             "attenuationColor": [0.5, 1, 1]},
                    "KHR_materials_ior": {"ior": 1.33},
                    "KHR_materials_specular": {"specularFactor": 0.5},
                },
            }],
            "textures": [{"source": 0, "sampler": 0}],
            "samplers": [{"wrapS": 33071, "magFilter": 9728}],
            "images": [{"bufferView": 5, "mimeType": "image/png"}],
            "extensions": {"KHR_lights_punctual": {"lights": [
                {"name": "lamp", "type": "spot", "color": [1, 0.5, 0.25], "intensity": 40, "range": 7,
                 "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.4}},
                {"type": "directional", "intensity": 3},
            ]}},
            "accessors": [
                {"bufferView": 0, "componentType": float, "count": 4, "type": "VEC3", "min": [0,0,0], "max": [1,1,0]},
                {"bufferView": 1, "componentType": float, "count": 4, "type": "VEC3"},
                {"bufferView": 2, "componentType": float, "count": 4, "type": "VEC2"},
                {"bufferView": 3, "componentType": 5123, "count": 6, "type": "SCALAR"},
                {"bufferView": 4, "componentType": float, "count": 3, "type": "VEC3", "min": [0,0,0], "max": [1,0,1]},
            ],
            "bufferViews": views,
            "buffers": [{"byteLength": bin.len()}],
        });
        Self { json, bin }
    }

    pub(crate) fn glb(&self) -> Vec<u8> {
        let mut json = serde_json::to_vec(&self.json).unwrap();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut bytes = b"glTF\x02\0\0\0".to_vec();
        bytes.extend(((28 + json.len() + self.bin.len()) as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &self.bin)] {
            bytes.extend((chunk.len() as u32).to_le_bytes());
            bytes.extend(kind);
            bytes.extend(chunk);
        }
        bytes
    }

    /// Writes it as a.glb into a folder.
    pub(crate) fn write(&self, folder: &tempfile::TempDir) -> PathBuf {
        let path = folder.path().join("a.glb");
        std::fs::write(&path, self.glb()).unwrap();
        path
    }
}

pub(crate) fn png(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = vec![];
    let picture = image::RgbaImage::from_fn(width, height, |x, y| image::Rgba([x as u8, y as u8, 200, 255]));
    picture.write_to(&mut Cursor::new(&mut bytes), image::ImageFormat::Png).unwrap();
    bytes
}
