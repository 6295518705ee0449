//! Light that does not depend on the eye: emission, and diffuse light from lights, with hard shadows, and environment.
//!
//! Reads `Hits`; writes `Light`, the mean over the samples, and `Live`, the pixels whose look also depends on the eye. DESIGN section 2, The look of a point.

use lantern_gpu::{GpuError, Recorder};

use crate::bound::{Bound, Plane};
use crate::targets::{LIVE_EMPTY, Targets};

/// Records the pass.
pub(crate) fn record(recorder: &mut Recorder, bound: &Bound, targets: &Targets) -> Result<(), GpuError> {
    for live in &targets.live {
        recorder.upload(live, 0, bytemuck::cast_slice(&LIVE_EMPTY))?;
    }
    bound.each_plane(recorder, "light", |p: &Plane| &p.light, |l| &l.light, targets.groups())
}
