//! Moments as other programs of the machine can read them.

use std::sync::OnceLock;
use std::time::{Duration, Instant};

use rustix::time::{ClockId, clock_gettime};

/// Seconds of `CLOCK_MONOTONIC`, which is what [`Instant`] counts on Linux.
pub fn seconds(moment: Instant) -> f64 {
    static START: OnceLock<(Instant, Duration)> = OnceLock::new();
    let (start, start_s) = START.get_or_init(|| {
        let now = clock_gettime(ClockId::Monotonic);
        // Neither part of that clock is ever negative.
        (Instant::now(), Duration::new(now.tv_sec.unsigned_abs(), now.tv_nsec.unsigned_abs() as u32))
    });
    match moment.checked_duration_since(*start) {
        Some(later) => (*start_s + later).as_secs_f64(),
        None => start_s.saturating_sub(start.duration_since(moment)).as_secs_f64(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_the_systems_clock() {
        let read = || {
            let now = clock_gettime(ClockId::Monotonic);
            now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
        };
        let early = Instant::now();
        let (before_s, now, after_s) = (read(), Instant::now(), read());
        // The first call reads both clocks, one right after the other; half a second is for a machine that is busy.
        let now_s = seconds(now);
        assert!((before_s - 0.5..=after_s + 0.5).contains(&now_s), "{before_s} {now_s} {after_s}");
        assert!(seconds(early) <= now_s);
        assert!((seconds(now + Duration::from_secs(5)) - now_s - 5.0).abs() < 1e-6);
    }
}
