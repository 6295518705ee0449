//! From attachments to what is shown: means of colour, closest depth, 8-bit sRGB.
//!
//! Reads the attachments; writes `Shown`, `DepthAndNode` and `Color`.

use bytemuck::{Pod, Zeroable};
use lantern_gpu::{GpuError, Recorder};

use crate::bound::Bound;

/// Twin of `Push` in `resolve.comp`; 8 bytes.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Push {
    pass: u32,
    passes: u32,
}

/// Records the `pass`-th of `passes`.
pub(crate) fn record(
    recorder: &mut Recorder,
    bound: &Bound,
    pass: u32,
    passes: u32,
    groups: [u32; 3],
) -> Result<(), GpuError> {
    let push = Push { pass, passes };
    recorder.dispatch(&bound.pipelines.resolve, &bound.resolve, bytemuck::bytes_of(&push), groups)
}
