//! Meshes in a shape of a node's own.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use proptest::prelude::*;
use serde_json::json;

use crate::bvh::BoxRay;
use crate::editor_tests::{assert_same, edits, studio, verify_invariants};
use crate::pack::ROLE_PROP;
use crate::{Changes, Editor, Limits, Mesh, MeshData, Scene, changes};

fn vertices(node: &str, mesh: serde_json::Value, positions_m: &[[f32; 3]]) -> serde_json::Value {
    json!({"vertices": {"node": node, "mesh": mesh, "positions_m": positions_m}})
}

/// Where a node's first mesh has its vertices.
fn positions(scene: &Scene, node: usize) -> Vec<[f32; 3]> {
    let instance = scene.instances.iter().find(|instance| instance.node == node).unwrap();
    scene.meshes[instance.mesh].positions.clone()
}

fn raised(positions: &[[f32; 3]], by: f32) -> Vec<[f32; 3]> {
    positions.iter().map(|[x, y, z]| [*x, y + by, *z]).collect()
}

#[test]
fn one_node_changes_its_shape_and_others_of_the_file_do_not() {
    let mut editor = Editor::new(Limits::default(), vec![]);
    let balls = json!([
        {"add": {"node": "a", "uri": "lantern:sphere"}},
        {"add": {"node": "b", "uri": "lantern:sphere", "translation_m": [5, 0, 0]}},
        {"add": {"node": "ghost", "uri": "lantern:cube", "role": "virtual"}},
    ]);
    let old = editor.apply(&edits(balls)).unwrap();
    let file = positions(&old, 0);
    let up = raised(&file, 2.0);
    let new = editor.apply(&edits(json!([vertices("b", json!("sphere"), &up)]))).unwrap();
    verify_invariants(&new);
    assert_eq!((positions(&new, 0), positions(&new, 1)), (file.clone(), up.clone()));
    assert_eq!(changes(&old, &new), Changes { props_moved: true, ..Changes::default() });
    assert_eq!(new.triangle_count(), old.triangle_count());
    let hit =
        |scene: &Scene, x: f64| scene.cast(DVec3::new(x, 9.0, 0.0), DVec3::NEG_Y, 0.0, 99.0, ROLE_PROP).unwrap().t;
    assert!((hit(&new, 0.0) - 8.0).abs() < 1e-6 && (hit(&new, 5.0) - 6.0).abs() < 1e-6);
    // What was only moved has the normals that it had.
    let (of_file, moved) = (&new.meshes[new.instances[0].mesh], &new.meshes[new.instances[1].mesh]);
    let apart = of_file.normals.iter().zip(&moved.normals).map(|(a, b)| (Vec3::from(*a) - Vec3::from(*b)).length());
    assert!(apart.fold(0.0, f32::max) < 1e-4);

    // The same again changes nothing but the number; the file's own places bring its own mesh back.
    let same = editor.apply(&edits(json!([vertices("b", json!(0), &up)]))).unwrap();
    assert_eq!(changes(&new, &same), Changes::default());
    let back = editor.apply(&edits(json!([vertices("b", json!(0), &file)]))).unwrap();
    assert!(Arc::ptr_eq(&back.meshes[back.instances[1].mesh], &old.meshes[0]) && back.meshes.len() == old.meshes.len());
    assert_eq!(back.edits(), old.edits());

    // A virtual one is no prop that moves.
    let cube = raised(&positions(&back, 2), 0.5);
    let ghost = editor.apply(&edits(json!([vertices("ghost", json!(0), &cube)]))).unwrap();
    assert!(changes(&back, &ghost).virtual_moved && !changes(&back, &ghost).props_moved);
    editor.apply(&edits(json!([{"remove": {"node": "ghost"}}]))).unwrap();
    assert_eq!(editor.current().meshes.len(), 1);
}

