//! What the daemon tells those who subscribe.
//!
//! Times that end in `_s` are seconds of the system's monotonic clock (`CLOCK_MONOTONIC`), which every program of the machine
//! can read.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// One line to a subscriber.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// A projector shows a new picture.
    Frame(FrameEvent),
    /// A body was said to be elsewhere.
    Pose(PoseEvent),
    /// Another revision of the scene is shown.
    Scene(SceneEvent),
    /// A tracker fell silent, or spoke again.
    Tracker(TrackerEvent),
    /// An output came, went, or fell dark.
    Output(OutputEvent),
    /// An exported image holds a new picture.
    Export(ExportEvent),
    /// No more pictures are exported to this client.
    ExportEnd(ExportEnd),
    /// Events before this line were lost, because the subscriber reads too slowly.
    Lost(Lost),
}

/// A projector's new picture.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameEvent {
    /// The projector's name.
    pub projector: String,
    /// The frame's number.
    pub frame: u64,
    /// The scene's revision that it shows.
    pub revision: u64,
    /// Refreshes at which it was due and not ready.
    pub missed: u64,
    /// From the submission to the completion.
    pub frame_ms: f64,
    /// When it was submitted.
    pub submitted_s: f64,
    /// When it was complete.
    pub completed_s: f64,
    /// When its light was expected to leave: the time that its poses are predicted for.
    pub light_s: f64,
    /// By body: the poses that it shows, of those bodies that a source has placed.
    pub poses: BTreeMap<String, ShownPose>,
}

/// A pose as a frame shows it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ShownPose {
    /// Who said it.
    pub source: String,
    /// Its number, where the source numbers poses.
    pub sequence: Option<u32>,
    /// World, m.
    pub position_m: [f64; 3],
    /// World from body.
    pub orientation: [f64; 4],
    /// How far it was predicted ahead of its measurement; null where it is not.
    pub predicted_ms: Option<f64>,
    /// How old it was, when.
    pub age_ms: Ages,
}

/// The age of a pose on its way to the light: since its measurement where the tracker says when that was, else since its
/// receipt. Each is at least the one before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ages {
    /// When it was measured: 0, or null where the tracker does not say.
    pub measured: Option<f64>,
    /// When it was received.
    pub received: f64,
    /// When the frame that shows it was submitted.
    pub submitted: f64,
    /// When that was complete.
    pub completed: f64,
    /// When it was presented; null where the platform does not tell, such as headless.
    pub presented: Option<f64>,
}

/// What a source said of a body.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PoseEvent {
    /// The body's name.
    pub body: String,
    /// Who said it.
    pub source: String,
    /// Its number, where the source numbers poses.
    pub sequence: Option<u32>,
    /// World, m: as it was said.
    pub position_m: [f64; 3],
    /// World from body.
    pub orientation: [f64; 4],
    /// When it was measured, estimated; null where the source does not say.
    pub measured_s: Option<f64>,
    /// When it was received.
    pub received_s: f64,
}

/// A revision that is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SceneEvent {
    /// Its number.
    pub revision: u64,
    /// The first frame that shows it.
    pub frame: u64,
    /// Its nodes, visible or not.
    pub nodes: u64,
}

/// A tracker's silence, or its end.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TrackerEvent {
    /// The tracker's name.
    pub tracker: String,
    /// Which of the two.
    pub state: TrackerState,
}

/// Whether a tracker is heard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrackerState {
    /// Nothing of it was accepted for a second.
    Silent,
    /// Something was.
    Speaking,
}

/// What has become of a projector's output.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct OutputEvent {
    /// The projector's name.
    pub projector: String,
    /// How it is now.
    pub state: OutputState,
    /// Why, where it shows no picture.
    pub detail: Option<String>,
}

/// Whether an output shows its picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OutputState {
    /// It does.
    #[default]
    Shown,
    /// It is black: its pixels are not those that the picture was made for, or there is no picture yet.
    Black,
    /// It is a window without pixels, such as a minimised one.
    Hidden,
    /// It is not there.
    Lost,
}

/// A picture in an image that a client has imported, and that is the client's until it releases it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExportEvent {
    /// The projector's name.
    pub projector: String,
    /// Which image, from 0.
    pub image: usize,
    /// The frame's number.
    pub frame: u64,
    /// The scene's revision that it shows.
    pub revision: u64,
    /// The value of the timeline at which the picture is whole; null where there is no timeline, and it is whole already.
    pub value: Option<u64>,
    /// Pictures before this one for which the client had no image to spare.
    pub missed: u64,
}

/// Why a client gets no more pictures.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExportEnd {
    /// The projector's name.
    pub projector: String,
    /// In words.
    pub detail: String,
}

/// Events that a subscriber does not get.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lost {
    /// How many, since the last line.
    pub count: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_start_with_what_they_are() {
        let event = Event::Tracker(TrackerEvent { tracker: "t".into(), state: TrackerState::Silent });
        let line = serde_json::to_string(&event).unwrap();
        assert_eq!(line, r#"{"event":"tracker","tracker":"t","state":"silent"}"#);
        assert_eq!(serde_json::from_str::<Event>(&line).unwrap(), event);
        let frame = Event::Frame(FrameEvent {
            poses: [("head".to_owned(), ShownPose::default())].into(),
            ..FrameEvent::default()
        });
        let line = serde_json::to_string(&frame).unwrap();
        assert!(line.starts_with(r#"{"event":"frame","projector":"#) && line.contains(r#""presented":null"#), "{line}");
        assert_eq!(serde_json::from_str::<Event>(&line).unwrap(), frame);
    }
}
