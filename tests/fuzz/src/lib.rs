//! What the fuzzers share.

pub mod tracker;
