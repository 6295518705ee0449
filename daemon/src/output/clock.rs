//! When a screen shows another image.

use std::time::{Duration, Instant};

/// Of how much a presentation that was measured moves the clock: enough to follow a screen whose rate is a little off, and little
/// enough for one late look to do no harm.
const FOLLOW: f64 = 0.1;

/// A clock that ticks at each refresh.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    period: Duration,
    start: Instant,
}

impl Clock {
    /// Starts it. `refresh_hz` is above 0.
    pub fn new(refresh_hz: f64, start: Instant) -> Self {
        Self { period: Duration::from_secs_f64(1.0 / refresh_hz), start }
    }

    /// From one refresh to the next.
    pub fn period(&self) -> Duration {
        self.period
    }

    /// Refreshes since the start.
    fn refreshes(&self, now: Instant) -> u64 {
        (now.saturating_duration_since(self.start).as_secs_f64() / self.period.as_secs_f64()) as u64
    }

    /// When the refresh after `now` is due.
    pub fn next_refresh(&self, now: Instant) -> Instant {
        self.start + self.period.mul_f64((self.refreshes(now) + 1) as f64)
    }

    /// At how many refreshes from `due` on, itself one of them, what came at `completed` was not there yet. That the clock may have been
    /// moved a little meanwhile, or be another one, does no harm.
    pub fn missed(&self, due: Instant, completed: Instant) -> u64 {
        if completed <= due {
            return 0;
        }
        let reached = self.next_refresh(completed);
        (reached.saturating_duration_since(due).as_secs_f64() / self.period.as_secs_f64()).round() as u64
    }

    /// An image was seen to be shown at `shown`: the clock's nearest tick moves toward it.
    pub fn saw(&mut self, shown: Instant) {
        let period_s = self.period.as_secs_f64();
        let since_s = shown.saturating_duration_since(self.start).as_secs_f64();
        let off_s = since_s - (since_s / period_s).round() * period_s;
        let by = Duration::from_secs_f64(off_s.abs() * FOLLOW);
        self.start = if off_s < 0.0 { self.start.checked_sub(by).unwrap_or(self.start) } else { self.start + by };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refreshes_are_counted_from_the_start() {
        let start = Instant::now();
        let clock = Clock::new(50.0, start);
        assert_eq!(clock.refreshes(start + Duration::from_millis(19)), 0);
        assert_eq!(clock.refreshes(start + Duration::from_millis(41)), 2);
        assert_eq!(clock.next_refresh(start + Duration::from_millis(41)), start + Duration::from_millis(60));
    }

    #[test]
    fn what_comes_late_misses_the_refreshes_before_it() {
        let (start, ms) = (Instant::now(), Duration::from_millis);
        let clock = Clock::new(50.0, start);
        let due = start + ms(40);
        assert_eq!([25, 40, 41, 59, 61, 99].map(|at| clock.missed(due, start + ms(at))), [0, 0, 1, 1, 2, 3]);
        // The clock has moved by a millisecond since that was planned.
        let moved = Clock::new(50.0, start + ms(1));
        assert_eq!([39, 42, 62].map(|at| moved.missed(due, start + ms(at))), [0, 1, 2]);
    }

    #[test]
    fn the_clock_follows_the_screen() {
        let (start, ms) = (Instant::now(), |ms: f64| Duration::from_secs_f64(ms / 1e3));
        // A screen that refreshes 3 ms after our ticks, and then 3 ms before them; each look comes up to half a millisecond late.
        for phase_ms in [3.0, 17.0] {
            let mut clock = Clock::new(50.0, start);
            for refresh in 1..200u32 {
                clock.saw(start + ms(f64::from(refresh) * 20.0 + phase_ms + f64::from(refresh % 5) * 0.1));
            }
            let off_ms = (clock.next_refresh(start + ms(10_005.0)) - start).as_secs_f64() * 1e3 % 20.0;
            assert!((off_ms - phase_ms).abs() < 0.6, "{off_ms} for {phase_ms}");
        }
    }
}
