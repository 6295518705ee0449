//! A recording on its way from the recorder to the queue, and what becomes of it when it never gets there.

use std::sync::Arc;

use ash::vk;

use crate::device::{Device, Work};
use crate::encoder::Encoder;
use crate::release::Kept;
use crate::shared_timeline::SharedTimeline;
use crate::ticket::{Phase, Ticket};
use crate::timestamp::Span;

/// The command buffer being recorded and all that belongs to it. Dropped before it was submitted, it never happened.
pub(super) struct Recording {
    pub(super) device: Arc<Device>,
    pub(super) name: String,
    pub(super) ticket: Arc<Ticket>,
    /// Recordings that must be submitted before this one.
    pub(super) depends: Vec<Arc<Ticket>>,
    /// What the command buffer uses.
    pub(super) kept: Vec<Kept>,
    pub(super) spans: Vec<Span>,
    /// How many barriers stand in it.
    pub(super) barriers: u32,
    /// How many compute dispatches.
    pub(super) dispatches: u32,
    /// Where an image of a surface is drawn: the semaphore by which it was taken, and the one by which it is handed over.
    pub(super) surface: Option<[vk::Semaphore; 2]>,
    /// Where other processes wait for it: what is signalled besides, and the value.
    pub(super) shared: Option<(Arc<SharedTimeline>, u64)>,
    /// None once it was submitted.
    pub(super) encoder: Option<Encoder>,
}

impl Recording {
    pub(super) fn commands(&self) -> vk::CommandBuffer {
        self.encoder.as_ref().map_or(vk::CommandBuffer::null(), |encoder| encoder.commands)
    }

    pub(super) fn queries(&self) -> vk::QueryPool {
        self.encoder.as_ref().map_or(vk::QueryPool::null(), |encoder| encoder.queries)
    }
}

impl Drop for Recording {
    fn drop(&mut self) {
        if self.ticket.phase() == Phase::Recorded {
            self.ticket.abandoned();
        }
        if let Some(encoder) = self.encoder.take() {
            // SAFETY: a submitted recording has given its encoder away, so this one was never submitted.
            unsafe { self.device.release().give_back(encoder) };
        }
    }
}

/// Recorded commands, to be submitted by [`Device::submit`]. Dropped instead, they never happened.
pub struct Commands(pub(super) Recording);

impl std::fmt::Debug for Commands {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Commands({:?})", self.0.name)
    }
}

impl Commands {
    pub(crate) fn device(&self) -> &Arc<Device> {
        &self.0.device
    }

    pub(crate) fn name(&self) -> &str {
        &self.0.name
    }

    pub(crate) fn queue(&self) -> usize {
        self.0.ticket.queue
    }

    pub(crate) fn depends(&self) -> &[Arc<Ticket>] {
        &self.0.depends
    }

    /// What they add to the device's work, once they are submitted, but for the call itself.
    pub(crate) fn work(&self) -> Work {
        Work { submissions: 0, dispatches: self.0.dispatches.into(), barriers: self.0.barriers.into() }
    }

    pub(crate) fn surface(&self) -> Option<[vk::Semaphore; 2]> {
        self.0.surface
    }

    pub(crate) fn shared(&self) -> Option<&(Arc<SharedTimeline>, u64)> {
        self.0.shared.as_ref()
    }

    pub(crate) fn ticket(&self) -> &Arc<Ticket> {
        &self.0.ticket
    }

    pub(crate) fn raw(&self) -> vk::CommandBuffer {
        self.0.commands()
    }

    /// Takes apart what was submitted as `value`: all that must live on. The encoder is always there, since only this
    /// takes it.
    pub(crate) fn submitted(mut self, value: u64) -> (Option<Encoder>, Vec<Kept>, Vec<Span>) {
        self.0.ticket.submitted(value);
        (self.0.encoder.take(), std::mem::take(&mut self.0.kept), std::mem::take(&mut self.0.spans))
    }
}
