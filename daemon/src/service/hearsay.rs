//! What subscribers are told of bodies and trackers.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use lantern_proto::EventKind;
use lantern_proto::event::{Event, PoseEvent, TrackerEvent, TrackerState};
use lantern_proto::status::TrackerStatus;
use lantern_tracking::{Bodies, BodyPose};

use super::monotonic;
use crate::control::{Engine, Events};

/// How often trackers are looked at while anybody wants to hear of them.
const LOOK: Duration = Duration::from_millis(250);

/// Tells of every pose from now on.
pub fn of_bodies(bodies: &Bodies, events: Arc<Events>) {
    bodies.set_listener(Arc::new(move |body, pose| {
        if events.are_wanted(EventKind::Pose) {
            events.tell(EventKind::Pose, Event::Pose(told(body, pose)));
        }
    }));
}

fn told(body: &str, pose: &BodyPose) -> PoseEvent {
    PoseEvent {
        body: body.to_owned(),
        source: pose.source.to_string(),
        sequence: pose.sequence,
        position_m: pose.position_m.to_array(),
        orientation: pose.orientation.to_array(),
        measured_s: pose.measured.map(monotonic::seconds),
        received_s: monotonic::seconds(pose.received),
    }
}

/// Tells of trackers that fall silent or speak again, for ever. While nobody wants to hear of them it sleeps.
pub async fn of_trackers(engine: Arc<dyn Engine>) {
    let events = engine.events().clone();
    loop {
        events.wanted(EventKind::Tracker).await;
        let mut known = BTreeMap::new();
        while events.are_wanted(EventKind::Tracker) {
            for event in changes(&mut known, &engine.trackers()) {
                events.tell(EventKind::Tracker, Event::Tracker(event));
            }
            tokio::time::sleep(LOOK).await;
        }
    }
}

/// What has changed since the last look. A tracker that is seen for the first time has not.
fn changes(
    known: &mut BTreeMap<String, TrackerState>,
    trackers: &BTreeMap<String, TrackerStatus>,
) -> Vec<TrackerEvent> {
    let state = |status: &TrackerStatus| match status.rate_hz {
        // The rate is that of the last second.
        rate_hz if rate_hz > 0.0 => TrackerState::Speaking,
        _ => TrackerState::Silent,
    };
    let now: BTreeMap<_, _> = trackers.iter().map(|(name, status)| (name.clone(), state(status))).collect();
    let changed = now.iter().filter(|(name, state)| known.get(*name).is_some_and(|before| before != *state));
    let changed = changed.map(|(name, state)| TrackerEvent { tracker: name.clone(), state: *state }).collect();
    *known = now;
    changed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_changes_are_told() {
        let trackers = |rates: &[(&str, f64)]| {
            let status = |rate_hz| TrackerStatus { rate_hz, ..TrackerStatus::default() };
            rates.iter().map(|(name, rate_hz)| ((*name).to_owned(), status(*rate_hz))).collect::<BTreeMap<_, _>>()
        };
        let mut known = BTreeMap::new();
        let mut told = |rates: &[(&str, f64)]| -> Vec<_> {
            changes(&mut known, &trackers(rates)).into_iter().map(|event| (event.tracker, event.state)).collect()
        };
        assert_eq!(told(&[("a", 120.0), ("b", 0.0)]), []);
        assert_eq!(told(&[("a", 119.0), ("b", 0.0)]), []);
        assert_eq!(
            told(&[("a", 0.0), ("b", 1.0)]),
            [("a".into(), TrackerState::Silent), ("b".into(), TrackerState::Speaking)]
        );
        // One that was not there before has not fallen silent, nor has one that has gone.
        assert_eq!(told(&[("b", 1.0), ("c", 0.0)]), []);
    }
}
