//! Metrics: every number of `status`, for Prometheus and whoever reads its text, over HTTP on the loopback.
//!
//! - `server`: who may ask, how often, and how long;
//! - `families`: what each number of `status` is called there;
//! - `text`: Prometheus' text format.
//!
//! A scrape asks what `status` asks, on a thread that may wait; no frame waits for it.

mod families;
mod server;
mod text;

pub use server::{MetricsError, Server};