#[test]
fn a_file_s_vertices_are_its_own_whatever_is_made_of_them() {
    let folder = tempfile::tempdir().unwrap();
    // One mesh of two primitives: without normals, so that corners part, and with them; one vertex that nothing uses.
    let places: Vec<[f32; 3]> =
        vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, -1.0], [0.0, 0.0, -1.0], [7.0, 7.0, 7.0]];
    let mut bytes: Vec<u8> = places.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0.0f32, 1.0, 0.0].repeat(5).iter().flat_map(|x| x.to_le_bytes()));
    bytes.extend([0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    let accessor = |view: u32, count: u32| {
        json!({"bufferView": view, "componentType": 5126, "count": count, "type": "VEC3",
        "min": [0, 0, -1], "max": [7, 7, 7]})
    };
    let gltf = json!({
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "scene": 0, "nodes": [{"mesh": 1}],
        "meshes": [{"name": "unused", "primitives": []}, {"name": "sheet", "primitives": [
            {"attributes": {"POSITION": 0}, "indices": 2},
            {"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2},
        ]}],
        "buffers": [{"uri": "sheet.bin", "byteLength": bytes.len()}],
        "bufferViews": [{"buffer": 0, "byteLength": 60}, {"buffer": 0, "byteOffset": 60, "byteLength": 60},
            {"buffer": 0, "byteOffset": 120, "byteLength": 12}],
        "accessors": [accessor(0, 5), accessor(1, 5), {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"}],
    });
    std::fs::write(folder.path().join("sheet.bin"), bytes).unwrap();
    std::fs::write(folder.path().join("sheet.gltf"), gltf.to_string()).unwrap();
    let mut editor = Editor::new(Limits::default(), vec![folder.path().to_owned()]);
    editor.apply(&edits(json!([{"add": {"node": "s", "uri": "sheet.gltf"}}]))).unwrap();

    // Stood on edge: both primitives' vertices are named one after the other, the unused ones as well.
    let upright = |p: &[f32; 3]| [p[0], -p[2], 0.0];
    let all: Vec<[f32; 3]> = places.iter().chain(&places).map(upright).collect();
    for (mesh, count) in [(json!("sheet"), 9), (json!(1), 11)] {
        let wrong = editor.apply(&edits(json!([vertices("s", mesh, &vec![[0.0; 3]; count])]))).unwrap_err();
        assert_eq!((wrong.code, wrong.at.as_str()), ("bad-value", "edits[0].positions_m"), "{wrong}");
        assert!(wrong.message.contains("10 vertices"), "{wrong}");
    }
    for mesh in [json!("unused"), json!(0), json!("sheets")] {
        let wrong = editor.apply(&edits(json!([vertices("s", mesh, &all)]))).unwrap_err();
        assert_eq!((wrong.code, wrong.at.as_str()), ("unknown-mesh", "edits[0].mesh"), "{wrong}");
    }
    let mut far = all.clone();
    far[4][1] = f32::INFINITY;
    let mut far_edit = edits(json!([vertices("s", json!(1), &all)]));
    if let crate::Edit::Vertices(of) = &mut far_edit[0] {
        of.positions_m.clone_from(&far);
    }
    let wrong = editor.apply(&far_edit).unwrap_err();
    assert!(wrong.code == "bad-value" && wrong.message.contains("at 4"), "{wrong}");

    let scene = editor.apply(&edits(json!([vertices("s", json!("sheet"), &all)]))).unwrap();
    verify_invariants(&scene);
    let mesh = &scene.meshes[scene.instances[0].mesh];
    for (normal, given) in mesh.normals.iter().zip(&editor.current().nodes[0].asset.vertices[0].has_normal) {
        assert!((Vec3::from(*normal) - Vec3::Z).length() < 1e-6, "{normal:?}, said by the file: {given}");
    }
    let told = scene.edits();
    let mut other = Editor::new(Limits::default(), vec![folder.path().to_owned()]);
    assert_same(&other.apply(&told).unwrap(), &scene);
}

#[test]
fn shapes_count_under_the_limit_of_triangles() {
    let limits = Limits { max_triangles: 30, ..Limits::default() };
    let mut editor = Editor::new(limits, vec![]);
    let cubes = json!([{"add": {"node": "a", "uri": "lantern:cube"}}, {"add": {"node": "b", "uri": "lantern:cube"}}]);
    let scene = editor.apply(&edits(cubes)).unwrap();
    let up = raised(&positions(&scene, 0), 1.0);
    let (a, b) = (vertices("a", json!(0), &up), vertices("b", json!(0), &up));
    editor.apply(&edits(json!([a]))).unwrap();
    let refused = editor.apply(&edits(json!([b]))).unwrap_err();
    assert_eq!((refused.code, refused.at.as_str()), ("too-large", "edits[0].positions_m"), "{refused}");
    let back = vertices("a", json!(0), &positions(&scene, 0));
    editor.apply(&edits(json!([back, b]))).unwrap();
    editor.apply(&edits(json!([{"remove": {"node": "b"}}, a]))).unwrap();
}

fn grid(side: u32) -> MeshData {
    let mut data = MeshData::default();
    for (row, column) in (0..=side).flat_map(|row| (0..=side).map(move |column| (row, column))) {
        let place = DVec3::new(f64::from(column), 0.0, f64::from(row)) / f64::from(side) - 0.5;
        data.push_vertex(place, DVec3::Y, glam::DVec2::ZERO);
    }
    for a in (0..side).flat_map(|row| (0..side).map(move |column| row * (side + 1) + column)) {
        let b = a + side + 1;
        data.push_triangle([a, b, a + 1], 0);
        data.push_triangle([a + 1, b, b + 1], 0);
    }
    data
}

/// The first triangle's parameter along a ray, by the structure and one by one.
fn first_hits(mesh: &Mesh, origin: DVec3, direction: DVec3) -> [Option<f64>; 2] {
    let meet = |triangle: usize| {
        let [a, b, c] = mesh.corners(triangle);
        let (e1, e2) = (b - a, c - a);
        let p = direction.cross(e2);
        let determinant = e1.dot(p);
        let from_a = origin - a;
        let (u, q) = (from_a.dot(p) / determinant, from_a.cross(e1));
        let v = direction.dot(q) / determinant;
        let t = e2.dot(q) / determinant;
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0).then_some(t)
    };
    let nearest = |hits: &mut dyn Iterator<Item = f64>| hits.min_by(f64::total_cmp);
    let mut leaves = vec![];
    let mut everywhere = f64::INFINITY;
    mesh.bvh.walk(&BoxRay::new(origin, direction, 0.0), &mut everywhere, |triangle, _| leaves.push(triangle));
    [nearest(&mut leaves.iter().filter_map(|&t| meet(t))), nearest(&mut (0..mesh.indices.len()).filter_map(meet))]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Gently bent (refitted) or torn apart (built anew): rays meet what they meet in a fresh structure, and what is there.
    #[test]
    fn a_refitted_structure_finds_what_a_fresh_one_does(
        wild in 0f64..1.0, phase in 0f64..6.0, rays in prop::collection::vec((prop::array::uniform3(-1f64..1.0), prop::array::uniform3(-1f64..1.0)), 40),
    ) {
        let mesh = Mesh::new(grid(24));
        let bent = |i: usize, p: &[f32; 3]| {
            let p = Vec3::from(*p).as_dvec3();
            let scattered = DVec3::new((i as f64 * 12.9).sin(), (i as f64 * 78.2).sin(), (i as f64 * 37.7).sin());
            let bent = DVec3::new(p.x, 0.3 * (5.0 * p.x + phase).sin() * (4.0 * p.z).cos(), p.z);
            bent.lerp(scattered, wild.powi(4)).as_vec3().to_array()
        };
        let positions: Vec<[f32; 3]> = mesh.positions.iter().enumerate().map(|(i, p)| bent(i, p)).collect();
        let moved = mesh.moved(positions.clone(), &vec![true; positions.len()]);
        let fresh = Mesh::new(MeshData { positions, ..grid(24) });
        prop_assert_eq!(moved.bounds_m, fresh.bounds_m);
        prop_assert!(moved.normals.iter().all(|n| (Vec3::from(*n).length() - 1.0).abs() < 1e-5));
        for (origin, toward) in rays {
            let (origin, direction) = (DVec3::from(origin) * 2.0, DVec3::from(toward) - DVec3::from(origin) * 2.0);
            prop_assume!(direction.length() > 1e-3);
            let ([by_refit, one_by_one], [by_build, _]) = (first_hits(&moved, origin, direction), first_hits(&fresh, origin, direction));
            prop_assert_eq!(by_refit, one_by_one);
            prop_assert_eq!(by_refit, by_build);
        }
    }

    /// After any sequence of shapes, moves and removals what `scene.get` says rebuilds the scene.
    #[test]
    fn shapes_can_be_told_and_rebuilt(steps in prop::collection::vec((0usize..3, 0usize..4, -2f32..2.0), 1..12)) {
        let (folder, mut editor) = studio();
        let adds = json!([
            {"add": {"node": "a", "uri": "lantern:cube"}},
            {"add": {"node": "b", "uri": "lantern:cube", "translation_m": [3, 0, 0]}},
            {"add": {"node": "c", "uri": "a.glb", "translation_m": [0, 3, 0]}},
        ]);
        let scene = editor.apply(&edits(adds)).unwrap();
        let cube = positions(&scene, 0);
        for (node, step, by) in steps {
            let name = ["a", "b", "c"][node];
            let edit = match step {
                0 => json!({"set": {"node": name, "translation_m": [by, 0, 0]}}),
                1 => json!({"remove": {"node": name}}),
                _ => vertices(name, json!(0), &raised(&cube, by)),
            };
            // Refused where the node has gone, or is of another file.
            let _ = editor.apply(&edits(json!([edit])));
            verify_invariants(&editor.current());
        }
        let scene = editor.current();
        let mut rebuilt = Editor::new(Limits::default(), vec![folder.path().to_owned()]);
        let told: Vec<crate::Edit> = serde_json::from_str(&serde_json::to_string(&scene.edits()).unwrap()).unwrap();
        assert_same(&rebuilt.apply(&told).unwrap(), &scene);
    }
}
