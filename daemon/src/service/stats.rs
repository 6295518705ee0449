//! What `status` says about frames.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use hdrhistogram::Histogram;
use lantern_proto::status::{FrameTimes, OutputStatus};
use lantern_render::{ProjectorReport, Renderer};

/// One projector's frames.
#[derive(Clone, Debug)]
pub struct ProjectorStats {
    /// Pictures shown.
    pub frames: u64,
    /// Refreshes at which a newer picture was due and not ready.
    pub missed: u64,
    /// Number of the last frame in which it showed something new.
    pub frame: u64,
    /// The revision that it shows.
    pub revision: u64,
    /// Device time of the last frame by stage, ms.
    pub stages_ms: BTreeMap<String, f64>,
    /// Of the last frame, ms.
    pub pose_to_submit_ms: f64,
    /// Device memory that it has for itself.
    pub gpu_bytes: u64,
    /// Where it is shown.
    pub output: OutputStatus,
    /// Whether its picture was made coarser, so as to follow what moves.
    pub coarse: bool,
    /// Times in µs.
    times: Histogram<u32>,
}

/// Longest frame that the histogram tells apart, µs.
const LONGEST_US: u64 = 120_000_000;

impl Default for ProjectorStats {
    fn default() -> Self {
        #[expect(clippy::unwrap_used, reason = "the bounds are constants that the histogram takes")]
        let times = Histogram::new_with_bounds(1, LONGEST_US, 3).unwrap();
        let stages_ms = ["primary", "secondary", "composite"].map(|stage| (stage.to_owned(), 0.0)).into();
        Self {
            frames: 0,
            missed: 0,
            frame: 0,
            revision: 0,
            stages_ms,
            pose_to_submit_ms: 0.0,
            gpu_bytes: 0,
            output: OutputStatus::default(),
            coarse: false,
            times,
        }
    }
}

impl ProjectorStats {
    fn rendered(&mut self, report: &ProjectorReport, frame: u64, missed: u64) {
        self.frames += 1;
        self.missed += missed;
        self.frame = frame;
        self.pose_to_submit_ms = report.pose_to_submit_ms;
        // A stage that had nothing to do in this frame took no time in it.
        self.stages_ms.values_mut().for_each(|ms| *ms = 0.0);
        for (stage, ms) in &report.stages_ms {
            self.stages_ms.insert((*stage).to_owned(), *ms);
        }
        self.times.saturating_record(((report.frame_ms * 1e3) as u64).clamp(1, LONGEST_US));
    }

    /// Percentiles of the frames so far, ms.
    pub fn frame_ms(&self) -> FrameTimes {
        let at = |q| self.times.value_at_quantile(q) as f64 / 1e3;
        FrameTimes { p50: at(0.5), p95: at(0.95), max: self.times.max() as f64 / 1e3 }
    }
}

/// All projectors' frames, by name, and what they share.
#[derive(Default)]
pub struct Stats {
    projectors: Mutex<BTreeMap<String, ProjectorStats>>,
    scene_bytes: AtomicU64,
}

impl Stats {
    fn lock(&self) -> MutexGuard<'_, BTreeMap<String, ProjectorStats>> {
        self.projectors.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Starts to count for exactly the projectors of a renderer, keeping what is known of those that stay.
    pub fn set_projectors(&self, renderer: &Renderer) {
        let mut all = self.lock();
        let mut before = std::mem::take(&mut *all);
        all.extend(renderer.projectors().zip(renderer.projector_bytes()).map(|(spec, gpu_bytes)| {
            let kept = before.remove(&spec.name).unwrap_or_default();
            (spec.name.clone(), ProjectorStats { gpu_bytes, ..kept })
        }));
    }

    /// All projectors show a frame: of one moment to whoever asks. With each report by how many refreshes it came too late.
    pub fn rendered(&self, reports: &[(&str, &ProjectorReport, u64)], frame: u64, revision: u64) {
        let mut all = self.lock();
        all.values_mut().for_each(|stats| stats.revision = revision);
        for (name, report, missed) in reports {
            if let Some(stats) = all.get_mut(*name) {
                stats.rendered(report, frame, *missed);
            }
        }
    }

    /// The scene's buffers take so much of the device's memory.
    pub fn set_scene_bytes(&self, bytes: u64) {
        self.scene_bytes.store(bytes, Ordering::Relaxed);
    }

    /// Device memory that the scene's buffers take, with room that nothing uses.
    pub fn scene_bytes(&self) -> u64 {
        self.scene_bytes.load(Ordering::Relaxed)
    }

    /// Where all projectors are shown, by name, and whether coarsely.
    pub fn set_outputs<'a>(&self, outputs: impl Iterator<Item = (&'a str, OutputStatus)>, coarse: bool) {
        let mut all = self.lock();
        for (name, output) in outputs {
            if let Some(stats) = all.get_mut(name) {
                (stats.output, stats.coarse) = (output, coarse);
            }
        }
    }

    /// All projectors show `revision` with the pictures that they had.
    pub fn unchanged(&self, revision: u64, counts_as_shown: bool) {
        for stats in self.lock().values_mut() {
            stats.revision = revision;
            stats.frames += u64::from(counts_as_shown);
        }
    }

    /// Fewest pictures that any projector has shown.
    pub fn fewest_frames(&self) -> u64 {
        self.lock().values().map(|s| s.frames).min().unwrap_or(0)
    }

    /// All of it.
    pub fn all(&self) -> BTreeMap<String, ProjectorStats> {
        self.lock().clone()
    }
}
