//! Primary visibility: which physical thing each sample of each pixel lands on.
//!
//! Reads the scene's structures; writes `Hits` (one plane a sample) and `Closest`. PAPER.md, Ray Generation; DESIGN section 2.

use lantern_gpu::{GpuError, Recorder};

use crate::bound::Bound;
use crate::targets::Targets;
use crate::tile_lists::TileList;

/// Records the pass: a dispatch for each plane, or for a group of planes at once.
pub(crate) fn record(recorder: &mut Recorder, bound: &Bound, targets: &Targets) -> Result<(), GpuError> {
    let planes = targets.planes_a_group as usize;
    let together = bound.pipelines.samples_together.min(planes);
    recorder.span("primary", |recorder| {
        for (group, bindings) in bound.groups.iter().enumerate() {
            for first in (0..planes).step_by(together) {
                let push = [(group * planes + first) as u32, 0];
                let (pipeline, tiles) = (&bound.pipelines.primary, targets.listed(TileList::Seen));
                recorder.dispatch_indirect_at(pipeline, &bindings.primary, bytemuck::bytes_of(&push), tiles)?;
            }
        }
        Ok(())
    })
}
