//! A kept scene that somebody else has written, and a configuration.

use std::path::Path;

use lantern::service::state::{document, format};
use lantern_config::{Config, Scene, state_dir_of};

/// Reads a file as a kept scene: as it is where the first byte is even, else with a head that says it is whole.
///
/// # Panics
/// Where what is taken cannot be written and read again.
pub fn read(data: &[u8]) {
    let Some((&first, body)) = data.split_first() else { return };
    let file = if first % 2 == 0 { body.to_vec() } else { document::seal("lantern scene", format::VERSION, body) };
    let scene = Scene::default();
    let Ok(state) = format::read(&file, &scene) else { return };
    let written = format::write(&state, 1 << 30).expect("it can be written");
    assert_eq!(format::read(&written, &scene).expect("and read"), state);
}

/// Reads a text as a configuration.
///
/// # Panics
/// Where a problem does not say where it is and what to do, or one that is taken says nothing of its state.
pub fn configure(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let base_dir = Path::new("/nowhere");
    let state_dir = state_dir_of(text, base_dir);
    match Config::parse(text, "fuzz.toml", base_dir) {
        Ok(config) => {
            assert_eq!(config.daemon.state_dir, state_dir, "the state is looked for where it is not kept");
            assert_eq!(config.scene.fingerprint().len(), 64);
        }
        Err(problems) => {
            assert!(!problems.is_empty());
            let lines = text.split('\n').count();
            for problem in problems {
                assert!(problem.line <= lines && !problem.hint.is_empty() && !problem.message.is_empty(), "{problem}");
            }
        }
    }
}
