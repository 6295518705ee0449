//! What the fuzzers share.

pub mod calibration;
pub mod scene;
pub mod socket;
pub mod state;
pub mod tracker;
