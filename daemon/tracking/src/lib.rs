//! Trackers: UDP sources, bodies and their poses.
//!
//! A [`Trackers`] listens, one task a tracker; what it hears it puts into [`Bodies`], which whoever renders reads as late
//! as it can. Nobody waits for the network: reading a body takes a short lock that is never held across a read of a
//! socket, and a change calls a waker.
//!
//! Knows nothing of scenes or of Vulkan. One protocol a file; `lantern` is the only one yet.

mod bodies;
mod counters;
mod lantern;
mod pose;
mod protocol;
mod source;
mod trackers;

pub use bodies::{Bodies, PoseError};
pub use pose::BodyPose;
pub use trackers::{TrackerError, Trackers};
