//! What every protocol is to the rest: datagrams in, readings out.

use glam::{DQuat, DVec3};

/// What one datagram says of one body, in the tracker's own frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Reading {
    /// The tracker's number of the body.
    pub(crate) body_id: u16,
    /// Grows and wraps.
    pub(crate) sequence: u32,
    /// ns on the sender's own clock.
    pub(crate) measured_ns: Option<u64>,
    /// m.
    pub(crate) position_m: Option<DVec3>,
    /// Tracker from body; its norm is 1.
    pub(crate) orientation: Option<DQuat>,
    /// m/s.
    pub(crate) velocity_m_s: Option<DVec3>,
}

/// One protocol.
pub(crate) trait Protocol: Send {
    /// Reads a datagram.
    ///
    /// # Errors
    /// Why it is none of this protocol's, in words.
    fn read(&mut self, datagram: &[u8]) -> Result<Reading, String>;
}
