//! Edits of the scene, and the roles that its nodes play.

use crate::color::{Color, ColorAlpha};
use serde::{Deserialize, Serialize};

/// What a node is in the room (CONTRACT, "Roles").
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// A white physical thing: primary rays hit and shade it.
    #[default]
    Prop,
    /// Nothing is there physically: only secondary and eye rays hit it.
    Virtual,
    /// Owned by the rasteriser: no ray hits it.
    Raster,
    /// Physical, and must stay dark: primary rays hit it and leave it black.
    Mask,
}

impl Role {
    /// The role's name on the wire.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Prop => "prop",
            Self::Virtual => "virtual",
            Self::Raster => "raster",
            Self::Mask => "mask",
        }
    }
}

/// One change of the scene. A list of them is applied all or not at all.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Edit {
    /// A new node.
    Add(Add),
    /// A node goes.
    Remove(Remove),
    /// A node's placement, role or visibility.
    Set(Set),
    /// A material's parameters, by name.
    Material(Material),
    /// A light, by name: made, changed or removed.
    Light(Light),
    /// What a miss sees.
    Environment(Environment),
    /// New positions for a mesh's vertices.
    Vertices(Vertices),
}

/// Adds a node that does not exist yet.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Add {
    /// The new node's name; unique in the scene.
    pub node: String,
    /// Its geometry: a path or one of the built-in `lantern:` shapes.
    pub uri: String,
    /// Absent: as the file says, else `prop`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub role: Option<Role>,
    /// Metres; absent: the origin.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub translation_m: Option<[f64; 3]>,
    /// Unit quaternion; absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<[f64; 4]>,
    /// Factor an axis; absent: 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<[f64; 3]>,
}

/// Removes a node.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Remove {
    /// The node's name.
    pub node: String,
}

/// Changes what it names of a node, and leaves the rest.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Set {
    /// The node's name.
    pub node: String,
    /// Metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub translation_m: Option<[f64; 3]>,
    /// Unit quaternion.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<[f64; 4]>,
    /// Factor an axis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<[f64; 3]>,
    /// The new role, of all its parts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub role: Option<Role>,
    /// Whether anything sees it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub visible: Option<bool>,
}

/// Changes what it names of a material, and leaves the rest. Parameters are glTF's (2.0 and its KHR extensions).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// The material's name.
    pub name: String,
    /// Linear RGB and alpha.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_color: Option<ColorAlpha>,
    /// 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metallic: Option<f64>,
    /// Perceptual, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roughness: Option<f64>,
    /// Linear RGB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emissive: Option<Color>,
    /// 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transmission: Option<f64>,
    /// Above 0: a closed body that refracts; 0: a thin sheet.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thickness: Option<f64>,
    /// Index of refraction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ior: Option<f64>,
    /// 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clearcoat: Option<f64>,
    /// Perceptual, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clearcoat_roughness: Option<f64>,
}

/// The kinds of light of KHR_lights_punctual.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LightKind {
    /// Parallel rays along `direction`; intensity in lux.
    Directional,
    /// From `position_m` everywhere; intensity in candela.
    Point,
    /// From `position_m` into a cone around `direction`; intensity in candela.
    Spot,
}

/// Makes, changes or removes a light.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Light {
    /// The light's name.
    pub name: String,
    /// Required for a new light; may be absent where the light exists or `remove` is true.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kind: Option<LightKind>,
    /// Metres; of no meaning to a directional light.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position_m: Option<[f64; 3]>,
    /// The way that its light travels; of no meaning to a point light. Any length but 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction: Option<[f64; 3]>,
    /// Linear RGB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color: Option<Color>,
    /// Lux (directional) or candela (point and spot).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub intensity: Option<f64>,
    /// A spot's cone inside which its light is full, from its axis. Our addition to the contract.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inner_cone_rad: Option<f64>,
    /// A spot's cone outside which there is no light, from its axis. Our addition to the contract.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outer_cone_rad: Option<f64>,
    /// True: the light goes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remove: Option<bool>,
}

/// What a miss sees: exactly one of the two.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Environment {
    /// An equirectangular map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uri: Option<String>,
    /// The same colour everywhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color: Option<Color>,
}

/// New positions for the vertices of one mesh; their count may not change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vertices {
    /// The node's name.
    pub node: String,
    /// The mesh of that node's file.
    pub mesh: MeshRef,
    /// Metres, in the mesh's own frame.
    pub positions_m: Vec<[f32; 3]>,
}

/// A mesh of a file, by index or by name.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum MeshRef {
    /// Position in the file's list of meshes.
    Index(u32),
    /// The mesh's own name.
    Name(String),
}
