//! `status`'s answer.
//!
//! The contract's example is the least that it holds; readers skip what they do not know.

use crate::event::OutputState;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// How the daemon does.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// The daemon's version.
    pub version: String,
    /// Since the process started.
    pub uptime_s: f64,
    /// What it was told to do.
    #[serde(default)]
    pub config: ConfigStatus,
    /// What renders.
    pub device: DeviceStatus,
    /// What is rendered.
    pub scene: SceneStatus,
    /// By name: what trackers move.
    pub bodies: BTreeMap<String, BodyStatus>,
    /// By name.
    pub trackers: BTreeMap<String, TrackerStatus>,
    /// By name.
    pub projectors: BTreeMap<String, ProjectorStatus>,
}

/// The configuration.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ConfigStatus {
    /// The file, as `lanternd run -c` was told.
    pub path: String,
    /// Whether the file is what is in use; false: it was wrong when it was last read, and an earlier one is in use.
    pub good: bool,
    /// What is wrong with it, as it was last read.
    pub problem: Option<String>,
}

/// The Vulkan device.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DeviceStatus {
    /// As the driver says.
    pub name: String,
    /// Driver's name and version.
    pub driver: String,
    /// `cpu`, `integrated`, `discrete`, `virtual` or `other`.
    pub kind: String,
    /// How often it was lost or hung since the start, and opened again.
    #[serde(default)]
    pub lost: u64,
    /// Messages of the validation layer so far; absent where the layer is off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub validation_messages: Option<u64>,
}

/// The scene's size.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneStatus {
    /// Grows with each edit that is applied.
    pub revision: u64,
    /// Nodes, visible or not.
    pub nodes: u64,
    /// Triangles of all nodes.
    pub triangles: u64,
    /// Device memory that its buffers and structures take, with what they have to spare.
    pub bytes: u64,
    /// The world position that device coordinates are relative to.
    #[serde(default)]
    pub origin_m: [f64; 3],
}

/// A body's last pose.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BodyStatus {
    /// World, m.
    pub position_m: [f64; 3],
    /// World from body, unit quaternion.
    pub orientation: [f64; 4],
    /// The tracker's name, `socket`, or `config` until anything speaks.
    pub source: String,
    /// Since it was said.
    pub age_ms: f64,
}

/// A tracker's counters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrackerStatus {
    /// As in the configuration.
    pub protocol: String,
    /// Packets that were taken, whether or not they moved a body.
    pub accepted: u64,
    /// Packets that were dropped: bad ones, from a stranger, for an unknown body, or older than the last.
    pub rejected: u64,
    /// Why the last one was.
    pub last_reject: Option<String>,
    /// Accepted packets a second, over the last second.
    pub rate_hz: f64,
    /// Those of them that were good, but not newer than the last.
    #[serde(default)]
    pub dropped_old: u64,
    /// Where it listens.
    #[serde(default)]
    pub listen: String,
    /// Packets that came to this machine and were thrown away by the system, because the daemon had not taken them in
    /// time; absent where the system does not tell.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kernel_dropped: Option<u64>,
    /// Frames of several packets of which one did not come; none of such a frame moves anything.
    #[serde(default)]
    pub incomplete: u64,
    /// What the tracker says of each body of ours, by its own id.
    #[serde(default)]
    pub bodies: BTreeMap<String, TrackedStatus>,
    /// What it says besides.
    #[serde(default)]
    pub others: OthersStatus,
}

/// A body as a tracker sees it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrackedStatus {
    /// Our name of it.
    pub body: String,
    /// Whether the tracker saw it when it last spoke of it, or of all that it sees. A body that is lost keeps its pose.
    pub tracked: bool,
    /// Since its last pose; absent before the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub age_ms: Option<f64>,
}

/// What a tracker says that is good and of no use.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct OthersStatus {
    /// Packets about something else than bodies; neither accepted nor rejected.
    pub packets: u64,
    /// What the last one was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last: Option<String>,
    /// The tracker's ids of bodies that `bodies` does not have, the first few of them.
    pub bodies: Vec<String>,
}

/// A projector's output.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OutputStatus {
    /// Whether it shows the picture.
    pub state: OutputState,
    /// Why it does not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detail: Option<String>,
    /// The server of a window, the connector of a display.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub place: String,
    /// What its pixels are made of: `8-bit`, `10-bit` or `hdr10`.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub pixels: String,
    /// How often it shows another image.
    pub refresh_hz: f64,
    /// Of an export: how many clients have its images.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub readers: Option<u64>,
    /// Of an export: pictures that a client has missed because it held all of its images.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub readers_missed: Option<u64>,
}

