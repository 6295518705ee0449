//! What `lanternd` can be asked to do, one file a subcommand.

pub mod bench;
pub mod check;
pub mod demo;
pub mod devices;
mod progress;
