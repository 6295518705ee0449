//! Scenes that a fuzzer has made up, and what must hold of every one.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use lantern_proto::{Add, Edit};
use lantern_scene::{Editor, Limits, Scene};
use tempfile::TempDir;

/// So little that an input is over soon, whatever it asks for.
const LIMITS: Limits =
    Limits { max_file_bytes: 1 << 20, max_triangles: 3000, max_texels: 1 << 16, max_nodes: 200, max_lights: 16 };

/// A folder of the process, in memory where there is such a place.
pub fn folder() -> &'static Path {
    static FOLDER: OnceLock<TempDir> = OnceLock::new();
    let made = || {
        let memory = Path::new("/dev/shm");
        if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() }
    };
    FOLDER.get_or_init(|| made().expect("a folder")).path()
}

fn add(node: &str, uri: &str) -> Edit {
    Edit::Add(Add { node: node.into(), uri: uri.into(), ..Add::default() })
}

/// A small scene; files may be read from the folder alone.
pub fn editor() -> Editor {
    let mut editor = Editor::new(LIMITS, vec![folder().to_owned()]);
    editor.apply(&[add("floor", "lantern:quad"), add("box", "lantern:cube")]).expect("the fuzzer's own scene");
    editor
}

/// The file of a format, as a node of a scene.
///
/// # Panics
/// Where it is taken and is not sound, or refused without saying what to do.
pub fn load(extension: &str, data: &[u8]) {
    static NAMES: OnceLock<[PathBuf; 2]> = OnceLock::new();
    let names = NAMES.get_or_init(|| ["glb", "gltf"].map(|extension| folder().join("model").with_extension(extension)));
    let path = names.iter().find(|name| name.extension().is_some_and(|e| e == extension)).expect("one of the two");
    fs::write(path, data).expect("the fuzzer's own file");
    let mut editor = editor();
    match editor.apply(&[add("model", &path.to_string_lossy())]) {
        Ok(scene) => {
            is_sound(&scene);
            is_restored(&editor);
        }
        Err(error) => {
            assert!(error.message.contains("hint:"), "{}: {}", error.code, error.message);
            assert_eq!(editor.current().nodes.len(), 2, "a refused file has changed the scene");
        }
    }
}

/// Every corner of every triangle is somewhere.
fn is_sound(scene: &Scene) {
    assert!(scene.triangle_count() <= LIMITS.max_triangles);
    for node in 0..scene.nodes.len() {
        if let Some((low_m, high_m)) = scene.bounds_of(node) {
            assert!(low_m.is_finite() && high_m.is_finite() && low_m.cmple(high_m).all(), "{low_m} {high_m}");
        }
    }
}

/// What is kept of a scene brings it back.
///
/// # Panics
/// Where it does not.
pub fn is_restored(editor: &Editor) {
    let scene = editor.current();
    is_sound(&scene);
    let kept = scene.edits();
    let written = serde_json::to_vec(&kept).expect("edits can be written");
    let read: Vec<Edit> = serde_json::from_slice(&written).expect("and read");
    let mut again = Editor::new(LIMITS, vec![folder().to_owned()]);
    again.learn_from(editor);
    let restored = again.restore(&read).unwrap_or_else(|error| panic!("what was kept is refused: {error}\n{kept:?}"));
    assert_eq!(restored.edits(), kept);
    assert_eq!(restored.triangle_count(), scene.triangle_count());
}
