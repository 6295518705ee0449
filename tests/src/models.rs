//! Models for tests to load, made on the spot.

use serde_json::{Value, json};

/// A glTF document and its buffer as binary glTF.
pub fn glb(gltf: &Value, bytes: &[u8]) -> Vec<u8> {
    let mut text = gltf.to_string();
    while !text.len().is_multiple_of(4) {
        text.push(' ');
    }
    let total = (12 + 8 + text.len() + 8 + bytes.len()) as u32;
    let chunk = |kind: &[u8], data: &[u8]| [&(data.len() as u32).to_le_bytes()[..], kind, data].concat();
    [b"glTF", &2u32.to_le_bytes()[..], &total.to_le_bytes(), &chunk(b"JSON", text.as_bytes()), &chunk(b"BIN\0", bytes)]
        .concat()
}

/// Where [`hills`] has its vertex of a column and a row, m.
pub fn hill_m(column: u32, row: u32, side: u32) -> [f32; 3] {
    let [x, z] = [column, row].map(|i| i as f32 / side as f32 - 0.5);
    [x, 0.02 * (40.0 * x).sin() * (55.0 * z).cos(), z]
}

/// Binary glTF of one square metre of hills about the origin: 2 × `side`² triangles, (`side` + 1)² vertices row by row, with
/// normals or, if `flat`, without. Its mesh is called `hills`.
pub fn hills(side: u32, flat: bool) -> Vec<u8> {
    let vertices = || (0..=side).flat_map(|row| (0..=side).map(move |column| (column, row)));
    let mut bytes: Vec<u8> = vertices().flat_map(|(c, r)| hill_m(c, r, side)).flat_map(f32::to_le_bytes).collect();
    let normals_at = bytes.len();
    if !flat {
        bytes.extend(vertices().flat_map(|_| [0.0, 1.0, 0.0f32]).flat_map(f32::to_le_bytes));
    }
    let indices_at = bytes.len();
    for (a, b) in
        (0..side).flat_map(|row| (0..side).map(move |column| row * (side + 1) + column)).map(|a| (a, a + side + 1))
    {
        bytes.extend([a, b, a + 1, a + 1, b, b + 1].iter().flat_map(|i| i.to_le_bytes()));
    }

    let count = (side + 1) * (side + 1);
    let mut attributes = json!({"POSITION": 0});
    if !flat {
        attributes["NORMAL"] = json!(2);
    }
    let view = |from: usize, to: usize| json!({"buffer": 0, "byteOffset": from, "byteLength": to - from});
    let vectors = |view: u32| {
        json!({"bufferView": view, "componentType": 5126, "count": count, "type": "VEC3",
        "min": [-0.5, -0.02, -0.5], "max": [0.5, 0.02, 0.5]})
    };
    let mut views = vec![view(0, normals_at), view(indices_at, bytes.len())];
    let indices = json!({"bufferView": 1, "componentType": 5125, "count": 6 * side * side, "type": "SCALAR"});
    let mut accessors = vec![vectors(0), indices];
    if !flat {
        views.push(view(normals_at, indices_at));
        accessors.push(json!({"bufferView": 2, "componentType": 5126, "count": count, "type": "VEC3"}));
    }
    let gltf = json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}], "scene": 0,
        "nodes": [{"mesh": 0}],
        "meshes": [{"name": "hills", "primitives": [{"attributes": attributes, "indices": 1}]}],
        "buffers": [{"byteLength": bytes.len()}],
        "bufferViews": views,
        "accessors": accessors,
    });
    glb(&gltf, &bytes)
}
