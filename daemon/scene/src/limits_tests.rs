//! What a scene may hold, whoever brings it.

use serde_json::json;

use crate::editor_tests::{edits, model, studio, verify_invariants};
use crate::{Editor, Limits};

#[test]
fn limits_hold_for_all_nodes_together() {
    let limits = Limits { max_triangles: 30_000, max_nodes: 3, ..Limits::default() };
    let mut editor = Editor::new(limits, vec![]);
    let sphere = |name: &str| json!({"add": {"node": name, "uri": "lantern:sphere"}});
    editor.apply(&edits(json!([sphere("a"), sphere("b")]))).unwrap();
    let error = editor.apply(&edits(json!([{"add": {"node": "pot", "uri": "lantern:teapot"}}]))).unwrap_err();
    assert_eq!((error.code, error.at.as_str()), ("too-large", "edits[0].uri"), "{error}");
    let error = editor.apply(&edits(json!([sphere("c"), sphere("d")]))).unwrap_err();
    assert_eq!((error.code, error.at.as_str()), ("too-large", "edits[1].node"), "{error}");
}

#[test]
fn every_nodes_materials_count() {
    let mut editor = Editor::new(Limits { max_nodes: 3, ..Limits::default() }, vec![]);
    // Two materials each.
    let floor = |name: &str| json!({"add": {"node": name, "uri": "lantern:checker"}});
    let error = editor.apply(&edits(json!([floor("a"), floor("b")]))).unwrap_err();
    assert_eq!((error.code, error.at.as_str()), ("too-large", "edits[1].uri"), "{error}");
    assert!(error.message.starts_with("materials of the whole scene would be 4, above the limit of 3"), "{error}");
    editor.apply(&edits(json!([floor("a"), {"remove": {"node": "a"}}, floor("b")]))).unwrap();
}

#[test]
fn a_file_is_loaded_only_as_far_as_the_rest_of_the_scene_leaves_room() {
    let (folder, _) = studio();
    std::fs::copy(folder.path().join("a.glb"), folder.path().join("b.glb")).unwrap();
    let add = |node: &str, uri: &str| json!({"add": {"node": node, "uri": uri}});
    // The sample has three triangles and four texels.
    for (limits, said) in [
        (Limits { max_triangles: 5, ..Limits::default() }, "triangles so far: 3, above the limit of 2"),
        (Limits { max_texels: 7, ..Limits::default() }, "texels so far: 4, above the limit of 3"),
    ] {
        let mut editor = Editor::new(limits, vec![folder.path().to_owned()]);
        let error = editor.apply(&edits(json!([add("a", "a.glb"), add("b", "b.glb")]))).unwrap_err();
        assert_eq!((error.code, error.at.as_str()), ("too-large", "edits[1].uri"), "{error}");
        assert!(error.message.contains(said) && error.message.contains("leaves"), "{error}");
        // The same file again costs nothing, and what goes first makes room.
        editor.apply(&edits(json!([add("a", "a.glb"), add("again", "a.glb")]))).unwrap();
        let one_of_two = edits(json!([{"remove": {"node": "a"}}, add("b", "b.glb")]));
        assert_eq!(editor.apply(&one_of_two).unwrap_err().at, "edits[1].uri");
        let both = json!([{"remove": {"node": "a"}}, {"remove": {"node": "again"}}, add("b", "b.glb")]);
        verify_invariants(&editor.apply(&edits(both)).unwrap());
    }
}

#[test]
fn lights_are_bounded_whoever_brings_them() {
    let mut editor = Editor::new(Limits::default(), vec![]);
    let lamps = |count: usize| {
        let lamp = |i| json!({"light": {"name": format!("lamp {i}"), "kind": "point"}});
        edits(json!((0..count).map(lamp).collect::<Vec<_>>()))
    };
    let error = editor.apply(&lamps(9000)).unwrap_err();
    assert_eq!((error.code, error.at.as_str()), ("too-large", "edits[16].name"), "{error}");
    assert!(error.message.contains("limit of 16 (limits.max_lights)"), "{error}");
    assert_eq!(editor.apply(&lamps(16)).unwrap().lights.len(), 16);
    // What is there may change, and goes to make room.
    let other = json!({"light": {"name": "other", "kind": "point"}});
    editor.apply(&edits(json!([{"light": {"name": "lamp 0", "intensity": 2}}]))).unwrap();
    editor.apply(&edits(json!([{"light": {"name": "lamp 0", "remove": true}}, other]))).unwrap();

    // The sample brings three.
    let (folder, _) = studio();
    let limits = Limits { max_lights: 3, ..Limits::default() };
    let mut editor = Editor::new(limits, vec![folder.path().to_owned()]);
    let add = |node: &str| json!({"add": {"node": node, "uri": "a.glb"}});
    assert_eq!(editor.apply(&edits(json!([add("a")]))).unwrap().lights.len(), 3);
    for (edit, at) in [(add("b"), "edits[0].uri"), (other.clone(), "edits[0].name")] {
        let error = editor.apply(&edits(json!([edit]))).unwrap_err();
        assert_eq!((error.code, error.at.as_str()), ("too-large", at), "{error}");
        assert!(error.message.contains("limits.max_lights"), "{error}");
    }
    let dark = json!({"light": {"name": "a/lamp", "remove": true}});
    assert_eq!(editor.apply(&edits(json!([dark, other]))).unwrap().lights.len(), 3);
    let lit = json!({"light": {"name": "a/lamp", "intensity": 2}});
    assert_eq!(editor.apply(&edits(json!([lit]))).unwrap_err().at, "edits[0].name");

    // The configuration is held to it as well, and a file that has too many by itself is not taken.
    let limits = Limits { max_lights: 2, ..limits };
    let light = |name: &str| lantern_config::SceneLight {
        name: name.into(),
        kind: lantern_config::LightKind::Directional,
        position_m: None,
        direction: None,
        color: None,
        intensity: None,
        inner_cone_rad: None,
        outer_cone_rad: None,
    };
    let node = model();
    let lights = vec![light("1"), light("2"), light("3")];
    let config = lantern_config::Scene { nodes: vec![node], lights, ..Default::default() };
    let problems = Editor::from_config(&config, folder.path(), limits, vec![]).unwrap_err();
    let found: Vec<_> = problems.iter().map(|p| (p.code, p.at.as_str(), p.field)).collect();
    assert_eq!(
        found,
        [("too-large", "scene.node \"model\"", "uri"), ("too-large", "scene.light \"3\"", "name")],
        "{problems:?}"
    );
    assert!(problems[0].message.contains("lights so far: 3, above the limit of 2"), "{problems:?}");
}
