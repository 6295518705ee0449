//! Coarser frames rather than missed ones: while things move faster than whole frames can follow, and never for longer.

use std::time::{Duration, Instant};

/// So many whole frames one after the other that need longer than there is time make the next ones coarser.
const TOO_LONG: u32 = 3;

/// After so long a whole frame is tried again, and twice as long after each that takes too long.
const FIRST_TRY: Duration = Duration::from_secs(2);
const LAST_TRY: Duration = Duration::from_secs(60);

/// Whether frames are whole.
#[derive(Debug)]
pub struct Coarseness {
    allowed: bool,
    coarse: bool,
    too_long: u32,
    next_try: Option<Instant>,
    patience: Duration,
}

impl Coarseness {
    /// Where it is not `allowed`, every frame is whole.
    pub fn new(allowed: bool) -> Self {
        Self { allowed, coarse: false, too_long: 0, next_try: None, patience: FIRST_TRY }
    }

    /// Whether the next frame is to be coarse.
    pub fn wants(&self, now: Instant) -> bool {
        self.coarse && self.next_try.is_none_or(|at| now < at)
    }

    /// A frame took so long, where there was time for `period`. True where this changes what the next ones are.
    pub fn completed(&mut self, was_coarse: bool, took: Duration, period: Duration, now: Instant) -> bool {
        if !self.allowed || was_coarse {
            return false;
        }
        let before = self.coarse;
        if took <= period {
            (self.coarse, self.too_long, self.patience) = (false, 0, FIRST_TRY);
        } else if before {
            // A try that failed.
            self.patience = (2 * self.patience).min(LAST_TRY);
            self.next_try = Some(now + self.patience);
        } else {
            self.too_long += 1;
            if self.too_long >= TOO_LONG {
                (self.coarse, self.next_try) = (true, Some(now + self.patience));
            }
        }
        self.coarse != before
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn frames_become_coarse_where_whole_ones_take_too_long_and_whole_again_where_they_do_not() {
        let (mut of, start) = (Coarseness::new(true), Instant::now());
        assert!(!of.completed(false, 30 * MS, 16 * MS, start) && !of.completed(false, 30 * MS, 16 * MS, start));
        assert!(!of.wants(start));
        assert!(of.completed(false, 30 * MS, 16 * MS, start) && of.wants(start));
        // Coarse ones say nothing of whole ones. After two seconds one of these is tried, and after four more another.
        assert!(!of.completed(true, 5 * MS, 16 * MS, start));
        assert!(of.wants(start + 1999 * MS) && !of.wants(start + 2000 * MS));
        assert!(!of.completed(false, 30 * MS, 16 * MS, start + 2030 * MS));
        assert!(of.wants(start + 6029 * MS) && !of.wants(start + 6030 * MS));
        assert!(of.completed(false, 10 * MS, 16 * MS, start + 6040 * MS));
        assert!(!of.wants(start + 7000 * MS));
    }

    #[test]
    fn a_single_long_frame_changes_nothing() {
        let (mut of, now) = (Coarseness::new(true), Instant::now());
        for frame in 0..100 {
            assert!(!of.completed(false, if frame % 3 == 0 { 40 * MS } else { 10 * MS }, 16 * MS, now));
        }
        assert!(!of.wants(now));
    }

    #[test]
    fn where_it_is_not_allowed_every_frame_is_whole() {
        let (mut of, now) = (Coarseness::new(false), Instant::now());
        assert!((0..10).all(|_| !of.completed(false, 40 * MS, 16 * MS, now)) && !of.wants(now));
    }
}
