//! One file a group of sections: from tables to the types, all problems noted on the way.
//!
//! A reader that could not read a required thing gives `None` after it has noted why; it reads everything else first.

pub(crate) mod daemon;
pub(crate) mod projector;
mod protocol;
pub(crate) mod scene;
pub(crate) mod tracking;

use crate::reader::{Table, Value};
use std::collections::HashSet;

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
