//! The ledger of latency: how old the poses of each frame were on their way to the light.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use lantern_proto::event::{Ages, ShownPose};
use lantern_proto::status::{Latency, Percentiles};
use lantern_tracking::{BodyPose, Placed};

/// Percentiles are of so many frames, the last ones that showed a body.
const FRAMES: usize = 1000;

/// A pose that was heard so long ago says how long its body has been silent, not how long anything takes, ms.
const SILENT_MS: f64 = 1000.0;

/// The ages of one body's poses in the last frames of one projector.
#[derive(Clone, Debug, Default)]
struct Recent {
    ages: VecDeque<Ages>,
    /// When the last of these frames was complete, until it was seen on its screen.
    completed: Option<Instant>,
}

impl Recent {
    fn add(&mut self, ages: Ages, completed: Instant) {
        if self.ages.len() == FRAMES {
            self.ages.pop_front();
        }
        self.ages.push_back(ages);
        self.completed = Some(completed);
    }

    fn presented(&mut self, at: Instant) {
        if let (Some(completed), Some(last)) = (self.completed.take(), self.ages.back_mut()) {
            last.presented = Some(last.completed + at.saturating_duration_since(completed).as_secs_f64() * 1e3);
        }
    }

    fn latency(&self) -> Latency {
        let of = |age: fn(&Ages) -> Option<f64>| percentiles(self.ages.iter().filter_map(age).collect());
        Latency {
            received: of(|ages| ages.measured.map(|_| ages.received)),
            submitted: of(|ages| Some(ages.submitted)).unwrap_or_default(),
            completed: of(|ages| Some(ages.completed)).unwrap_or_default(),
            presented: of(|ages| ages.presented),
            frames: self.ages.len() as u64,
        }
    }
}

/// The nearest ranks; `None` of nothing.
fn percentiles(mut values: Vec<f64>) -> Option<Percentiles> {
    values.sort_unstable_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    let at = |share: f64| values[((share * values.len() as f64).ceil() as usize).saturating_sub(1).min(last)];
    Some(Percentiles { p50: at(0.5), p95: at(0.95), p99: at(0.99), max: values[last] })
}

/// By projector and body.
type Books = BTreeMap<String, BTreeMap<String, Recent>>;

/// What is kept of all frames' poses; of a bounded size.
#[derive(Debug, Default)]
pub struct Ledger(Mutex<Books>);

impl Ledger {
    fn lock(&self) -> MutexGuard<'_, Books> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Forgets the projectors and bodies that are none any more.
    pub fn keep(&self, projectors: &[&str], bodies: &[&str]) {
        let mut books = self.lock();
        books.retain(|projector, _| projectors.contains(&projector.as_str()));
        books.values_mut().for_each(|of| of.retain(|body, _| bodies.contains(&body.as_str())));
    }

    /// A projector's frame of these poses was complete.
    pub fn record(&self, projector: &str, poses: &BTreeMap<String, ShownPose>, completed: Instant) {
        let mut books = self.lock();
        for (body, pose) in poses {
            if pose.age_ms.submitted - pose.age_ms.received <= SILENT_MS {
                let of = books.entry(projector.to_owned()).or_default();
                of.entry(body.clone()).or_default().add(pose.age_ms, completed);
            }
        }
    }

    /// The last frame of a projector was seen on its screen.
    pub fn presented(&self, projector: &str, at: Instant) {
        let mut books = self.lock();
        let Some(of) = books.get_mut(projector) else { return };
        for recent in of.values_mut() {
            recent.presented(at);
        }
    }

    /// For `status`, by body.
    pub fn latency(&self, projector: &str) -> BTreeMap<String, Latency> {
        // Sorting is for whoever asks, not for the frame thread that may wait for the lock.
        let of = self.lock().get(projector).cloned().unwrap_or_default();
        of.iter().map(|(body, recent)| (body.clone(), recent.latency())).collect()
    }
}

/// The poses of a frame that was `submitted` and `completed`: of those bodies that a source has placed.
pub fn shown_poses(placed: &[Placed], submitted: Instant, completed: Instant) -> BTreeMap<String, ShownPose> {
    let heard = placed.iter().filter(|placed| placed.pose.is_heard());
    let shown = |placed: &Placed| ShownPose {
        source: placed.pose.source.to_string(),
        sequence: placed.pose.sequence,
        position_m: placed.pose.position_m.to_array(),
        orientation: placed.pose.orientation.to_array(),
        predicted_ms: placed.ahead.map(|ahead| ahead.as_secs_f64() * 1e3),
        age_ms: ages(&placed.pose, submitted, completed),
    };
    heard.map(|placed| (placed.body.clone(), shown(placed))).collect()
}

