//! Light that does not depend on the eye: emission, and diffuse light from lights, with hard shadows, and environment.
//!
//! Reads `Hits`; writes `Light`, the mean over the samples. DESIGN section 2, The look of a point.

use lantern_gpu::{GpuError, Recorder};

use crate::projector::{Bound, Plane};

/// Records the pass.
pub(crate) fn record(recorder: &mut Recorder, bound: &Bound, groups: [u32; 3]) -> Result<(), GpuError> {
    bound.each_plane(recorder, "light", |p: &Plane| &p.light, |l| &l.light, groups)
}
