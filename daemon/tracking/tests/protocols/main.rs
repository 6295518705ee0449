//! Every protocol from its packets to the bodies, without sockets.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]

mod golden;
mod packets;
mod robust;
