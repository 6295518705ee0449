//! Light that does not depend on the eye: emission, and diffuse light from lights, with hard shadows, and environment.
//!
//! Reads `Hits`; writes `Light`, the mean over the samples, and `Class`, whether the look of the pixel also depends on the eye.
//! DESIGN section 2, The look of a point.

use lantern_gpu::{GpuError, Recorder};

use crate::bound::Bound;
use crate::targets::Targets;
use crate::tile_lists::TileList;

/// Records the pass: one dispatch a sample plane, so that no invocation does more than one sample, which keeps its loops far below
/// the 65,535 turns after which lavapipe 22.3 ends them silently.
pub(crate) fn record(recorder: &mut Recorder, bound: &Bound, targets: &Targets) -> Result<(), GpuError> {
    recorder.span("light", |recorder| {
        let planes = (targets.planes_a_group, 1);
        bound.each_plane(recorder, &bound.pipelines.light, |group| &group.light, planes, targets.listed(TileList::Lit))
    })
}
