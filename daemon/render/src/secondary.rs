//! Light that depends on the eye: reflection, refraction, highlights, and virtual things on the line of sight.
//!
//! Reads `Hits`; writes `Look`, what is to be added to `Light`. PAPER.md, View-dependent Rendering; Whitted, CACM 23(6), 1980.

use lantern_gpu::{GpuError, Recorder};

use crate::projector::{Bound, Plane};

/// Records the pass.
pub(crate) fn record(recorder: &mut Recorder, bound: &Bound, groups: [u32; 3]) -> Result<(), GpuError> {
    bound.each_plane(recorder, "secondary", |p: &Plane| &p.secondary, |l| &l.secondary, groups)
}
