//! What every protocol is to the rest: datagrams in, readings out.

use glam::{DQuat, DVec3};
use std::fmt;
use std::net::{IpAddr, SocketAddr};
use std::time::Instant;

/// How far a quaternion's norm may be from 1.
pub(crate) const NORM_TOLERANCE: f64 = 0.01;

/// The tracker's own word for a body.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum BodyId {
    /// The one that there is: the protocol knows no others.
    Only,
    /// Where bodies are numbered.
    Number(u32),
    /// Where they are named.
    Name(Box<str>),
}

impl BodyId {
    /// Digits are a number, whoever sends them, so that a sender's "7" and 7 are the same body.
    pub(crate) fn parse(text: &str) -> Self {
        let number = text.parse::<u32>().ok().filter(|number| number.to_string() == text);
        number.map_or_else(|| Self::Name(text.into()), Self::Number)
    }
}

impl fmt::Display for BodyId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Only => f.write_str("the only one"),
            Self::Number(number) => number.fmt(f),
            Self::Name(name) => name.fmt(f),
        }
    }
}

/// What a datagram says of one body, in the tracker's own frame but for axes and units: right-handed, +Y up, m.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Reading {
    /// Whom it is about.
    pub(crate) body: BodyId,
    /// Grows and wraps, for each body by itself; where all bodies share a number, [`Heard::frame`] has it.
    pub(crate) sequence: Option<u32>,
    /// ns on the sender's own clock.
    pub(crate) measured_ns: Option<u64>,
    /// m. Of a body that the tracker sees no more, neither this nor `orientation` is there.
    pub(crate) position_m: Option<DVec3>,
    /// Tracker from body; its norm is 1.
    pub(crate) orientation: Option<DQuat>,
    /// m/s.
    pub(crate) velocity_m_s: Option<DVec3>,
}

impl Reading {
    /// Of a body that nothing is known of but that the tracker knows it.
    pub(crate) fn of(body: BodyId) -> Self {
        Self { body, sequence: None, measured_ns: None, position_m: None, orientation: None, velocity_m_s: None }
    }
}

/// What one datagram, and those before it that waited for it, say.
#[derive(Debug, Default)]
pub(crate) struct Heard {
    /// In the order of the datagram.
    pub(crate) readings: Vec<Reading>,
    /// The number of the frame that they belong to; grows and wraps, and starts anew with the sender.
    pub(crate) frame: Option<u32>,
    /// Whether every body that the tracker sees is among the readings, so that another is not seen.
    pub(crate) is_everything: bool,
    /// Frames that ended before all of their datagrams came.
    pub(crate) incomplete_frames: u64,
}

impl Heard {
    /// As if nothing had been heard.
    pub(crate) fn clear(&mut self) {
        let mut readings = std::mem::take(&mut self.readings);
        readings.clear();
        *self = Self { readings, ..Self::default() };
    }
}

/// Why a datagram moves nothing.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Refusal {
    /// It is none of this protocol's, or broken.
    #[error("{0}")]
    Bad(String),
    /// It is good, and not newer than what is known.
    #[error("old: {0}")]
    Old(String),
    /// It is good, and about something else than bodies.
    #[error("{0}")]
    Other(String),
}

/// Something that a protocol wants to have sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Saying {
    pub(crate) to: SocketAddr,
    pub(crate) datagram: Vec<u8>,
}

/// One protocol.
pub(crate) trait Protocol: Send {
    /// Reads a datagram from an allowed sender, received `at` a time, and puts what it says into `heard`, which is empty. What is there after
    /// an error does not count.
    ///
    /// # Errors
    /// Why it moves nothing, in words.
    fn read(&mut self, datagram: &[u8], from: SocketAddr, at: Instant, heard: &mut Heard) -> Result<(), Refusal>;

    /// What is to be sent now, if anything; asked twice a second.
    fn say(&mut self, _now: Instant) -> Vec<Saying> {
        Vec::new()
    }
}

/// An IPv4 address written as such, also where a socket of both families has it within IPv6.
pub(crate) fn canonical(address: SocketAddr) -> SocketAddr {
    match address.ip().to_canonical() {
        ip @ IpAddr::V4(_) => SocketAddr::new(ip, address.port()),
        // Its scope belongs to it.
        IpAddr::V6(_) => address,
    }
}

/// A time of a sender's clock, ns; one that is before its clock's start, or no number, is none.
pub(crate) fn ns_of(time_s: f64) -> Option<u64> {
    (time_s.is_finite() && time_s >= 0.0).then(|| (time_s * 1e9).round() as u64)
}

/// A refusal of a broken datagram.
pub(crate) fn bad<T>(reason: impl Into<String>) -> Result<T, Refusal> {
    Err(Refusal::Bad(reason.into()))
}

/// A position or velocity that is one.
pub(crate) fn finite(v: DVec3, what: &str) -> Result<DVec3, Refusal> {
    if v.is_finite() { Ok(v) } else { bad(format!("non-finite {what}")) }
}

/// A quaternion whose norm is off by 1 % at most, set right: rotations must not scale.
pub(crate) fn unit(q: DQuat) -> Result<DQuat, Refusal> {
    if !q.is_finite() {
        return bad("non-finite orientation");
    }
    let norm = q.length();
    if (norm - 1.0).abs() > NORM_TOLERANCE {
        return bad(format!("quaternion norm {norm:.4} is off by more than 1 %"));
    }
    Ok(q.normalize())
}
