//! What the tests of files share: a projector of a configuration, and what is said when it has no calibration.
#![expect(clippy::unwrap_used, reason = "tests' helpers: what is given to them must be taken")]
#![allow(dead_code, reason = "each test has its own copy and uses a part of it")]

use std::path::{Path, PathBuf};

use glam::UVec2;
use lantern_calibration::{Calibration, Frustum};
use lantern_config::{Config, Projector};

/// Files of our own making.
pub(crate) fn fixture(name: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/formats")).join(name)
}

/// Files of others, where they are.
pub(crate) fn shared(name: &str) -> Option<PathBuf> {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/calibrations")).join(name);
    if !path.is_file() {
        println!("skipped, since there is no shared/data beside the checkout: {name}");
        return None;
    }
    Some(path)
}

/// A projector whose calibration is a file, with further keys.
pub(crate) fn projector(path: &Path, format: &str, size_px: UVec2, keys: &str) -> Projector {
    let text = format!(
        "[[projector]]\nname = \"left\"\nresolution_px = [{}, {}]\n[projector.calibration]\nfile = {:?}\nformat = {format:?}\n{keys}\n",
        size_px.x, size_px.y, path,
    );
    let config = Config::parse(&text, "lab.toml", Path::new("."));
    config.unwrap_or_else(|problems| panic!("{problems:?}\n{text}")).projectors.remove(0)
}

/// Its frustum.
pub(crate) fn load(path: &Path, format: &str, size_px: UVec2, keys: &str) -> Frustum {
    let calibration = Calibration::from_config(&projector(path, format, size_px, keys));
    Frustum::new(calibration.unwrap_or_else(|error| panic!("{error}")))
}

/// What is said where it has none.
pub(crate) fn refused(path: &Path, format: &str, size_px: UVec2, keys: &str) -> String {
    match Calibration::from_config(&projector(path, format, size_px, keys)) {
        Ok(_) => panic!("{} is taken with {keys}", path.display()),
        Err(error) => error.to_string(),
    }
}

/// A text as a file in a folder that goes with the returned guard.
pub(crate) fn file(text: impl AsRef<[u8]>) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("projector");
    std::fs::write(&path, text).unwrap();
    (folder, path)
}
