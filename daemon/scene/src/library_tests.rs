//! Which files are loaded, on whose word, and when anew.

use std::path::PathBuf;
use std::sync::Arc;

use serde_json::json;

use crate::editor_tests::{assert_same, edits, model, studio};
use crate::gltf::sample::Sample;
use crate::{Changes, Edit, Editor, Limits, changes};

#[test]
fn a_file_of_the_configuration_is_stored_by_its_path_and_restored() {
    let folder = tempfile::tempdir().unwrap();
    Sample::new().write(&folder);
    let node = model();
    let mut config = lantern_config::Scene { nodes: vec![node.clone()], ..Default::default() };
    config.environment = Some(lantern_config::Environment::Color("#ffffff".into()));
    let mut editor = Editor::from_config(&config, folder.path(), Limits::default(), vec![]).unwrap();
    let scene = editor.current();
    assert_eq!((scene.revision, scene.environment.texels[0][0]), (1, 1.0));
    assert!(PathBuf::from(&scene.nodes[0].uri).is_absolute());

    // A client may not have it, the daemon's own store may.
    let mut other = Editor::new(Limits::default(), vec![]);
    assert_eq!(other.apply(&scene.edits()).unwrap_err().code, "outside-asset-roots");
    assert_same(&other.restore(&scene.edits()).unwrap(), &scene);

    // Loaded again unchanged, it is the same to the last section; a bad one changes nothing and says all that is wrong.
    let again = editor.reconfigure(&config, folder.path(), Limits::default(), vec![]).unwrap();
    assert_eq!((changes(&scene, &again), again.revision), (Changes::default(), 2));
    let gone = lantern_config::SceneNode { name: "x".into(), uri: "gone.glb".into(), ..node.clone() };
    let odd = lantern_config::SceneNode { name: "y".into(), uri: "lantern:odd".into(), ..node };
    config.nodes.extend([gone, odd]);
    let problems = editor.reconfigure(&config, folder.path(), Limits::default(), vec![]).unwrap_err();
    assert_eq!(problems.iter().map(|p| p.at.as_str()).collect::<Vec<_>>(), ["scene.node \"x\"", "scene.node \"y\""]);
    assert!(Arc::ptr_eq(&editor.current(), &again));
}

#[test]
fn a_client_may_give_back_what_scene_get_tells() {
    let (folder, elsewhere) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let path = Sample::new().write(&folder).canonicalize().unwrap();
    Sample::new().write(&elsewhere);
    let other = folder.path().join("other.glb");
    std::fs::copy(&path, &other).unwrap();
    let node = model();
    let config = lantern_config::Scene { nodes: vec![node], ..Default::default() };
    let editor = Editor::from_config(&config, folder.path(), Limits::default(), vec![]).unwrap();
    let told = editor.current();
    let mut restored = Editor::new(Limits::default(), vec![]);
    restored.restore(&told.edits()).unwrap();

    let remove = edits(json!([{"remove": {"node": "model"}}])).remove(0);
    let add = |uri: &str| edits(json!([{"add": {"node": "b", "uri": uri}}]));
    for mut editor in [editor, restored] {
        let again: Vec<Edit> = std::iter::once(remove.clone()).chain(told.edits()).collect();
        assert_same(&editor.apply(&again).unwrap(), &told);
        // Also when nothing shows it any more, but by this very path alone, and nothing beside it.
        editor.apply(std::slice::from_ref(&remove)).unwrap();
        let path = path.to_str().unwrap();
        let dotted = format!("{}/./a.glb", folder.path().display());
        for outside in [dotted.as_str(), &format!("file://{path}"), "a.glb", other.to_str().unwrap()] {
            assert_eq!(editor.apply(&add(outside)).unwrap_err().code, "outside-asset-roots", "{outside}");
        }
        editor.apply(&add(path)).unwrap();
        // Another configuration, another word; one that is refused says nothing.
        let empty = lantern_config::Scene::default();
        editor.reconfigure(&config, elsewhere.path().join("x").as_path(), Limits::default(), vec![]).unwrap_err();
        editor.apply(&edits(json!([{"remove": {"node": "b"}}]))).unwrap();
        editor.apply(&add(path)).unwrap();
        editor.reconfigure(&empty, folder.path(), Limits::default(), vec![]).unwrap();
        assert_eq!(editor.apply(&add(path)).unwrap_err().code, "outside-asset-roots");
    }

    // A link that took the file's place does not lead out.
    let mut editor = Editor::from_config(&config, folder.path(), Limits::default(), vec![]).unwrap();
    std::fs::remove_file(&path).unwrap();
    std::os::unix::fs::symlink(elsewhere.path().join("a.glb"), &path).unwrap();
    assert_eq!(editor.apply(&add(path.to_str().unwrap())).unwrap_err().code, "outside-asset-roots");
}

#[test]
fn a_changed_file_is_loaded_anew_and_an_unchanged_one_shared() {
    let (folder, mut editor) = studio();
    let scene = editor
        .apply(&edits(json!([{"add": {"node": "a", "uri": "a.glb"}}, {"add": {"node": "b", "uri": "./a.glb"}}])))
        .unwrap();
    assert_eq!((scene.meshes.len(), scene.instances.len()), (2, 6));
    let mut sample = Sample::new();
    sample.json["materials"][0]["name"] = json!("another name for it");
    sample.write(&folder);
    let scene = editor.apply(&edits(json!([{"add": {"node": "c", "uri": "a.glb"}}]))).unwrap();
    assert!(scene.nodes[2].material_names().any(|name| name == "another name for it"));
    assert_eq!(scene.meshes.len(), 4);
}
