//! How fast one client is read: a bucket that fills at its rate and holds a second's worth.

use std::time::{Duration, Instant};

/// One client's bucket.
#[derive(Debug)]
pub(super) struct Pace {
    per_s: f64,
    /// Requests that may come at once; below 0, those that came too early.
    left: f64,
    filled: Instant,
}

impl Pace {
    /// A full one.
    pub(super) fn new(per_s: u32, now: Instant) -> Self {
        Self { per_s: per_s.into(), left: per_s.into(), filled: now }
    }

    /// Takes a request out; how long its client is to wait for it.
    pub(super) fn take(&mut self, now: Instant) -> Duration {
        let since = now.saturating_duration_since(self.filled).as_secs_f64();
        self.filled = now;
        self.left = (self.left + since * self.per_s).min(self.per_s) - 1.0;
        Duration::from_secs_f64((-self.left / self.per_s).max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_s_worth_at_once_and_then_the_rate() {
        let start = Instant::now();
        let mut pace = Pace::new(10, start);
        assert!((0..10).all(|_| pace.take(start) == Duration::ZERO));
        assert_eq!(pace.take(start), Duration::from_millis(100));
        // Whoever has waited for as long may ask as often as the rate says.
        let mut now = start + Duration::from_millis(100);
        for _ in 0..100 {
            let wait = pace.take(now);
            assert!(wait.abs_diff(Duration::from_millis(100)) < Duration::from_micros(1), "{wait:?}");
            now += wait;
        }
        // However long nothing was asked, no more than a second's worth is saved.
        now += Duration::from_secs(3600);
        assert!((0..10).all(|_| pace.take(now) == Duration::ZERO));
        assert!(pace.take(now) > Duration::ZERO);
    }
}
