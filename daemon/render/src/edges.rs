//! Occlusion edges: how far each pixel is from where this projector's light ends behind something nearer.
//!
//! Reads `Closest`; writes `Edge`, which the blend pass of every projector reads. DESIGN section 2, Light from many projectors.

use lantern_gpu::{GpuError, Recorder};

use crate::bound::Bound;
use crate::targets::Targets;
use crate::tile_lists::TileList;

/// Marking, rows, columns.
const PASSES: u32 = 3;

/// Records the pass.
pub(crate) fn record(recorder: &mut Recorder, bound: &Bound, targets: &Targets) -> Result<(), GpuError> {
    recorder.span("edges", |recorder| {
        for pass in 0..PASSES {
            let list = if pass + 1 == PASSES { TileList::Edged } else { TileList::Marked };
            let (push, tiles) = (bytemuck::bytes_of(&pass), targets.listed(list));
            recorder.dispatch_indirect_at(&bound.pipelines.edges, &bound.edges, push, tiles)?;
        }
        Ok(())
    })
}
