//! Which of the frames of a sender that numbers them are newer than what is known.

use std::time::{Duration, Instant};

/// How many frames late a datagram may be that a network has held up; a number that is farther back is a sender that
/// started anew, or a recording that began again.
const LATE_FRAMES: u32 = 256;

/// After such a silence any number is a new start.
const SILENCE: Duration = Duration::from_secs(1);

/// The newest frame.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FrameOrder {
    newest: Option<(u32, Instant)>,
}

impl FrameOrder {
    /// The newest frame, if `frame` is one before it that comes late. The same number again is not old: what it says
    /// is the same, or the sender does not count.
    pub(crate) fn newer_than(&self, frame: u32, now: Instant) -> Option<u32> {
        let (newest, heard) = self.newest?;
        let late = newest.wrapping_sub(frame);
        let is_old = (1..=LATE_FRAMES).contains(&late) && now.saturating_duration_since(heard) < SILENCE;
        is_old.then_some(newest)
    }

    /// Notes a frame that was taken.
    pub(crate) fn take(&mut self, frame: u32, now: Instant) {
        self.newest = Some((frame, now));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_frames_are_old_and_new_starts_are_not() {
        let now = Instant::now();
        let mut order = FrameOrder::default();
        assert_eq!(order.newer_than(7, now), None);
        order.take(1000, now);
        for (frame, is_old) in [(1001, false), (1000, false), (999, true), (744, true), (743, false), (0, false)] {
            assert_eq!(order.newer_than(frame, now).is_some(), is_old, "{frame}");
        }
        assert_eq!(order.newer_than(999, now + Duration::from_secs(2)), None);
        // Over the end of the range.
        order.take(2, now);
        assert_eq!((order.newer_than(u32::MAX, now), order.newer_than(3, now)), (Some(2), None));
    }
}
