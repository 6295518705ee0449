//! Primary visibility: which physical thing each sample of each pixel lands on.
//!
//! Reads the scene's structures; writes `Hits` (one plane a sample) and `Closest`. PAPER.md, Ray Generation; DESIGN section 2.

use lantern_gpu::{GpuError, Recorder};

use crate::bound::{Bound, Plane};
use crate::targets::Targets;
use crate::tile_lists::TileList;

/// Records the pass.
pub(crate) fn record(recorder: &mut Recorder, bound: &Bound, targets: &Targets) -> Result<(), GpuError> {
    bound.each_plane(recorder, "primary", |p: &Plane| &p.primary, |l| &l.primary, targets.listed(TileList::Seen))
}
