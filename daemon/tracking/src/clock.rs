//! When something was measured, told on our clock by timestamps of a clock that nobody has set to it.
//!
//! Between the two lies an offset that nobody knows, and every packet's way takes a time that nobody knows either. Of the
//! packets of a few seconds the one that came fastest says most: the others are late by as much as they came later than it.
//! That is the clock filter of NTP (RFC 5905, section 10), one way. What even the fastest packet takes cannot be told from
//! the offset; the configuration adds it (`predict_ms`).

use crate::pose::Timing;
use lantern_config::Tracker;
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// The least delay is that of this many slots: long enough that some packet of them came fast, and short enough that a clock
/// which drifts by 100 ppm is followed to 0.4 ms.
const SLOTS: u64 = 8;
const SLOT: Duration = Duration::from_millis(500);

/// A change of delay beyond this is no delay: the sender's clock was set, has passed midnight, or is another sender's.
const STEP_NS: i128 = 250_000_000;

/// The least delay of a slot.
#[derive(Clone, Copy, Debug)]
struct Slot {
    number: u64,
    least_ns: i128,
}

/// A sender's clock, beside ours.
#[derive(Debug, Default)]
pub(crate) struct Clock {
    /// What both are counted from: the first packet, by its sender's clock and by ours.
    start: Option<(u64, Instant)>,
    /// At most [`SLOTS`], by number. Delays are relative to the first packet's.
    slots: VecDeque<Slot>,
}

impl Clock {
    /// When something was measured that its sender says was so at `measured_ns`; never after it was `received`. Packets are
    /// to be told in the order in which they are received.
    pub(crate) fn measured_at(&mut self, measured_ns: u64, received: Instant) -> Instant {
        let (start_ns, start) = *self.start.get_or_insert((measured_ns, received));
        let since_start = received.saturating_duration_since(start);
        // Durations have less than 2⁹⁴ ns, so that none of this can overflow.
        let delay_ns = since_start.as_nanos() as i128 - (i128::from(measured_ns) - i128::from(start_ns));

        if self.least_ns().is_some_and(|least_ns| (delay_ns - least_ns).abs() > STEP_NS) {
            self.slots.clear();
        }
        // Seconds fit 64 bits, and so do half seconds of any time that a machine runs.
        let number = (since_start.as_nanos() / SLOT.as_nanos()) as u64;
        match self.slots.back_mut() {
            Some(newest) if newest.number >= number => newest.least_ns = newest.least_ns.min(delay_ns),
            _ => self.slots.push_back(Slot { number, least_ns: delay_ns }),
        }
        while self.slots.front().is_some_and(|oldest| oldest.number + SLOTS <= number) {
            self.slots.pop_front();
        }

        let late_ns = delay_ns - self.least_ns().unwrap_or(delay_ns);
        // Not negative, since the least delay is at most this one, and at most a step.
        let late = Duration::from_nanos(u64::try_from(late_ns).unwrap_or_default());
        received.checked_sub(late).unwrap_or(received)
    }

    fn least_ns(&self) -> Option<i128> {
        self.slots.iter().map(|slot| slot.least_ns).min()
    }
}

/// Whether a sender's clock goes as ours does: timestamps in another unit, or of no clock at all, must not be taken for times.
#[derive(Debug)]
struct Pace {
    /// A packet of a while ago, by its sender's clock and by ours.
    before: Option<(u64, Instant)>,
    is_ours: bool,
}

/// The paces are compared over this at least, …
const PACE_TIME: Duration = Duration::from_secs(1);

/// … in which time packets come early or late by less than this part.
const PACE_SLACK: f64 = 0.3;

impl Pace {
    /// Whether a timestamp of now is to be believed: until a clock is found to go otherwise, it is.
    fn is_ours(&mut self, measured_ns: u64, received: Instant, tracker: &str) -> bool {
        let (before_ns, before) = *self.before.get_or_insert((measured_ns, received));
        let passed = received.saturating_duration_since(before);
        if passed >= PACE_TIME {
            let theirs_s = Duration::from_nanos(measured_ns.saturating_sub(before_ns)).as_secs_f64();
            let pace = theirs_s / passed.as_secs_f64();
            let is_ours = (pace - 1.0).abs() < PACE_SLACK;
            // A clock that was set shows once, too.
            if self.is_ours && !is_ours {
                tracing::warn!(tracker, pace, "its clock does not go as ours: its times are not used until it does");
            }
            (self.before, self.is_ours) = (Some((measured_ns, received)), is_ours);
        }
        self.is_ours
    }
}

