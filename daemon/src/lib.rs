//! Lanternd, the render daemon, and lanternctl, the operator's hand.
//!
//! - [`program`]: what `lanternd` can be asked to do;
//! - [`service`]: the daemon at work;
//! - [`control`]: the control socket;
//! - [`log`]: where the log goes;
//! - [`metrics`]: numbers for Prometheus;
//! - [`ctl`]: what `lanternctl` is;
//! - [`output`]: where an image goes, and when it is due;
//! - [`encode`]: layers as files.

pub mod control;
pub mod ctl;
pub mod encode;
pub mod feed;
pub mod log;
pub mod metrics;
pub mod output;
pub mod program;
pub mod service;
pub mod socket_path;
