//! What `status` says of a tracker.

use crate::protocol::{BodyId, Refusal};
use lantern_proto::status::{OthersStatus, TrackedStatus, TrackerStatus};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// The rate is counted over this many slots, one second together.
const SLOTS: usize = 10;
const SLOT: Duration = Duration::from_millis(100);

/// No more ids of strange bodies are kept: enough to see what there is.
const MAX_STRANGERS: usize = 16;

/// No word that stands in a packet is kept longer, in characters: `status` is a line of bounded length.
const MAX_WORD_CHARS: usize = 128;

/// What else than `status` knows of a tracker by other ways.
#[derive(Clone, Debug, Default)]
pub(crate) struct Socket {
    /// Where it listens.
    pub(crate) listen: String,
    /// Packets that the system has thrown away.
    pub(crate) kernel_dropped: Option<u64>,
}

/// Counts of one tracker; a bounded size, however much comes.
#[derive(Debug)]
pub(crate) struct Counters {
    accepted: u64,
    rejected: u64,
    dropped_old: u64,
    last_reject: Option<String>,
    incomplete: u64,
    others: OthersStatus,
    rate: Rate,
}

impl Counters {
    pub(crate) fn new(now: Instant) -> Self {
        Self {
            accepted: 0,
            rejected: 0,
            dropped_old: 0,
            last_reject: None,
            incomplete: 0,
            others: OthersStatus::default(),
            rate: Rate::new(now),
        }
    }

    pub(crate) fn accept(&mut self, now: Instant) {
        self.accepted += 1;
        self.rate.count(now);
    }

    pub(crate) fn reject(&mut self, reason: String) {
        self.rejected += 1;
        self.last_reject = Some(shortened(reason));
    }

    /// One that moves nothing, by its reason.
    pub(crate) fn refuse(&mut self, refusal: Refusal) {
        match refusal {
            Refusal::Bad(reason) => self.reject(reason),
            // It was good, and came too late: it counts as rejected as well.
            Refusal::Old(_) => {
                self.dropped_old += 1;
                self.reject(refusal.to_string());
            }
            Refusal::Other(what) => {
                self.others.packets += 1;
                self.others.last = Some(shortened(what));
            }
        }
    }

    /// Frames of which a part did not come.
    pub(crate) fn miss(&mut self, frames: u64) {
        self.incomplete += frames;
    }

    /// A body that nobody asked for.
    pub(crate) fn meet(&mut self, stranger: &BodyId) {
        if self.others.bodies.len() < MAX_STRANGERS {
            let name = shortened(stranger.to_string());
            if !self.others.bodies.contains(&name) {
                self.others.bodies.push(name);
            }
        }
    }

    pub(crate) fn status(
        &mut self,
        protocol: &str,
        socket: Socket,
        bodies: BTreeMap<String, TrackedStatus>,
        now: Instant,
    ) -> TrackerStatus {
        TrackerStatus {
            protocol: protocol.to_owned(),
            accepted: self.accepted,
            rejected: self.rejected,
            last_reject: self.last_reject.clone(),
            rate_hz: self.rate.per_second(now),
            dropped_old: self.dropped_old,
            listen: socket.listen,
            kernel_dropped: socket.kernel_dropped,
            incomplete: self.incomplete,
            bodies,
            others: self.others.clone(),
        }
    }
}

/// The beginning of what is too long, with a sign that there was more.
fn shortened(mut word: String) -> String {
    if word.chars().nth(MAX_WORD_CHARS).is_some()
        && let Some((end, _)) = word.char_indices().nth(MAX_WORD_CHARS - 1)
    {
        word.truncate(end);
        word.push('…');
    }
    word
}

/// Events of the last second, in slots of a tenth.
#[derive(Debug)]
struct Rate {
    start: Instant,
    slots: [u32; SLOTS],
    /// Number of the slot that is counted into, since the start.
    current: u128,
}

impl Rate {
    fn new(start: Instant) -> Self {
        Self { start, slots: [0; SLOTS], current: 0 }
    }

    fn count(&mut self, now: Instant) {
        let slot = self.advance(now);
        self.slots[slot] = self.slots[slot].saturating_add(1);
    }

    /// The last full second; less than that has passed since the start, and it is too low by what is missing.
    fn per_second(&mut self, now: Instant) -> f64 {
        self.advance(now);
        self.slots.iter().map(|&count| f64::from(count)).sum()
    }

    /// Empties the slots that time has passed over, and gives the one of now.
    fn advance(&mut self, now: Instant) -> usize {
        let number = now.saturating_duration_since(self.start).as_nanos() / SLOT.as_nanos();
        let passed = number.saturating_sub(self.current).min(SLOTS as u128);
        for back in 0..passed {
            self.slots[index(number - back)] = 0;
        }
        self.current = self.current.max(number);
        index(self.current)
    }
}

fn index(number: u128) -> usize {
    // Less than SLOTS, so it fits.
    (number % SLOTS as u128) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_cut_between_characters() {
        for (length, kept) in [(127, 127), (128, 128), (129, 127), (60_000, 127)] {
            let word = shortened("é".repeat(length));
            let sign = if length > 128 { "…" } else { "" };
            assert_eq!(word, "é".repeat(kept) + sign, "{length}");
        }
    }

    #[test]
    fn the_rate_is_that_of_the_last_second() {
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        let mut rate = Rate::new(start);
        // 120 Hz for three seconds.
        for packet in 0..360 {
            rate.count(start + Duration::from_nanos(packet * 1_000_000_000 / 120));
        }
        assert!((rate.per_second(at(2999)) - 120.0).abs() <= 1.0);
        // Half of the window is silent after half a second, all of it after one.
        assert!((rate.per_second(at(3499)) - 60.0).abs() <= 1.0);
        assert_eq!(rate.per_second(at(4000)), 0.0);
        rate.count(at(60_000));
        assert_eq!(rate.per_second(at(60_050)), 1.0);
        assert_eq!(rate.per_second(at(61_100)), 0.0);
    }
}
