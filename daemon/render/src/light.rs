//! Light that does not depend on the eye: emission, and diffuse light from lights, with hard shadows, and environment.
//!
//! Reads `Hits`; writes `Light`, the mean over the samples, and `Class`, whether the look of the pixel also depends on the eye.
//! DESIGN section 2, The look of a point.

use lantern_gpu::{GpuError, Recorder};

use crate::bound::{Bound, Plane};
use crate::targets::Targets;
use crate::tile_lists::TileList;

/// Records the pass.
pub(crate) fn record(recorder: &mut Recorder, bound: &Bound, targets: &Targets) -> Result<(), GpuError> {
    bound.each_plane(recorder, "light", |p: &Plane| &p.light, |l| &l.light, targets.listed(TileList::Lit))
}
