//! Blend weights: this projector's share of the light at the point that each pixel shows.
//!
//! Reads `Closest` and every projector's frustum; writes `Weight`. DESIGN section 2, Light from many projectors.

use lantern_gpu::{GpuError, Recorder};

use crate::projector::Bound;
use crate::targets::Targets;

/// Records the pass.
pub(crate) fn record(recorder: &mut Recorder, bound: &Bound, targets: &Targets) -> Result<(), GpuError> {
    recorder.span("blend", |recorder| {
        recorder.dispatch(&bound.pipelines.blend, &bound.blend, &[], targets.groups())
    })
}
