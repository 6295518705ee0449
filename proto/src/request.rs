//! What a client asks.

use crate::edit::Edit;
use serde::{Deserialize, Serialize};

/// A request's number, given back in its reply exactly as it came.
pub type Id = serde_json::Number;

/// One line from a client.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Request {
    /// The client's own number for it.
    pub id: Id,
    /// What is asked.
    #[serde(flatten)]
    pub op: Op,
}

/// The ops of protocol 1. Reading them is [`parse_line`](crate::parse_line)'s, which says where a bad one is wrong.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "op")]
pub enum Op {
    /// Who is there.
    #[serde(rename = "hello")]
    Hello,
    /// How it goes.
    #[serde(rename = "status")]
    Status,
    /// The whole scene as edits that would rebuild it.
    #[serde(rename = "scene.get")]
    SceneGet,
    /// Change the scene, all or nothing.
    #[serde(rename = "scene.apply")]
    SceneApply(SceneApply),
    /// Place a body, as if a tracker had said it.
    #[serde(rename = "pose")]
    Pose(Pose),
    /// One layer of one projector's last frame.
    #[serde(rename = "snapshot")]
    Snapshot(Snapshot),
    /// Hear of events as they happen.
    #[serde(rename = "subscribe")]
    Subscribe(Subscribe),
    /// Show a test pattern instead of the scene.
    #[serde(rename = "pattern")]
    Pattern(PatternRequest),
    /// Have a projector's pictures in memory of its own, as descriptors.
    #[serde(rename = "export.open")]
    ExportOpen(ExportOpen),
    /// Give one of them back.
    #[serde(rename = "export.release")]
    ExportRelease(ExportRelease),
    /// Read the configuration again, as SIGHUP does.
    #[serde(rename = "config.reload")]
    ConfigReload,
}

impl Op {
    /// The names of all ops, as on the wire.
    pub const NAMES: [&'static str; 11] = [
        "hello",
        "status",
        "scene.get",
        "scene.apply",
        "pose",
        "snapshot",
        "subscribe",
        "pattern",
        "export.open",
        "export.release",
        "config.reload",
    ];
}

/// The parameters of `scene.apply`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneApply {
    /// Applied in order, all or none.
    pub edits: Vec<Edit>,
    /// Answer only when the result would survive `kill -9`. The default.
    #[serde(default = "yes")]
    pub durable: bool,
}

fn yes() -> bool {
    true
}

/// The parameters of `pose`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    /// The body's name.
    pub body: String,
    /// World, m.
    pub position_m: [f64; 3],
    /// World from body, unit quaternion; absent: as it was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orientation: Option<[f64; 4]>,
}

/// The parameters of `snapshot`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Snapshot {
    /// The projector's name.
    pub projector: String,
    /// Absent: `color`.
    #[serde(default)]
    pub layer: Layer,
}

/// What a snapshot shows (CONTRACT, "Layers of a snapshot").
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Layer {
    /// PNG, 8-bit sRGB: exactly what the projector shows.
    #[default]
    Color,
    /// EXR, 3 × f32: linear colour before blending and response.
    Radiance,
    /// EXR, 1 × f32: along the primary ray to the closest hit, m; +inf is a miss.
    Distance,
    /// EXR, 1 × f32: the depth attachment; 1 is a miss.
    Depth,
    /// EXR, 1 × f32: index in `scene.get` order; −1 is a miss.
    Node,
    /// EXR, 1 × f32: the blend weight.
    Weight,
    /// PNG: what the viewer's eye sees of the lit props.
    Room,
}

impl Layer {
    /// All layers, in the contract's order.
    pub const ALL: [Self; 7] =
        [Self::Color, Self::Radiance, Self::Distance, Self::Depth, Self::Node, Self::Weight, Self::Room];

    /// The layer's name on the wire.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Color => "color",
            Self::Radiance => "radiance",
            Self::Distance => "distance",
            Self::Depth => "depth",
            Self::Node => "node",
            Self::Weight => "weight",
            Self::Room => "room",
        }
    }
}

/// The parameters of `subscribe`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Subscribe {
    /// What to hear of.
    pub events: Vec<EventKind>,
}

impl EventKind {
    /// All kinds.
    pub const ALL: [Self; 5] = [Self::Frame, Self::Pose, Self::Scene, Self::Tracker, Self::Output];

    /// The kind's name on the wire.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Frame => "frame",
            Self::Pose => "pose",
            Self::Scene => "scene",
            Self::Tracker => "tracker",
            Self::Output => "output",
        }
    }
}

/// What can be subscribed to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// A projector showed a frame.
    Frame,
    /// A body moved.
    Pose,
    /// The scene has a new revision.
    Scene,
    /// A tracker fell silent or spoke again.
    Tracker,
    /// An output was lost or came back.
    Output,
}

/// The parameters of `export.open`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExportOpen {
    /// The projector's name.
    pub projector: String,
    /// Absent: `opaque-fd`.
    #[serde(default)]
    pub handle: ExportHandle,
}

/// What kind of descriptor stands for memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExportHandle {
    /// One that the same driver alone imports.
    #[default]
    OpaqueFd,
    /// One of the kernel.
    DmaBuf,
}

/// The parameters of `export.release`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExportRelease {
    /// Which image, from 0.
    pub image: usize,
}

/// The parameters of `pattern`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PatternRequest {
    /// Absent: all projectors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub projector: Option<String>,
    /// Which one.
    pub name: Pattern,
}

/// Test patterns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pattern {
    /// Lines a pixel wide.
    Grid,
    /// All white.
    White,
    /// All black.
    Black,
    /// A chessboard.
    Checker,
    /// The projector's name.
    Identify,
    /// The scene again.
    Off,
}