/// A projector's state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ProjectorStatus {
    /// Width and height.
    pub resolution_px: [u32; 2],
    /// `headless`, `window`, `display` or `export`.
    pub output: String,
    /// How that is.
    #[serde(default)]
    pub screen: OutputStatus,
    /// Whether what it shows was made coarser, so as to follow what moves.
    #[serde(default)]
    pub coarse: bool,
    /// Shown since the start.
    pub frames: u64,
    /// Frames that came too late to be shown.
    pub missed: u64,
    /// Where its work is submitted.
    pub queue: QueueStatus,
    /// From the start of a frame to its end.
    pub frame_ms: FrameTimes,
    /// By stage: the last frame's time on the device; `primary`, `secondary` and `composite` at least.
    pub stages_ms: BTreeMap<String, f64>,
    /// From reading the pose to the submission that uses it, last frame.
    pub pose_to_submit_ms: f64,
    /// Device memory that it has for itself; the scene's is shared.
    #[serde(default)]
    pub gpu_bytes: u64,
    /// The scene's revision that is shown.
    #[serde(default)]
    pub revision: u64,
    /// The number of the frame that is shown.
    #[serde(default)]
    pub frame: u64,
    /// By body: how old its poses were on their way, over the last frames that showed them.
    #[serde(default)]
    pub latency_ms: BTreeMap<String, Latency>,
}

/// How old a body's poses were, when (see [`Ages`](crate::event::Ages)), ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Latency {
    /// When they were received; null where the tracker does not say when they were measured, since ages count from here then.
    pub received: Option<Percentiles>,
    /// When the frame was submitted.
    pub submitted: Percentiles,
    /// When it was complete.
    pub completed: Percentiles,
    /// When it was presented; null where the platform does not tell.
    pub presented: Option<Percentiles>,
    /// Over how many frames.
    pub frames: u64,
}

/// Percentiles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 95th percentile.
    pub p95: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Greatest.
    pub max: f64,
}

/// A queue of the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct QueueStatus {
    /// Index of the family.
    pub family: u32,
    /// Index in the family.
    pub index: u32,
    /// Whether other projectors submit to it too.
    pub shared: bool,
}

/// Percentiles of frame times, ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameTimes {
    /// Median.
    pub p50: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Longest.
    pub max: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The contract's example, to the letter.
    const EXAMPLE: &str = r#"{"version": "…", "uptime_s": 1.0, "device": {"name": "…", "driver": "…", "kind": "cpu"},
 "scene": {"revision": 3, "nodes": 5, "triangles": 70000, "bytes": 123},
 "bodies": {"head": {"position_m": [0,1.7,2.5], "orientation": [0,0,0,1], "source": "optitrack", "age_ms": 4.1}},
 "trackers": {"optitrack": {"protocol": "lantern", "accepted": 100, "rejected": 2, "last_reject": "…", "rate_hz": 120.0}},
 "projectors": {"left": {"resolution_px": [1280,800], "output": "headless", "frames": 10, "missed": 0,
   "queue": {"family": 0, "index": 0, "shared": true}, "frame_ms": {"p50": 1.0, "p95": 2.0, "max": 3.0},
   "stages_ms": {"primary": 0.0, "secondary": 1.0, "composite": 0.2}, "pose_to_submit_ms": 0.4}}}"#;

    /// Every path to a leaf; arrays are leaves.
    fn paths(prefix: &str, value: &serde_json::Value, out: &mut Vec<String>) {
        match value.as_object() {
            Some(map) => map.iter().for_each(|(key, value)| paths(&format!("{prefix}.{key}"), value, out)),
            None => out.push(prefix.to_owned()),
        }
    }

    #[test]
    fn holds_everything_that_the_contract_names() {
        let status: Status = serde_json::from_str(EXAMPLE).unwrap();
        let (mut asked, mut given) = (Vec::new(), Vec::new());
        paths("", &serde_json::from_str(EXAMPLE).unwrap(), &mut asked);
        paths("", &serde_json::to_value(&status).unwrap(), &mut given);
        for path in asked {
            assert!(given.contains(&path), "{path} is missing from {given:?}");
        }
        assert_eq!(serde_json::from_str::<Status>(&serde_json::to_string(&status).unwrap()).unwrap(), status);
    }
}
