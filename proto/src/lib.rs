//! The wire's types: socket messages and the pose packet.
//!
//! Plain data and its reading, nothing else: no sockets, no scene. Both ends use it, so a message that one end writes is
//! a message that the other can read.
//!
//! World frame: right-handed, metres, +Y up. Quaternions are x, y, z, w. Vectors travel as arrays of `f64`.

pub mod color;
pub mod edit;
pub mod event;
pub mod parse;
pub mod pose_packet;
pub mod reply;
pub mod request;
pub mod status;

pub use color::{Color, ColorAlpha};
pub use edit::{Add, Edit, Environment, Light, LightKind, Material, MeshRef, Remove, Role, Set, Vertices};
pub use event::Event;
pub use parse::{Refusal, parse_line, parse_line_with};
pub use pose_packet::{POSE_PACKET_BYTES, PosePacket, PosePacketError};
pub use reply::{
    Applied, ErrorBody, ExportBuffer, ExportMemory, ExportOpened, ExportPlane, Hello, Outcome, Reloaded, Reply,
    SceneGet, SnapshotHead, Subscribed,
};
pub use request::{
    EventKind, ExportHandle, ExportOpen, ExportRelease, Id, Layer, Op, Pattern, PatternRequest, Pose, Request,
    SceneApply, Snapshot, Subscribe,
};
pub use status::Status;

/// The version of the socket protocol that `hello` answers.
pub const PROTOCOL: u32 = 1;

/// The longest line that either end may send, its newline excluded: 1 MiB.
pub const MAX_LINE_BYTES: usize = 1 << 20;
