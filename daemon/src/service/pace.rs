//! When frames begin: as late as they may and still be whole at the refresh that they are for, so that they show the newest pose.

use std::time::{Duration, Instant};

use crate::output::Clock;

/// The longest of so many frames but for the longest few is what the next one is taken to need.
const FRAMES: usize = 32;

/// How many of them may be longer.
const OUTLIERS: usize = 2;

/// What is left between the end of a frame and its refresh: at the start, at least, and as a share of the period at most.
const MARGIN: Duration = Duration::from_micros(1000);
const LEAST_MARGIN: Duration = Duration::from_micros(500);
const MOST_MARGIN: f64 = 0.25;

/// A miss makes the margin so much larger, and so many frames without one take a tenth of that away again.
const STEP: Duration = Duration::from_micros(500);
const GOOD_FRAMES: u32 = 60;

/// What frames have taken, and so when the next one has to begin.
#[derive(Debug)]
pub struct Pace {
    /// From the beginning until it was with the screens, the newest last.
    took: Vec<Duration>,
    margin: Duration,
    /// Frames since the last miss, or since the margin was made smaller.
    good: u32,
    /// The refresh that the last frame was for, or came to be for.
    last: Option<Instant>,
}

/// When a frame is to begin, and for which refresh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Not before this.
    pub start: Instant,
    /// When that is.
    pub refresh: Instant,
}

impl Default for Pace {
    fn default() -> Self {
        Self { took: Vec::new(), margin: MARGIN, good: 0, last: None }
    }
}

impl Pace {
    /// What a frame is taken to need, without any margin.
    pub fn estimate(&self) -> Duration {
        let mut sorted = self.took.clone();
        sorted.sort_unstable();
        sorted.get(sorted.len().saturating_sub(1 + OUTLIERS.min(sorted.len() / 4))).copied().unwrap_or_default()
    }

    /// What is left over where a frame takes what it is taken to.
    pub fn margin(&self) -> Duration {
        self.margin
    }

    /// The plan of the next frame: for the first refresh that it can reach and that no frame was for, begun as late as it may be.
    /// Where frames need longer than from one refresh to the next, it begins at once.
    pub fn plan(&self, clock: &Clock, now: Instant) -> Plan {
        let (needs, period) = (self.estimate() + self.margin, clock.period());
        let reaches = if needs < period { now + needs } else { now };
        // A clock that was moved a little meanwhile, or is another screen's, does not make one refresh two.
        let after = self.last.map_or(reaches, |last| reaches.max(last + period / 2));
        let refresh = clock.next_refresh(after);
        let start = if needs < period { refresh.checked_sub(needs).unwrap_or(now).max(now) } else { now };
        // Nothing is waited for that lies beyond the next refresh but one.
        Plan { start: start.min(now + period * 2), refresh }
    }

    /// A frame that was planned for a refresh is whole, and with the screens.
    pub fn completed(&mut self, clock: &Clock, plan: Plan, began: Instant, completed: Instant) {
        if self.took.len() == FRAMES {
            self.took.remove(0);
        }
        let could_reach = self.estimate() + self.margin < clock.period();
        self.took.push(completed.saturating_duration_since(began));
        let is_late = completed > plan.refresh;
        self.last = Some(if is_late { clock.next_refresh(completed) } else { plan.refresh });

        // A margin helps only frames that can be in time at all.
        if is_late && could_reach {
            self.was_late(clock);
        } else {
            self.good += 1;
            if self.good >= GOOD_FRAMES {
                self.margin = (self.margin.saturating_sub(STEP / 10)).max(LEAST_MARGIN);
                self.good = 0;
            }
        }
    }

    /// A frame came later than it was planned, though there was time: the next ones get more room.
    pub fn was_late(&mut self, clock: &Clock) {
        self.margin = (self.margin + STEP).min(clock.period().mul_f64(MOST_MARGIN));
        self.good = 0;
    }

    /// Another clock counts from now on: what the last frame was for says nothing any more.
    pub fn restart(&mut self) {
        self.last = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// Runs frames that take what `took` says, one after the other: the plans, and what each missed.
    fn run(took: impl Fn(usize) -> Duration, frames: usize) -> (Pace, Clock, Vec<(Plan, u64)>) {
        let start = Instant::now();
        let (mut pace, clock, mut now) = (Pace::default(), Clock::new(50.0, start), start);
        let mut all = Vec::new();
        for frame in 0..frames {
            let plan = pace.plan(&clock, now);
            assert!(plan.start >= now, "no frame begins in the past");
            now = plan.start + took(frame);
            pace.completed(&clock, plan, plan.start, now);
            all.push((plan, clock.missed(plan.refresh, now)));
        }
        (pace, clock, all)
    }

    #[test]
    fn a_frame_begins_as_late_as_it_may() {
        let (pace, clock, all) = run(|frame| MS * (6 + frame as u32 % 3), 400);
        // One frame a refresh, none twice, none missed once what they take is known.
        let refreshes: Vec<_> = all[50..].iter().map(|(plan, _)| plan.refresh).collect();
        assert!(refreshes.windows(2).all(|pair| (pair[1] - pair[0]).abs_diff(clock.period()) < MS));
        assert!(all[50..].iter().all(|(_, missed)| *missed == 0));
        let (plan, _) = all[399];
        let before = plan.refresh - plan.start;
        assert!(before >= 8 * MS && before <= 9 * MS + MS / 2, "{before:?} ahead of its refresh");
        // An hour later another screen's clock counts: nothing waits for what the old one had come to.
        let (now, other) = (plan.refresh + MS * 3_600_000, Clock::new(100.0, plan.refresh + MS * 3_599_000));
        let next = pace.plan(&other, now);
        assert!(next.start < now + MS * 20 && next.refresh > now && next.refresh < now + MS * 30, "{next:?}");
    }

    #[test]
    fn frames_that_are_late_now_and_then_get_more_room_and_lose_it_again() {
        // One in twenty takes a millisecond and a half more than the others.
        let late = |frame: usize| if frame % 20 == 19 { 8 * MS + MS / 2 } else { 7 * MS };
        let (pace, _, all) = run(late, 2000);
        let missed = |of: &[(Plan, u64)]| of.iter().map(|(_, missed)| missed).sum::<u64>();
        assert!(missed(&all[1000..]) <= 5, "{} missed", missed(&all[1000..]));
        assert!(pace.margin() > MARGIN);
        let (pace, ..) = run(|_| 7 * MS, 2000);
        assert_eq!(pace.margin(), LEAST_MARGIN);
    }

    #[test]
    fn frames_longer_than_a_refresh_begin_at_once_and_are_counted() {
        // Of five refreshes two show a new picture, and three might have.
        let (pace, clock, all) = run(|_| 50 * MS, 40);
        assert!(all[1..].windows(2).all(|pair| pair[1].0.start == pair[0].0.start + 50 * MS));
        let missed: u64 = all.iter().map(|(_, missed)| missed).sum();
        let passed =
            (all[39].0.start + 50 * MS - all[0].0.start).as_millis() as u64 / clock.period().as_millis() as u64;
        assert!(missed.abs_diff(passed * 3 / 5) <= 1, "{missed} of {passed}");
        assert!(pace.margin() <= MARGIN + STEP, "no margin can help them");
    }

    #[test]
    fn no_refresh_gets_two_frames() {
        // What is there at once still waits for the next refresh.
        let (_, _, all) = run(|_| Duration::ZERO, 100);
        assert!(all.windows(2).all(|pair| pair[1].0.refresh > pair[0].0.refresh));
    }
}
