//! What the fuzzers share.

pub mod calibration;
pub mod tracker;
