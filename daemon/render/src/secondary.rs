//! Light that depends on the eye: reflection, refraction, highlights, and virtual things on the line of sight.
//!
//! Reads `Hits` and `Live`, the list of the pixels that there is anything to do for; writes `Look`, what is to be added to `Light`. PAPER.md, View-dependent Rendering; Whitted, CACM 23(6), 1980.

use lantern_gpu::{GpuError, Recorder};

use crate::bound::Bound;
use crate::targets::Targets;

/// Records the pass.
pub(crate) fn record(recorder: &mut Recorder, bound: &Bound, targets: &Targets) -> Result<(), GpuError> {
    recorder.span("secondary", |recorder| {
        recorder.fill(&targets.look, 0)?;
        for ((sample, plane), live) in bound.planes().zip(&targets.live) {
            let push = [sample, 0];
            let pipeline = &bound.pipelines.secondary;
            recorder.dispatch_indirect(pipeline, &plane.secondary, bytemuck::bytes_of(&push), live)?;
        }
        Ok(())
    })
}
