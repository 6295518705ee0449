//! The pose of a body, and what makes one acceptable.

use glam::{DQuat, DVec3};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The source of a pose that nobody has said yet.
pub(crate) const SOURCE_CONFIG: &str = "config";

/// The farthest from the world's origin that anything is believed to be, along each axis, m: beyond it single precision
/// keeps nothing of a room.
pub(crate) const MAX_DISTANCE_M: f64 = 1e8;

/// The fastest that anything is believed to be, m/s: beyond it a tracker's numbers are none of a room.
const MAX_SPEED_M_S: f64 = 1e3;

/// Where a body is, as last said by anyone.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyPose {
    /// The tracked point in the world, m.
    pub position_m: DVec3,
    /// World from body; its norm is 1.
    pub orientation: DQuat,
    /// In the world, m/s; `None` until a source says it.
    pub velocity_m_s: Option<DVec3>,
    /// From the tracked point to what the body drives, in the body's frame, m.
    pub offset_m: DVec3,
    /// The tracker's name, `socket`, or `config` until anyone speaks.
    pub source: Arc<str>,
    /// When it was heard.
    pub received: Instant,
    /// The packet's number, where the source numbers its packets.
    pub sequence: Option<u32>,
    /// When it was measured, ns on the source's own clock, where the source says.
    pub measured_ns: Option<u64>,
    /// The same on our clock, where the source says: estimated, and never after it was heard.
    pub measured: Option<Instant>,
}

impl BodyPose {
    /// Whether anybody has said it, other than the configuration.
    pub fn is_heard(&self) -> bool {
        &*self.source != SOURCE_CONFIG
    }

    /// What the body drives, the viewer's eye or a node's origin, in the world, m.
    pub fn driven_m(&self) -> DVec3 {
        self.position_m + self.orientation * self.offset_m
    }
}

/// Finite, and within what single precision can hold a room at.
pub(crate) fn is_place(position_m: DVec3) -> bool {
    position_m.to_array().iter().all(|x| x.abs() <= MAX_DISTANCE_M)
}

/// Finite, and of something that moves in a room.
pub(crate) fn is_velocity(velocity_m_s: DVec3) -> bool {
    velocity_m_s.length() <= MAX_SPEED_M_S
}

/// What a source says of a body, in the world's frame; what it does not say stays as it was.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Update {
    /// m.
    pub(crate) position_m: Option<DVec3>,
    /// World from body; its norm is 1.
    pub(crate) orientation: Option<DQuat>,
    /// m/s.
    pub(crate) velocity_m_s: Option<DVec3>,
    pub(crate) sequence: Option<u32>,
    pub(crate) measured_ns: Option<u64>,
    pub(crate) timing: Timing,
}

/// What the times of a pose are, on our clock.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Timing {
    /// When it was measured, where that is known.
    pub(crate) measured: Option<Instant>,
    /// The same on the sender's own clock, ns, where that goes as ours does.
    pub(crate) sender_ns: Option<u64>,
    /// Where poses are to be predicted: how old they are at least when they are heard.
    pub(crate) predict_lead: Option<Duration>,
}
