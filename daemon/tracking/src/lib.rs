//! Trackers: UDP sources, bodies and their poses.
//!
//! A [`Trackers`] listens, one task a tracker; what it hears it puts into [`Bodies`], which whoever renders reads as late
//! as it can. Nobody waits for the network: reading a body takes a short lock that is never held across a read of a
//! socket, and a change calls a waker. Poses are told of the time at which the light of a frame leaves the projector, as far as
//! they are to be predicted.
//!
//! Knows nothing of scenes or of Vulkan. One protocol a file; `lantern` is the only one yet.

mod bodies;
mod clock;
mod counters;
mod kalman;
mod lantern;
#[cfg(test)]
mod paths_tests;
mod pose;
mod predict;
mod protocol;
mod source;
mod trackers;

pub use bodies::{Bodies, Placed, PoseError};
pub use pose::BodyPose;
pub use trackers::{TrackerError, Trackers};
