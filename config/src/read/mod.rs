//! One file a group of sections: from tables to the types, all problems noted on the way.
//!
//! A reader that could not read a required thing gives `None` after it has noted why; it reads everything else first.

mod calibration;
pub(crate) mod daemon;
pub(crate) mod metrics;
pub(crate) mod projector;
mod protocol;
pub(crate) mod scene;
pub(crate) mod tracking;

use crate::calibration::Matrix4;
use crate::reader::{Table, Value};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// No change of frame.
const IDENTITY: Matrix4 = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

/// A required `name` that no earlier table of the list has. The table's places are noted under `kind` and that name.
fn unique_name(table: &Table<'_>, kind: &str, taken: &mut HashSet<String>, example: &str) -> Option<String> {
    let value = table.required("name", example)?;
    let name = value.name()?;
    if !taken.insert(name.clone()) {
        value.problem(format!("the name `{name}` is taken already"), "give each its own name");
        return None;
    }
    table.note_places(&format!("{kind} {name:?}"));
    Some(name)
}

/// A name that must be among `known`.
fn known_name(value: &Value<'_>, name: &str, known: &HashSet<String>, what: &str, how: &str) -> bool {
    if known.contains(name) {
        return true;
    }
    let mut names: Vec<_> = known.iter().map(|name| format!("`{name}`")).collect();
    names.sort_unstable();
    let hint = if names.is_empty() { how.to_owned() } else { format!("there are {}; or {how}", names.join(", ")) };
    value.problem(format!("there is no {what} `{name}`"), hint);
    false
}

/// A path that may be relative to the configuration's folder.
fn path(value: &Value<'_>, base_dir: &Path) -> Option<PathBuf> {
    let text = value.string()?;
    if text.is_empty() || text.contains('\0') {
        value.problem(format!("`{}` is no path", value.path), "name a path, or leave the key out");
        return None;
    }
    Some(base_dir.join(text))
}

/// A matrix that keeps the shape of things: a rotation, a translation and one scale for all axes; with `mirroring`, a
/// reflection too.
fn similarity(value: &Value<'_>, mirroring: bool, hint: &str) -> Option<Matrix4> {
    let matrix = value.matrix()?;
    let [x, y, z] = [0, 1, 2].map(|column| glam::DVec3::from_array([0, 1, 2].map(|row: usize| matrix[row][column])));
    let scale = x.length();
    let even = |length: f64| (length / scale - 1.0).abs() < 1e-3;
    let square = |dot: f64| (dot / (scale * scale)).abs() < 1e-3;
    let keeps_shape = even(y.length()) && even(z.length()) && square(x.dot(y)) && square(y.dot(z)) && square(z.dot(x));
    if matrix[3] != [0.0, 0.0, 0.0, 1.0] || !keeps_shape || (!mirroring && x.cross(y).dot(z) <= 0.0) {
        let wrongs = if mirroring { "bends or stretches" } else { "bends, stretches or mirrors" };
        value.problem(format!("`{}` {wrongs} space", value.path), hint);
        return None;
    }
    Some(matrix)
}
