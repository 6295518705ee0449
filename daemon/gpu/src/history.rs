//! What a buffer or an image was last used for, and so what a new use has to wait for.

use std::sync::Arc;

use ash::vk;

use crate::access::AccessSet;
use crate::error::GpuError;
use crate::ticket::{Phase, Ticket};

/// One use of a resource by one recording.
struct Use {
    ticket: Arc<Ticket>,
    accesses: AccessSet,
    /// The operation in its recording, from 1.
    operation: u64,
    /// Whether contents or layout changed.
    changes: bool,
    /// The layout it leaves an image in.
    layout: vk::ImageLayout,
}

/// The uses of a resource that still matter, in the order of recording: the last change and the reads since, and what
/// lies before it only as long as that change may yet be abandoned.
#[derive(Default)]
pub(crate) struct History {
    uses: Vec<Use>,
}

/// What must come before a new use.
#[derive(Default)]
pub(crate) struct Before {
    /// Uses on the same queue, for a barrier: the accesses, and the operation of this recording (0: before it began).
    pub(crate) here: Vec<(AccessSet, u64)>,
    /// Recordings that must be submitted before; those on other queues become semaphore waits.
    pub(crate) tickets: Vec<Arc<Ticket>>,
    /// Whether one of them is on another queue.
    pub(crate) elsewhere: bool,
    /// The layout that the image is in.
    pub(crate) layout: vk::ImageLayout,
}

impl History {
    /// Notes a use by operation `operation` of `ticket` and returns what must come before it. `layout` is what an
    /// image must be in; None for buffers.
    pub(crate) fn note(
        &mut self,
        ticket: &Arc<Ticket>,
        operation: u64,
        accesses: AccessSet,
        layout: Option<vk::ImageLayout>,
    ) -> Before {
        self.forget();
        let last_change = self.uses.iter().rposition(|used| used.changes);
        let old_layout = self.layout();
        let new_layout = layout.unwrap_or(old_layout);
        let changes = accesses.writes() || new_layout != old_layout;

        // A read waits for the last change. A change waits for the reads since, which themselves waited for the last
        // change; only where there are none, for that change.
        let first_read = last_change.map_or(0, |at| at + 1);
        let waits_for = match last_change {
            _ if changes && first_read < self.uses.len() => &self.uses[first_read..],
            Some(at) => &self.uses[at..=at],
            None => &[],
        };
        let mut before = Before { layout: old_layout, ..Default::default() };
        for used in waits_for {
            let own = Arc::ptr_eq(&used.ticket, ticket);
            if !own {
                before.tickets.push(Arc::clone(&used.ticket));
            }
            // A barrier that changed the layout for these very reads has let them all in already.
            let let_in = !changes && !used.accesses.writes() && used.accesses.contains(accesses);
            if used.ticket.queue == ticket.queue && let_in {
                continue;
            }
            if used.ticket.queue == ticket.queue {
                before.here.push((used.accesses, if own { used.operation } else { 0 }));
            } else {
                before.elsewhere = true;
            }
        }

        // Reads of one recording are one entry.
        let same = self.uses[first_read..].iter_mut().find(|used| Arc::ptr_eq(&used.ticket, ticket));
        match same {
            Some(used) if !changes => {
                used.accesses.insert(accesses);
                used.operation = operation;
            }
            _ => self.uses.push(Use { ticket: Arc::clone(ticket), accesses, operation, changes, layout: new_layout }),
        }
        before
    }

    /// The layout that an image is in once all that was recorded has happened.
    pub(crate) fn layout(&self) -> vk::ImageLayout {
        let live = |used: &&Use| used.changes && used.ticket.phase() != Phase::Abandoned;
        self.uses.iter().rev().find(live).map_or(vk::ImageLayout::UNDEFINED, |used| used.layout)
    }

    /// Whether the device may be using the resource right now; with `changes`, whether it may be changing it.
    pub(crate) fn in_flight(&self, changes: bool) -> Result<bool, GpuError> {
        for used in &self.uses {
            if (used.changes || !changes) && used.ticket.in_flight()? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Drops what no longer matters.
    fn forget(&mut self) {
        self.uses.retain(|used| used.ticket.phase() != Phase::Abandoned);

        // What was submitted cannot be taken back, so that nothing before it will be needed again.
        let submitted = |used: &Use| used.changes && matches!(used.ticket.phase(), Phase::Submitted(_));
        if let Some(at) = self.uses.iter().rposition(submitted) {
            self.uses.drain(..at);
        }

        // Nor will what the same recording did before its last change: the two stand and fall together.
        if let Some(at) = self.uses.iter().rposition(|used| used.changes) {
            let ticket = Arc::clone(&self.uses[at].ticket);
            let mut index = 0;
            self.uses.retain(|used| {
                index += 1;
                index > at || !Arc::ptr_eq(&used.ticket, &ticket)
            });
        }

        // Reads that are done hold up nobody.
        self.uses.retain(|used| used.changes || !used.ticket.seen_done());
    }
}
