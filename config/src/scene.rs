//! The `[scene]` section in memory, and its fingerprint.

use serde::Serialize;
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::fmt::Write;

/// What there is to see. Fields that were not written are `None`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Scene {
    /// What a miss sees; `None`: black.
    pub environment: Option<Environment>,
    /// `[[scene.node]]`, in the file's order; names are unique.
    pub nodes: Vec<SceneNode>,
    /// `[[scene.material]]`; names are unique.
    pub materials: Vec<SceneMaterial>,
    /// `[[scene.light]]`; names are unique.
    pub lights: Vec<SceneLight>,
}

impl Scene {
    /// A hash of everything in it: equal scenes have equal fingerprints, on every machine and in every release, also in one that
    /// knows more keys, as long as nobody has written them: what is `None` or empty does not count. 64 hexadecimal digits, SHA-256
    /// of its JSON.
    ///
    /// A state store keeps it beside what it stores, to know whether the configuration has changed since.
    pub fn fingerprint(&self) -> String {
        // Fields are written in the order of their declaration and numbers in their shortest form, so the text is canonical without
        // sorting. Numbers, texts and lists of them can be written, and have no other way to fail.
        sha256(&serde_json::to_value(self).map(written).unwrap_or_default().to_string())
    }

    /// As [`Scene::fingerprint`] was in the first version of the kept state, which counted what is not written as well; for
    /// states of that version alone. A new field of a scene is left out where it is `None`, so that this stays what it was.
    pub fn fingerprint_with_nulls(&self) -> String {
        sha256(&serde_json::to_string(self).unwrap_or_default())
    }
}

/// What somebody wrote of a value: no nulls, and no lists that are empty.
fn written(value: Value) -> Value {
    match value {
        Value::Object(map) => {
            let kept = map.into_iter().map(|(key, value)| (key, written(value)));
            Value::Object(kept.filter(|(_, value)| !value.is_null() && *value != Value::Array(vec![])).collect())
        }
        Value::Array(items) => Value::Array(items.into_iter().map(written).collect()),
        other => other,
    }
}

fn sha256(text: &str) -> String {
    Sha256::digest(text).iter().fold(String::with_capacity(64), |mut hex, byte| {
        // Writing to a String cannot fail.
        let _ = write!(hex, "{byte:02x}");
        hex
    })
}

/// What a miss sees.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Environment {
    /// An equirectangular map: a path relative to the file, or a built-in `lantern:` one.
    Uri(String),
    /// `#rrggbb`, sRGB; six hexadecimal digits are sure to follow the `#`.
    Color(String),
}

/// What a node is in the room.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// A white physical thing.
    Prop,
    /// Nothing is there physically.
    Virtual,
    /// Owned by the rasteriser.
    Raster,
    /// Physical, must stay dark.
    Mask,
}

/// `[[scene.node]]`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneNode {
    /// Unique among nodes.
    pub name: String,
    /// A path relative to the file, or a built-in `lantern:` shape.
    pub uri: String,
    /// `None`: as the file says, else prop.
    pub role: Option<Role>,
    /// Metres.
    pub translation_m: Option<[f64; 3]>,
    /// A quaternion of norm 1.
    pub rotation: Option<[f64; 4]>,
    /// None of them 0.
    pub scale: Option<[f64; 3]>,
}

/// `[[scene.material]]`: the fields of the `material` edit; ranges are glTF's.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SceneMaterial {
    /// Which material.
    pub name: String,
    /// Linear RGB and alpha, each from 0 to 1.
    pub base_color: Option<[f64; 4]>,
    /// 0 to 1.
    pub metallic: Option<f64>,
    /// 0 to 1.
    pub roughness: Option<f64>,
    /// Linear RGB, at least 0.
    pub emissive: Option<[f64; 3]>,
    /// 0 to 1.
    pub transmission: Option<f64>,
    /// At least 0.
    pub thickness: Option<f64>,
    /// At least 1.
    pub ior: Option<f64>,
    /// 0 to 1.
    pub clearcoat: Option<f64>,
    /// 0 to 1.
    pub clearcoat_roughness: Option<f64>,
}

/// Kinds of light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LightKind {
    /// Parallel rays.
    Directional,
    /// From a point everywhere.
    Point,
    /// From a point into a cone.
    Spot,
}

/// `[[scene.light]]`: the fields of the `light` edit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneLight {
    /// Unique among lights.
    pub name: String,
    /// What it is.
    pub kind: LightKind,
    /// Metres; always there for point and spot lights.
    pub position_m: Option<[f64; 3]>,
    /// The way that its light travels, not zero; always there for directional and spot lights.
    pub direction: Option<[f64; 3]>,
    /// Linear RGB, at least 0.
    pub color: Option<[f64; 3]>,
    /// Lux (directional) or candela, at least 0.
    pub intensity: Option<f64>,
    /// From a spot's axis, at least 0 and less than the outer one.
    pub inner_cone_rad: Option<f64>,
    /// From a spot's axis, at most π/2.
    pub outer_cone_rad: Option<f64>,
}
