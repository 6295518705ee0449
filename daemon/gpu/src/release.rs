//! Where submitted work waits, with all that it uses, until the device has completed it.

use std::any::Any;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use crate::encoder::Encoder;
use crate::error::GpuError;
use crate::ticket::Timeline;
use crate::timestamp::{self, Span, Times};

/// Encoders kept for reuse; more are made when more recordings are alive at once, and dropped afterwards.
const SPARE_ENCODERS: usize = 64;

/// Something that must live until work has completed.
pub(crate) type Kept = Arc<dyn Any + Send + Sync>;

/// Submitted work.
pub(crate) struct Parked {
    pub(crate) timeline: Arc<Timeline>,
    /// The value of the timeline that says it has completed.
    pub(crate) value: u64,
    /// None for work whose encoder is not to be used again.
    pub(crate) encoder: Option<Encoder>,
    pub(crate) kept: Vec<Kept>,
    pub(crate) spans: Vec<Span>,
    /// Where its times are told.
    pub(crate) times: Arc<OnceLock<Times>>,
}

/// The parking place of a device. Parked objects do not know it, so that the two never keep each other alive.
#[derive(Default)]
pub(crate) struct Release {
    parked: Mutex<Vec<Parked>>,
    spare: Mutex<Vec<Encoder>>,
}

impl Release {
    pub(crate) fn park(&self, work: Parked) {
        self.parked.lock().unwrap_or_else(PoisonError::into_inner).push(work);
    }

    /// An encoder for queues of a family to use again, if there is one.
    pub(crate) fn take_spare(&self, family: u32) -> Option<Encoder> {
        let mut spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner);
        let at = spare.iter().rposition(|encoder| encoder.family == family)?;
        Some(spare.swap_remove(at))
    }

    /// Takes an encoder back.
    ///
    /// # Safety
    /// Its command buffer was never submitted, or has completed.
    pub(crate) unsafe fn give_back(&self, mut encoder: Encoder) {
        // SAFETY: by this function's contract. One that cannot be reset is dropped.
        if unsafe { encoder.reset() }.is_err() {
            return;
        }
        let mut spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner);
        if spare.len() < SPARE_ENCODERS {
            spare.push(encoder);
        }
    }

    /// Lets go of all work that has completed, after reading its times.
    pub(crate) fn collect(&self) -> Result<(), GpuError> {
        let mut done = Vec::new();
        {
            // Times are read under the lock: whoever collects after another finds them told.
            let mut parked = self.parked.lock().unwrap_or_else(PoisonError::into_inner);
            let mut at = 0;
            while let Some(work) = parked.get(at) {
                if work.timeline.seen() < work.value && work.timeline.poll()? < work.value {
                    at += 1;
                    continue;
                }
                let work = parked.swap_remove(at);
                // SAFETY: the timeline has reached the work's value, so it has completed; a recording writes every
                // query of its spans before it is finished.
                let times = work.encoder.as_ref().map(|encoder| unsafe { timestamp::times(encoder, &work.spans) });
                let _ = work.times.set(times.unwrap_or_default());
                done.push(work);
            }
        }
        for work in done {
            drop(work.kept);
            if let Some(encoder) = work.encoder {
                // SAFETY: it has completed.
                unsafe { self.give_back(encoder) };
            }
        }
        Ok(())
    }

    /// Lets go of everything.
    ///
    /// # Safety
    /// The device has completed all work, or is lost.
    pub(crate) unsafe fn clear(&self) {
        let parked = std::mem::take(&mut *self.parked.lock().unwrap_or_else(PoisonError::into_inner));
        drop(parked);
        let spare = std::mem::take(&mut *self.spare.lock().unwrap_or_else(PoisonError::into_inner));
        drop(spare);
    }

    /// Keeps everything for ever: the device may still be using it.
    pub(crate) fn leak(&self) {
        std::mem::forget(std::mem::take(&mut *self.parked.lock().unwrap_or_else(PoisonError::into_inner)));
    }
}
