//! When work is done: a timeline semaphore for each queue, and a ticket for each recording.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use ash::vk;

use crate::error::GpuError;
use crate::handle::DeviceHandle;

/// The timeline semaphore of a queue: submission n sets it to n once it and all before it have completed.
pub(crate) struct Timeline {
    device: Arc<DeviceHandle>,
    raw: vk::Semaphore,
    /// The highest value seen so far, so that a look at it costs no call.
    seen: AtomicU64,
}

impl Timeline {
    pub(crate) fn new(device: &Arc<DeviceHandle>, name: &str) -> Result<Arc<Timeline>, GpuError> {
        let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        // SAFETY: timeline semaphores are enabled on every device that is opened; the new object is named before
        // anyone else has it.
        let raw = unsafe {
            let raw = device
                .raw
                .create_semaphore(&info, None)
                .map_err(|result| GpuError::vulkan(format!("creating {name:?}"), result))?;
            device.naming.name(raw, name);
            raw
        };
        Ok(Arc::new(Timeline { device: Arc::clone(device), raw, seen: AtomicU64::new(0) }))
    }

    pub(crate) fn raw(&self) -> vk::Semaphore {
        self.raw
    }

    /// The last value that was seen, which the semaphore may have passed since.
    pub(crate) fn seen(&self) -> u64 {
        self.seen.load(Ordering::Acquire)
    }

    /// The value now.
    pub(crate) fn poll(&self) -> Result<u64, GpuError> {
        // SAFETY: the semaphore lives and is a timeline.
        let value = unsafe { self.device.raw.get_semaphore_counter_value(self.raw) }
            .map_err(|result| GpuError::vulkan("asking how far a queue is", result))?;
        self.seen.fetch_max(value, Ordering::AcqRel);
        Ok(value)
    }

    /// Waits until the value is reached; `Ok(false)` when `timeout` passed first.
    pub(crate) fn wait(&self, value: u64, timeout: Duration) -> Result<bool, GpuError> {
        let (semaphores, values) = ([self.raw], [value]);
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        let timeout_ns = u64::try_from(timeout.as_nanos()).unwrap_or(u64::MAX);
        // SAFETY: the semaphore lives and is a timeline.
        match unsafe { self.device.raw.wait_semaphores(&info, timeout_ns) } {
            Ok(()) => {
                self.seen.fetch_max(value, Ordering::AcqRel);
                Ok(true)
            }
            Err(vk::Result::TIMEOUT) => Ok(false),
            Err(result) => Err(GpuError::vulkan("waiting for a queue", result)),
        }
    }

    /// Sets the value from the host, where the submission that was to do so was refused: nobody shall wait for it for ever. A
    /// device that cannot even do this is lost, and ends all waits itself.
    pub(crate) fn skip_to(&self, submitted: u64, value: u64) {
        // What was submitted before still counts up, and a timeline never goes back.
        match self.wait(submitted, self.device.patience.limit()) {
            Ok(_) => {}
            Err(GpuError::DeviceLost { .. }) => return,
            Err(error) => {
                tracing::error!(%error, value, "a queue's timeline stands still");
                return;
            }
        }
        let info = vk::SemaphoreSignalInfo::default().semaphore(self.raw).value(value);
        // SAFETY: the semaphore lives and is a timeline; its queue has taken no submission of this value, nor of a later one.
        if let Err(result) = unsafe { self.device.raw.signal_semaphore(&info) } {
            tracing::error!(?result, value, "a queue's timeline stands still");
        }
    }

    pub(crate) fn device(&self) -> &Arc<DeviceHandle> {
        &self.device
    }
}

impl Drop for Timeline {
    fn drop(&mut self) {
        // SAFETY: submissions in flight are parked with this timeline by Arc, so no queue uses it any more.
        unsafe { self.device.raw.destroy_semaphore(self.raw, None) };
    }
}

/// What became of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Phase {
    /// Being recorded, or recorded and not yet submitted.
    Recorded,
    /// Submitted as this value of its queue's timeline.
    Submitted(u64),
    /// Dropped without being submitted: it never happened.
    Abandoned,
}

/// The identity of one recording, which resources keep as a mark of who used them.
pub(crate) struct Ticket {
    /// The queue that it is recorded for, as an index among the device's.
    pub(crate) queue: usize,
    pub(crate) timeline: Arc<Timeline>,
    phase: AtomicU64,
}

const RECORDED: u64 = 0;
const ABANDONED: u64 = u64::MAX;

impl Ticket {
    pub(crate) fn new(queue: usize, timeline: Arc<Timeline>) -> Arc<Ticket> {
        Arc::new(Ticket { queue, timeline, phase: AtomicU64::new(RECORDED) })
    }

    pub(crate) fn phase(&self) -> Phase {
        match self.phase.load(Ordering::Acquire) {
            RECORDED => Phase::Recorded,
            ABANDONED => Phase::Abandoned,
            value => Phase::Submitted(value),
        }
    }

    pub(crate) fn submitted(&self, value: u64) {
        self.phase.store(value, Ordering::Release);
    }

    pub(crate) fn abandoned(&self) {
        self.phase.store(ABANDONED, Ordering::Release);
    }

    /// Whether the work is known to be done, without asking the device.
    pub(crate) fn seen_done(&self) -> bool {
        matches!(self.phase(), Phase::Submitted(value) if self.timeline.seen() >= value)
    }

    /// Whether the device may be at it right now.
    pub(crate) fn in_flight(&self) -> Result<bool, GpuError> {
        match self.phase() {
            Phase::Submitted(value) => Ok(self.timeline.seen() < value && self.timeline.poll()? < value),
            Phase::Recorded | Phase::Abandoned => Ok(false),
        }
    }
}
