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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::Access;
    use crate::device::Device;
    use crate::instance::{Instance, Validation};
    use vk::ImageLayout as L;

    const READ: AccessSet = AccessSet::of(Access::ComputeStorageRead);
    const WRITE: AccessSet = AccessSet::of(Access::ComputeStorageWrite);
    const SAMPLE: AccessSet = AccessSet::of(Access::ComputeSampled);
    const COPY: AccessSet = AccessSet::of(Access::CopyRead);

    /// Runs a test with a maker of tickets for queues of any number; no work is submitted.
    fn with_tickets(test: impl FnOnce(&dyn Fn(usize) -> Arc<Ticket>)) {
        let instance = Instance::new(Validation::On).unwrap();
        let device = Device::open(&instance, None, 1, None).unwrap();
        test(&|queue| Ticket::new(queue, Arc::clone(&device.queue(0).timeline)));
        drop(device);
        assert_eq!(instance.validation_messages(), Vec::<String>::new());
    }

    #[test]
    fn a_read_waits_for_the_last_write_and_a_write_for_the_reads_since() {
        with_tickets(|ticket| {
            let (mut history, own) = (History::default(), ticket(0));
            let mut note = |operation, accesses| history.note(&own, operation, accesses, None).here;
            assert_eq!(note(1, READ), []);
            assert_eq!(note(2, WRITE), [(READ, 1)]);
            assert_eq!(note(3, READ), [(WRITE, 2)]);
            assert_eq!(note(4, COPY), [(WRITE, 2)]);
            let mut both = READ;
            both.insert(COPY);
            assert_eq!(note(5, WRITE), [(both, 4)]);
            assert_eq!(note(6, WRITE), [(WRITE, 5)]);
        });
    }

    #[test]
    fn uses_of_other_recordings_become_tickets_and_only_those_of_the_queue_barriers() {
        with_tickets(|ticket| {
            let (mut history, first, second, third) = (History::default(), ticket(0), ticket(1), ticket(0));
            history.note(&first, 9, WRITE, None);
            let before = history.note(&second, 1, READ, None);
            assert!(before.elsewhere && before.here.is_empty());
            assert!(before.tickets.len() == 1 && Arc::ptr_eq(&before.tickets[0], &first));
            let before = history.note(&third, 1, READ, None);
            assert!(!before.elsewhere);
            // Operation 0: before this recording began.
            assert_eq!(before.here, [(WRITE, 0)]);
            let before = history.note(&third, 2, WRITE, None);
            assert!(before.elsewhere && before.tickets.len() == 1 && Arc::ptr_eq(&before.tickets[0], &second));
            assert_eq!(before.here, [(READ, 1)]);
        });
    }

    #[test]
    fn a_change_of_layout_is_a_write_that_lets_its_own_reads_in() {
        with_tickets(|ticket| {
            let (mut history, own) = (History::default(), ticket(0));
            let mut note = |operation, accesses, layout| {
                let before = history.note(&own, operation, accesses, Some(layout));
                (before.here, before.layout)
            };
            assert_eq!(note(1, WRITE, L::GENERAL), (vec![], L::UNDEFINED));
            assert_eq!(note(2, SAMPLE, L::SHADER_READ_ONLY_OPTIMAL), (vec![(WRITE, 1)], L::GENERAL));
            assert_eq!(note(3, SAMPLE, L::SHADER_READ_ONLY_OPTIMAL), (vec![], L::SHADER_READ_ONLY_OPTIMAL));
            assert_eq!(note(4, WRITE, L::GENERAL), (vec![(SAMPLE, 3)], L::SHADER_READ_ONLY_OPTIMAL));
        });
    }

    #[test]
    fn what_was_abandoned_is_forgotten_and_what_it_hid_comes_back() {
        with_tickets(|ticket| {
            let (mut history, first, second, third) = (History::default(), ticket(0), ticket(0), ticket(0));
            history.note(&first, 1, WRITE, Some(L::GENERAL));
            history.note(&second, 1, COPY, Some(L::TRANSFER_SRC_OPTIMAL));
            assert_eq!(history.layout(), L::TRANSFER_SRC_OPTIMAL);
            second.abandoned();
            assert_eq!(history.layout(), L::GENERAL);
            let before = history.note(&third, 1, READ, Some(L::GENERAL));
            assert_eq!(before.here, [(WRITE, 0)]);
            assert!(before.tickets.len() == 1 && Arc::ptr_eq(&before.tickets[0], &first));
        });
    }

    #[test]
    fn a_history_stays_short_whatever_happens() {
        with_tickets(|ticket| {
            let (mut history, writer) = (History::default(), ticket(0));
            history.note(&writer, 1, WRITE, None);
            writer.submitted(1);
            for value in 2..1000 {
                // A recording of many reads and writes, which is submitted, abandoned or waits for its submission.
                let own = ticket(0);
                for operation in 1..20 {
                    history.note(&own, operation, if operation % 3 == 0 { WRITE } else { READ }, None);
                }
                if value % 7 == 0 {
                    own.abandoned()
                } else {
                    own.submitted(value)
                }
                assert!(history.uses.len() <= 8, "{} uses are remembered", history.uses.len());
            }
        });
    }
}
