//! The daemon at work: lifecycle, the frame thread, what the threads share, and what survives.
//!
//! - [`lifecycle`]: start, signals, reload, stop;
//! - [`origin`]: the configuration's file, or what it last was;
//! - [`sources`]: what it is read from;
//! - [`last_good`]: what is kept of it;
//! - [`setup`]: from the configuration to the parts;
//! - [`frames`]: the frame thread, which alone talks to the device;
//! - [`lead`]: when the light of the frame that is being made leaves;
//! - [`hearsay`]: what subscribers are told of bodies and trackers;
//! - [`sight`]: the bodies as frames show them;
//! - [`ledger`]: how old their poses were;
//! - [`monotonic`]: moments as other programs can read them;
//! - [`shared`]: what other threads ask of it;
//! - [`background`]: the thread for what takes long;
//! - [`engine`]: the control socket's operations;
//! - [`stats`]: what `status` says about frames;
//! - [`panics`]: the end of a process that has a fault;
//! - [`state`]: the scene across restarts;
//! - [`systemd`]: what the service manager hears, and hands over;
//! - [`vulkan`]: the instance and the device.

pub mod background;
pub mod carried;
pub mod engine;
pub mod frames;
pub mod hearsay;
pub mod last_good;
pub mod lead;
pub mod ledger;
pub mod lifecycle;
pub mod monotonic;
pub mod origin;
pub mod panics;
pub mod setup;
pub mod shared;
pub mod sight;
pub mod sources;
pub mod state;
pub mod stats;
pub mod systemd;
pub mod vulkan;
