//! Trackers: UDP sources, bodies and their poses.
//!
//! A [`Trackers`] listens, one task a tracker; what it hears it puts into [`Bodies`], which whoever renders reads as late
//! as it can. Nobody waits for the network: reading a body takes a short lock that is never held across a read of a
//! socket, and a change calls a waker. Poses are told of the time at which the light of a frame leaves the projector, as far as
//! they are to be predicted.
//!
//! Knows nothing of scenes or of Vulkan. One protocol a file; [`Source`] is a tracker without its socket, for whoever has
//! datagrams from elsewhere.

mod axes;
mod bodies;
mod bytes;
mod clock;
mod counters;
mod dtrack;
mod freed;
mod kalman;
mod lantern;
mod natnet;
mod natnet_server;
mod opentrack;
mod order;
mod osc;
mod osc_packet;
#[cfg(test)]
mod paths_tests;
mod pose;
mod predict;
mod protocol;
mod protocols;
mod psn;
mod socket;
mod source;
mod trackers;

pub use bodies::{Bodies, Placed, PoseError};
pub use pose::BodyPose;
pub use socket::TrackerError;
pub use source::Source;
pub use trackers::Trackers;
