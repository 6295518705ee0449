//! What a frame cost: when each pass ran, and how many rays it traced.

use std::time::Instant;

use bytemuck::{Pod, Zeroable};
use lantern_gpu::Submission;

use crate::stale::Stale;

/// Rays of one frame of one projector, by kind. Twin of `Counters` in `shaders-glsl/include/counters.glsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct RayCounts {
    /// From the projector.
    pub primary: u32,
    /// From the eye's line of sight on.
    pub secondary: u32,
    /// Toward lights.
    pub shadow: u32,
    /// Toward other projectors.
    pub blend: u32,
    /// Most loop turns of one invocation.
    pub most_steps: u32,
}

/// What a projector's frame cost.
#[derive(Clone, Debug)]
pub struct ProjectorReport {
    /// Which projector.
    pub projector: usize,
    /// From the submission to the completion that the host saw, ms.
    pub frame_ms: f64,
    /// When the host saw its completion.
    pub completed: Instant,
    /// Device time by stage, ms.
    pub stages_ms: Vec<(&'static str, f64)>,
    /// From reading the newest pose to the submission that uses it, ms.
    pub pose_to_submit_ms: f64,
    /// What was made anew.
    pub stale: Stale,
    /// Rays, where [`crate::Settings::count_rays`] asks for them.
    pub rays: Option<RayCounts>,
    /// When each pass ran on the device. Empty on a device without timestamps.
    pub timeline: Vec<Span>,
}

/// When a pass ran, ms since the frame's first work began on the device. One clock serves all queues, so that what overlaps here
/// did so there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Which.
    pub pass: &'static str,
    /// When everything before it had ended.
    pub start_ms: f64,
    /// When it had.
    pub end_ms: f64,
}

/// A frame that was rendered.
#[derive(Clone, Debug)]
pub struct FrameReport {
    /// The scene's revision that it shows.
    pub revision: u64,
    /// One for each projector that had something to do.
    pub projectors: Vec<ProjectorReport>,
    /// Bytes of meshes, images and environments that were sent beside it.
    pub uploaded_bytes: u64,
    /// When the eyes were read that it shows.
    pub read: Instant,
    /// When all of it was with the device's queues.
    pub submitted: Instant,
}

/// When the passes of a submission ran, since the first of them all began.
pub(crate) fn timeline(all: &[Submission], of: &Submission) -> Vec<Span> {
    let after = |s: &Submission| all.first().and_then(|first| s.began_after_ms(first));
    let (Some(begun), earliest) = (after(of), all.iter().filter_map(after).fold(0.0, f64::min)) else {
        return Vec::new();
    };
    let since = begun - earliest;
    let spans = of.spans().into_iter();
    spans.map(|(pass, start, end)| Span { pass, start_ms: since + start, end_ms: since + end }).collect()
}
