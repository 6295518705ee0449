//! Primary visibility: which physical thing each sample of each pixel lands on.
//!
//! Reads the scene's structures; writes `Hits` (one plane a sample) and `Closest`. PAPER.md, Ray Generation; DESIGN section 2.

use lantern_gpu::{GpuError, Recorder};

use crate::bound::Bound;
use crate::targets::Targets;
use crate::tile_lists::TileList;

/// Records the pass: a dispatch for each plane, or for a group of planes at once.
pub(crate) fn record(recorder: &mut Recorder, bound: &Bound, targets: &Targets) -> Result<(), GpuError> {
    let together = bound.pipelines.samples_together.min(targets.planes_a_group);
    recorder.span("primary", |recorder| {
        let planes = (targets.planes_a_group, together);
        bound.each_plane(
            recorder,
            bound.pipelines.primary(targets.planes_a_group),
            |group| &group.primary,
            planes,
            targets.listed(TileList::Seen),
        )
    })
}
