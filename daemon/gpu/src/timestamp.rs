//! Times of a recording's spans, from timestamp queries.

use ash::vk;

use crate::encoder::Encoder;
use crate::handle::Limits;

/// A span: its name, and the queries at its beginning and its end.
pub(crate) type Span = (&'static str, u32, u32);

/// A span in time: its name, beginning and end, in ms since its recording began on the device.
pub(crate) type TimedSpan = (&'static str, f64, f64);

/// The times of a recording.
#[derive(Clone, Default)]
pub(crate) struct Times {
    /// When it began, by the device's own clock, which all its queues share; in ticks. None on a device without timestamps.
    pub(crate) began: Option<u64>,
    pub(crate) spans: Vec<TimedSpan>,
}

/// Reads the times of `spans` from a completed encoder, whose query 0 is the beginning.
///
/// # Safety
/// The encoder has completed, and all queries up to the last of `spans` were written in it.
pub(crate) unsafe fn times(encoder: &Encoder, spans: &[Span]) -> Times {
    let used = spans.iter().map(|&(_, first, last)| first.max(last) + 1).max().unwrap_or(0);
    if encoder.queries == vk::QueryPool::null() || used == 0 {
        return Times::default();
    }

    // Each query answers with its value and whether it is there, so that nothing is ever waited for.
    let mut answers = vec![[0u64; 2]; used as usize];
    let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WITH_AVAILABILITY;
    // SAFETY: the pool lives and has these queries, each reset and then written; an answer is two 64-bit words.
    let read = unsafe { encoder.device.raw.get_query_pool_results(encoder.queries, 0, &mut answers, flags) };
    if let Err(result) = read {
        tracing::warn!(?result, "timestamps could not be read");
        return Times::default();
    }
    let limits = &encoder.device.limits;
    let tick = |query: u32| answers.get(query as usize).filter(|answer| answer[1] != 0).map(|answer| answer[0]);
    let timed = |&(name, first, last): &Span| {
        let began = tick(0)?;
        Some((name, ms_between(limits, began, tick(first)?), ms_between(limits, began, tick(last)?)))
    };
    Times { began: tick(0), spans: spans.iter().filter_map(timed).collect() }
}

/// Milliseconds from one tick to a later one, of a counter that may have fewer than 64 bits and wrap.
fn ms_between(limits: &Limits, from: u64, to: u64) -> f64 {
    let mask = u64::MAX.checked_shr(64u32.saturating_sub(limits.timestamp_valid_bits)).unwrap_or(0);
    (to.wrapping_sub(from) & mask) as f64 * f64::from(limits.timestamp_period_ns) * 1e-6
}

/// The same, and negative where the second tick is the earlier one: they lie less than half the counter's range apart.
pub(crate) fn signed_ms_between(limits: &Limits, from: u64, to: u64) -> f64 {
    let (after, before) = (ms_between(limits, from, to), ms_between(limits, to, from));
    if before < after { -before } else { after }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits(timestamp_valid_bits: u32) -> Limits {
        Limits { timestamp_period_ns: 2.0, timestamp_valid_bits, ..Limits::default() }
    }

    #[test]
    fn ticks_become_milliseconds() {
        assert!((ms_between(&limits(64), 1_000_000, 4_000_000) - 6.0).abs() < 1e-9);
    }

    #[test]
    fn what_began_earlier_lies_before() {
        for bits in [36, 64] {
            let limits = limits(bits);
            assert!((signed_ms_between(&limits, 4_000_000, 1_000_000) + 6.0).abs() < 1e-9);
            assert!((signed_ms_between(&limits, 1_000_000, 4_000_000) - 6.0).abs() < 1e-9);
        }
    }

    #[test]
    fn a_counter_that_wraps_still_tells_time() {
        assert!((ms_between(&limits(36), (1 << 36) - 500_000, 500_000) - 2.0).abs() < 1e-9);
    }
}
