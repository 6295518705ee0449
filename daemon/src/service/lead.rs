//! How far ahead the bodies' poses have to be: when the light of the frame that is being made leaves the projectors.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// The median of so many frames is what the next one is taken to need: a frame of an edit among those of a moving head, or the
/// first with new pipelines, says nothing of the next.
const FRAMES: usize = 15;

/// The last frames' times, of which the middle one counts.
#[derive(Debug, Default)]
struct Recent(VecDeque<Duration>);

impl Recent {
    fn add(&mut self, time: Duration) {
        if self.0.len() == FRAMES {
            self.0.pop_front();
        }
        self.0.push_back(time);
    }

    fn median(&self) -> Duration {
        let mut sorted: Vec<_> = self.0.iter().copied().collect();
        sorted.sort_unstable();
        sorted.get(sorted.len() / 2).copied().unwrap_or_default()
    }
}

/// Foretells when a frame's light leaves, from the frames before it: their completion, and what the outputs are said to take
/// after that.
///
/// All projectors of a frame show the bodies at one moment, so that no two disagree about when it is: that of the slowest.
#[derive(Debug, Default)]
pub struct Lead {
    from_beginning: Recent,
    from_reading: Recent,
    output_latency: Duration,
}

impl Lead {
    /// What the slowest output takes from a frame's completion to its light.
    pub fn new(output_latency: Duration) -> Self {
        Self { output_latency, ..Self::default() }
    }

    /// Another time for the slowest output; what frames take is still known.
    pub fn set_output_latency(&mut self, output_latency: Duration) {
        self.output_latency = output_latency;
    }

    /// The light of a frame that begins now.
    pub fn light_of_frame(&self, begins: Instant) -> Instant {
        begins + self.from_beginning.median() + self.output_latency
    }

    /// The light of a frame whose poses are read now, right before it is submitted.
    pub fn light_of_submission(&self, read: Instant) -> Instant {
        read + self.from_reading.median() + self.output_latency
    }

    /// A frame was completed.
    pub fn completed(&mut self, began: Instant, read: Instant, completed: Instant) {
        self.from_beginning.add(completed.saturating_duration_since(began));
        self.from_reading.add(completed.saturating_duration_since(read));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_next_frame_is_like_most_of_the_last() {
        let ms = Duration::from_millis;
        let mut lead = Lead::new(ms(20));
        let now = Instant::now();
        assert_eq!(lead.light_of_submission(now), now + ms(20));
        // The first frame makes pipelines, and one in five has an edit.
        for frame in 0..40u64 {
            let rendering = if frame == 0 { 900 } else { 8 + frame % 3 + 50 * u64::from(frame % 5 == 4) };
            lead.completed(now, now + ms(2), now + ms(2 + rendering));
        }
        assert_eq!(lead.light_of_submission(now), now + ms(20 + 9));
        assert_eq!(lead.light_of_frame(now), now + ms(20 + 2 + 9));
    }
}
