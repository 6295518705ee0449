//! Work that was given to the device.

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use crate::error::GpuError;
use crate::release::Release;
use crate::ticket::Timeline;
use crate::timestamp::{Times, signed_ms_between};

/// Submitted work, to wait for. Dropping it lets the work go on; what that uses lives until it has completed.
#[derive(Clone)]
pub struct Submission {
    pub(crate) name: String,
    /// The queue that runs it, as an index among the device's.
    pub(crate) queue: usize,
    pub(crate) timeline: Arc<Timeline>,
    pub(crate) value: u64,
    pub(crate) release: Arc<Release>,
    pub(crate) times: Arc<OnceLock<Times>>,
}

impl std::fmt::Debug for Submission {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Submission({:?}, {} on queue {})", self.name, self.value, self.queue)
    }
}

impl Submission {
    /// Waits until the device has completed it.
    ///
    /// # Errors
    /// [`GpuError::Timeout`] after `timeout`, with the work still going on; [`GpuError::DeviceLost`].
    pub fn wait(&self, timeout: Duration) -> Result<(), GpuError> {
        if !self.timeline.wait(self.value, timeout)? {
            self.timeline.device().patience.waited(timeout);
            return Err(GpuError::Timeout { object: self.name.clone(), waited: timeout });
        }
        self.release.collect()
    }

    /// Whether the device has completed it.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn is_done(&self) -> Result<bool, GpuError> {
        Ok(self.timeline.seen() >= self.value || self.timeline.poll()? >= self.value)
    }

    /// Its spans in the order of their ends: name, beginning and end, in ms since it began on the device. Empty until
    /// it was waited for, and on a device without timestamps.
    pub fn spans(&self) -> Vec<(&'static str, f64, f64)> {
        self.times.get().map(|times| times.spans.clone()).unwrap_or_default()
    }

    /// How long after another submission it began, ms, by the device's clock; negative where it began before it. None until
    /// both were waited for, and for those without spans.
    pub fn began_after_ms(&self, other: &Submission) -> Option<f64> {
        let (began, origin) = (self.times.get()?.began?, other.times.get()?.began?);
        Some(signed_ms_between(&self.timeline.device().limits, origin, began))
    }
}