/// One tracker's clock, and what the configuration says of how old its poses are.
#[derive(Debug)]
pub(crate) struct Timekeeper {
    tracker: String,
    clock: Clock,
    pace: Pace,
    /// How old poses are at least when they are heard, where they are to be predicted.
    predict_lead: Option<Duration>,
}

impl Timekeeper {
    pub(crate) fn new(tracker: &Tracker) -> Self {
        let predict_lead = tracker.predict_lead_ms.map(|ms| Duration::from_secs_f64(ms / 1e3));
        let pace = Pace { before: None, is_ours: true };
        Self { tracker: tracker.name.clone(), clock: Clock::default(), pace, predict_lead }
    }

    /// The times of what was `received` now, and measured at `measured_ns` by its sender's clock, where that is said.
    pub(crate) fn timing(&mut self, measured_ns: Option<u64>, received: Instant) -> Timing {
        let lead = self.predict_lead.unwrap_or_default();
        let sender_ns = measured_ns.filter(|ns| self.pace.is_ours(*ns, received, &self.tracker));
        let fastest = sender_ns.map(|ns| self.clock.measured_at(ns, received));
        Timing {
            measured: fastest.map(|fastest| fastest.checked_sub(lead).unwrap_or(fastest)),
            sender_ns,
            predict_lead: self.predict_lead,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: u64 = 1_000_000;

    /// One way of packets: when each is measured on our clock and what its sender's says then, how late it comes beyond the
    /// least, and where on our clock the estimate lies from the truth, ns.
    struct Way {
        start: Instant,
        clock: Clock,
    }

    impl Way {
        /// Sends a packet that was measured at `true_ns` since the start, stamped `said_ns`; gives estimate less truth.
        fn send(&mut self, true_ns: u64, said_ns: u64, late_ns: u64) -> i64 {
            // The least delay is no part of what can be estimated, and is counted to the truth.
            let received = self.start + Duration::from_nanos(true_ns + late_ns);
            let estimate = self.clock.measured_at(said_ns, received);
            assert!(estimate <= received, "measured in the future");
            (estimate - self.start).as_nanos() as i64 - true_ns as i64
        }
    }

    fn way() -> Way {
        Way { start: Instant::now() + Duration::from_secs(1000), clock: Clock::default() }
    }

    proptest! {
        /// Once a packet has come as fast as any does, the estimate is right to the drift of a window, whatever the offset,
        /// jitter and losses.
        #[test]
        fn jitter_loss_and_drift(
            offset_ns in any::<u64>().prop_map(|x| x / 2),
            ppm in -100.0..100f64,
            packets in prop::collection::vec((0..12 * MS, any::<bool>(), 0..8u32), 200..1500),
        ) {
            let mut way = way();
            for (index, (late_ns, fast, lost)) in packets.iter().enumerate() {
                let true_ns = index as u64 * 8 * MS;
                let said_ns = offset_ns + (true_ns as f64 * (1.0 + ppm * 1e-6)) as u64;
                if *lost == 0 {
                    continue;
                }
                let error_ns = way.send(true_ns, said_ns, if *fast { 0 } else { *late_ns });
                // Half of all come fast, so that 30 in a row bring one.
                if index > 30 {
                    prop_assert!(error_ns.unsigned_abs() < 410_000 + 1000, "{index}: {error_ns} ns");
                }
            }
        }

        /// Whatever a sender says, nothing overflows, and nothing is measured in the future.
        #[test]
        fn any_timestamps(packets in prop::collection::vec((any::<u64>(), 0..10_000 * MS), 1..200)) {
            let mut way = way();
            let mut true_ns = 0;
            for (said_ns, pause_ns) in packets {
                true_ns += pause_ns;
                way.send(true_ns, said_ns, 0);
            }
        }

        /// Delays that never get worse than a stated bound leave no estimate worse than it, reordered or not.
        #[test]
        fn reordering(lates in prop::collection::vec(0..40 * MS, 100..400)) {
            let mut way = way();
            let mut packets: Vec<_> = lates.iter().enumerate().map(|(i, late)| (i as u64 * 4 * MS, *late)).collect();
            packets.sort_by_key(|(true_ns, late_ns)| true_ns + late_ns);
            for (true_ns, late_ns) in packets {
                let error_ns = way.send(true_ns, 77 * MS + true_ns, late_ns);
                prop_assert!((0..=40 * MS as i64).contains(&error_ns), "{error_ns}");
            }
        }
    }

    #[test]
    fn steps_are_seen_at_once() {
        let mut way = way();
        let day_ns = 86_400_000 * MS;
        let mut offset_ns = day_ns;
        let mut true_ns = 0;
        // Midnight, a restart from nothing, a clock that was set forward, and one that was set back by half a second.
        for step_ns in [0, -(day_ns as i64), 0, 3600 * 1000 * MS as i64, -(500 * MS as i64)] {
            offset_ns = offset_ns.checked_add_signed(step_ns).unwrap();
            let jitter = |index: u64| index * 7919 % 5 * MS;
            for index in 0..400 {
                true_ns += 8 * MS;
                let error_ns = way.send(true_ns, offset_ns + true_ns, jitter(index + 1));
                // Until a fast packet comes, nothing is worse than the jitter.
                let bound_ns = if index < 5 { 5 * MS as i64 } else { 0 };
                assert!((0..=bound_ns).contains(&error_ns), "after {step_ns}, packet {index}: {error_ns}");
            }
        }
    }

    #[test]
    fn a_clock_of_another_pace_is_not_believed() {
        let start = Instant::now();
        // Nanoseconds are believed; microseconds, a number that stands still, and nonsense are not.
        type Said = fn(u64) -> u64;
        let clocks: [(Said, bool); 4] = [
            (|true_ns| 5_000_000_000 + true_ns, true),
            (|true_ns| true_ns / 1000, false),
            (|_| 7, false),
            (|true_ns| true_ns.wrapping_mul(0x9e37_79b9_7f4a_7c15), false),
        ];
        for (said_ns, is_ours) in clocks {
            let mut pace = Pace { before: None, is_ours: true };
            for packet in 0..600u64 {
                let true_ns = packet * 8 * MS;
                let received = start + Duration::from_nanos(true_ns + packet * 7919 % 40 * MS);
                let believed = pace.is_ours(said_ns(true_ns), received, "t");
                assert!(believed == is_ours || packet < 150, "{is_ours}, packet {packet}");
            }
        }
        // One that was set is believed again soon.
        let mut pace = Pace { before: None, is_ours: true };
        for packet in 0..1000u64 {
            let true_ns = packet * 8 * MS;
            let set_ns = if packet < 300 { 86_400_000 * MS } else { 0 };
            let believed = pace.is_ours(set_ns + true_ns, start + Duration::from_nanos(true_ns), "t");
            assert!(believed || (300..700).contains(&packet), "packet {packet}");
        }
    }

    #[test]
    fn one_wrong_timestamp_spoils_nothing_after_it() {
        let mut way = way();
        for index in 0..100u64 {
            let said_ns = if index == 50 { u64::MAX } else { 5 + index * 8 * MS };
            let error_ns = way.send(index * 8 * MS, said_ns, index % 3 * MS);
            let settled = !(51..54).contains(&index) && index >= 1 && index != 50;
            assert!(error_ns.abs() <= 3 * MS as i64 && (!settled || error_ns == 0), "{index}: {error_ns}");
        }
    }

    #[test]
    fn a_slower_way_is_the_way_after_a_window() {
        let mut way = way();
        for index in 0..2000u64 {
            // The network changes, and from then on every packet takes 20 ms more: for a window they count as late.
            let slower_ns = if index < 500 { 0 } else { 20 * MS };
            let error_ns = way.send(index * 8 * MS + slower_ns, index * 8 * MS, 0);
            let expected_ns = if (500..=500 + 4000 / 8).contains(&index) { -(20 * MS as i64) } else { 0 };
            if !(500 + 3400 / 8..=500 + 4000 / 8).contains(&index) {
                assert_eq!(error_ns, expected_ns, "{index}");
            }
        }
    }
}