fn ages(pose: &BodyPose, submitted: Instant, completed: Instant) -> Ages {
    let born = pose.measured.unwrap_or(pose.received);
    let age = |moment: Instant| moment.saturating_duration_since(born).as_secs_f64() * 1e3;
    Ages {
        measured: pose.measured.map(age),
        received: age(pose.received),
        submitted: age(submitted),
        completed: age(completed),
        presented: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use lantern_config::Drives;
    use std::sync::Arc;
    use std::time::Duration;

    fn placed(source: &str, measured: Option<Instant>, received: Instant) -> Placed {
        let pose = BodyPose {
            position_m: DVec3::X,
            orientation: DQuat::IDENTITY,
            velocity_m_s: None,
            offset_m: DVec3::Y,
            source: Arc::from(source),
            received,
            sequence: Some(7),
            measured_ns: None,
            measured,
        };
        Placed { body: "head".into(), drives: Drives::Viewer, pose, ahead: Some(Duration::from_millis(40)) }
    }

    #[test]
    fn ages_count_from_the_measurement_or_else_from_the_receipt() {
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        let rounded = |ages: Ages| [ages.received, ages.submitted, ages.completed].map(|ms| ms.round() as i64);
        let poses = shown_poses(&[placed("optitrack", Some(at(0)), at(31))], at(40), at(52));
        let head = &poses["head"];
        assert_eq!((head.age_ms.measured, rounded(head.age_ms)), (Some(0.0), [31, 40, 52]));
        assert_eq!((head.sequence, head.predicted_ms, head.position_m), (Some(7), Some(40.0), [1.0, 0.0, 0.0]));
        let poses = shown_poses(&[placed("optitrack", None, at(31))], at(40), at(52));
        assert_eq!((poses["head"].age_ms.measured, rounded(poses["head"].age_ms)), (None, [0, 9, 21]));
        // A pose that the configuration gives has no age.
        assert!(shown_poses(&[placed("config", None, at(31))], at(40), at(52)).is_empty());
    }

    #[test]
    fn percentiles_are_of_the_last_frames_of_bodies_that_are_heard() {
        let (ledger, start) = (Ledger::default(), Instant::now());
        let record = |submitted: f64| {
            let age_ms =
                Ages { measured: Some(0.0), received: 1.0, submitted, completed: submitted + 10.0, presented: None };
            let pose = ShownPose { age_ms, ..ShownPose::default() };
            ledger.record("left", &[("head".to_owned(), pose)].into(), start);
        };
        // Those that fell out count no more, nor does a silent body.
        (0..50).for_each(|_| record(900.0));
        (1..=FRAMES).for_each(|frame| record(frame as f64 / 10.0));
        record(5000.0);
        let head = ledger.latency("left")["head"];
        assert_eq!(head.submitted, Percentiles { p50: 50.0, p95: 95.0, p99: 99.0, max: 100.0 });
        assert_eq!(head.completed.p50, 60.0);
        assert_eq!((head.received.unwrap().max, head.presented, head.frames), (1.0, None, 1000));
        // What was seen on its screen was seen once, after it was complete.
        ledger.presented("left", start + Duration::from_millis(7));
        ledger.presented("left", start + Duration::from_millis(99));
        let head = ledger.latency("left")["head"];
        assert_eq!(head.presented, Some(Percentiles { p50: 117.0, p95: 117.0, p99: 117.0, max: 117.0 }));
        assert!(ledger.latency("right").is_empty());
        ledger.keep(&["left"], &["hand"]);
        assert!(ledger.latency("left").is_empty());
    }

    #[test]
    fn few_values_have_percentiles_too() {
        assert_eq!(percentiles(vec![]), None);
        assert_eq!(percentiles(vec![3.0]), Some(Percentiles { p50: 3.0, p95: 3.0, p99: 3.0, max: 3.0 }));
        assert_eq!(percentiles(vec![2.0, 1.0]), Some(Percentiles { p50: 1.0, p95: 2.0, p99: 2.0, max: 2.0 }));
    }
}
