//! Blend weights: this projector's share of the light at the point that each pixel shows.
//!
//! Reads `Closest`, and every projector's frustum and `Edge`; writes `Weight`. DESIGN section 2, Light from many projectors.

use lantern_gpu::{GpuError, Recorder};

use crate::bound::Bound;
use crate::targets::Targets;
use crate::tile_lists::TileList;

/// Records the pass: its own part first, then that of every other projector with which it shares its light. `shares` says which do
/// so at all: none does without blending, nor one whose alpha map says its share.
pub(crate) fn record(
    recorder: &mut Recorder,
    bound: &Bound,
    targets: &Targets,
    own: usize,
    shares: &[bool],
) -> Result<(), GpuError> {
    recorder.span("blend", |recorder| {
        let others = (0..bound.blend.len()).filter(|index| shares[own] && shares[*index] && *index != own);
        for index in std::iter::once(own).chain(others) {
            let push = [0, index as u32];
            let bindings = &bound.blend[index];
            let (push, tiles) = (bytemuck::bytes_of(&push), targets.listed(TileList::Shared));
            recorder.dispatch_indirect_at(&bound.pipelines.blend, bindings, push, tiles)?;
        }
        Ok(())
    })
}
