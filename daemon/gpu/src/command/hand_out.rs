//! Buffers on their way to other processes.

use std::sync::{Arc, PoisonError};

use super::Recorder;
use crate::access::{Access, AccessSet};
use crate::barrier::Gathered;
use crate::buffer::Buffer;
use crate::error::GpuError;
use crate::shared_timeline::SharedTimeline;

impl Recorder {
    /// Ends this recording's work on an exported buffer: from then on it is with the process that imported it. What it holds after
    /// the next recording that writes to it is only what that one wrote.
    ///
    /// Where there is a timeline it reaches the next of its values when the recording has completed, and that value is returned;
    /// whoever imported it waits there. Without one the host has to wait and then to tell.
    ///
    /// # Errors
    /// [`GpuError::OtherDevice`], and [`GpuError::Misuse`] for a buffer that was not exported, or where the recording signals such a
    /// timeline already.
    pub fn hand_out(
        &mut self,
        buffer: &Arc<Buffer>,
        timeline: Option<&Arc<SharedTimeline>>,
    ) -> Result<Option<u64>, GpuError> {
        self.check_outside()?;
        let handle = Arc::clone(self.device().handle());
        if !Arc::ptr_eq(&buffer.device, &handle) || timeline.is_some_and(|t| !Arc::ptr_eq(t.device(), &handle)) {
            return Err(GpuError::OtherDevice { object: buffer.name().into() });
        }
        if timeline.is_some() && self.recording.shared.is_some() {
            return Err(GpuError::misuse(&self.recording.name, "a recording signals one shared timeline at most"));
        }
        let Some(importers) = buffer.importers else {
            return Err(GpuError::misuse(buffer.name(), "its memory was not exported"));
        };
        let family = self.device().queues[self.recording.ticket.queue].family;
        self.operation += 1;
        let mut history = buffer.history.lock().unwrap_or_else(PoisonError::into_inner);
        let external = AccessSet::of(Access::External);
        let before = history.note(&self.recording.ticket, self.operation, external, None);
        drop(history);
        let mut gathered = Gathered::default();
        gathered.add_release(buffer.raw, [family, importers], &before);
        self.depend(before.tickets);
        self.flush(gathered);
        self.keep(buffer);
        let Some(timeline) = timeline else { return Ok(None) };
        self.keep(timeline);
        let value = timeline.next();
        self.recording.shared = Some((Arc::clone(timeline), value));
        Ok(Some(value))
    }
}
