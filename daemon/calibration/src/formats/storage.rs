//! What stands in an OpenCV FileStorage, whichever of its three syntaxes it is written in.

use serde_json::Value;

use super::text::{malformed, number};
use super::{FileError, json, limits, storage_xml, storage_yaml};

/// A node of the tree.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Node {
    /// Names and what stands under them, in the file's order.
    Map(Vec<(String, Node)>),
    /// A list.
    List(Vec<Node>),
    /// A number or a word; of a matrix in XML all of its numbers.
    Text(String),
}

/// A matrix, by rows.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Matrix {
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) data: Vec<f64>,
}

/// Reads a file in the syntax that its first characters tell.
pub(super) fn parse(text: &str) -> Result<Node, FileError> {
    match text.trim_start().as_bytes().first() {
        Some(b'<') => storage_xml::parse(text),
        Some(b'{') => Ok(from_json(&json::parse(text, "OpenCV FileStorage (JSON)")?)),
        _ => storage_yaml::parse(text),
    }
}

/// The depth of JSON is bounded by its parser.
fn from_json(value: &Value) -> Node {
    match value {
        Value::Object(map) => Node::Map(map.iter().map(|(name, value)| (name.clone(), from_json(value))).collect()),
        Value::Array(items) => Node::List(items.iter().map(from_json).collect()),
        Value::String(text) => Node::Text(text.clone()),
        other => Node::Text(other.to_string()),
    }
}

impl Node {
    /// What stands under a name.
    pub(super) fn get(&self, name: &str) -> Option<&Self> {
        match self {
            Self::Map(entries) => entries.iter().find(|(entry, _)| entry == name).map(|(_, node)| node),
            Self::List(_) | Self::Text(_) => None,
        }
    }

    /// The maps that stand in a map, by name.
    pub(super) fn maps(&self) -> impl Iterator<Item = (&str, &Self)> {
        let entries = match self {
            Self::Map(entries) => entries.as_slice(),
            Self::List(_) | Self::Text(_) => &[],
        };
        entries.iter().filter(|(_, node)| matches!(node, Self::Map(_))).map(|(name, node)| (name.as_str(), node))
    }

    /// A whole number from 1.
    pub(super) fn count(&self, what: &str) -> Result<u32, FileError> {
        let count = number(self.text(what)?, FORMAT, what)?;
        if count.fract() != 0.0 || !(1.0..=f64::from(limits::NODES)).contains(&count) {
            return Err(malformed(FORMAT, format!("{what} is {count}")));
        }
        // Whole and in range, so the conversion is exact.
        Ok(count as u32)
    }

    fn text(&self, what: &str) -> Result<&str, FileError> {
        match self {
            Self::Text(text) => Ok(text),
            Self::Map(_) | Self::List(_) => Err(malformed(FORMAT, format!("{what} is no number"))),
        }
    }

    /// An `opencv-matrix`.
    pub(super) fn matrix(&self, name: &str) -> Result<Matrix, FileError> {
        let part = |key: &str| self.get(key).ok_or_else(|| malformed(FORMAT, format!("{name} has no {key}")));
        let side = |key: &str| part(key)?.count(&format!("{name}.{key}")).map(|side| side as usize);
        let (rows, columns) = (side("rows")?, side("cols")?);
        let what = format!("an entry of {name}.data");
        let data: Vec<f64> = match part("data")? {
            Self::Text(text) => {
                text.split_whitespace().map(|entry| number(entry, FORMAT, &what)).collect::<Result<_, _>>()?
            }
            Self::List(items) => {
                items.iter().map(|item| number(item.text(&what)?, FORMAT, &what)).collect::<Result<_, _>>()?
            }
            Self::Map(_) => return Err(malformed(FORMAT, format!("{name}.data is no list of numbers"))),
        };
        if data.len() != rows * columns {
            let message = format!("{name} is said to be {rows} × {columns}, and has {} numbers", data.len());
            return Err(malformed(FORMAT, message));
        }
        Ok(Matrix { rows, columns, data })
    }
}

pub(super) const FORMAT: &str = "OpenCV FileStorage";
