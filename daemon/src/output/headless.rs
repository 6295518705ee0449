//! An output that goes nowhere: the image stays on the device for snapshots, at a refresh rate like a real projector's.

use std::time::{Duration, Instant};

/// The clock of a headless output.
#[derive(Clone, Copy, Debug)]
pub struct Headless {
    period: Duration,
    start: Instant,
}

impl Headless {
    /// Starts its clock. `refresh_hz` is above 0.
    pub fn new(refresh_hz: f64, start: Instant) -> Self {
        Self { period: Duration::from_secs_f64(1.0 / refresh_hz), start }
    }

    /// Refreshes since the start.
    pub fn refreshes(&self, now: Instant) -> u64 {
        (now.saturating_duration_since(self.start).as_secs_f64() / self.period.as_secs_f64()) as u64
    }

    /// When the refresh after `now` is due.
    pub fn next_refresh(&self, now: Instant) -> Instant {
        self.start + self.period.mul_f64((self.refreshes(now) + 1) as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refreshes_are_counted_from_the_start() {
        let start = Instant::now();
        let output = Headless::new(50.0, start);
        assert_eq!(output.refreshes(start + Duration::from_millis(19)), 0);
        assert_eq!(output.refreshes(start + Duration::from_millis(41)), 2);
        assert_eq!(output.next_refresh(start + Duration::from_millis(41)), start + Duration::from_millis(60));
    }
}
