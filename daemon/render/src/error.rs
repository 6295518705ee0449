//! What can fail in rendering.

use lantern_gpu::GpuError;

/// An error of a pass or of the renderer.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// Vulkan refused, or its device is out of memory or lost.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The number of samples is not a square from 1 to 256.
    #[error("{0} samples a pixel is not a jittered grid\nhint: use 1, 4, 9, 16, … up to 256")]
    Samples(u32),
    /// No projector of this number.
    #[error("there is no projector {0}")]
    NoProjector(usize),
    /// The eye stands where no camera can look at the props.
    #[error("the room's camera: {0}")]
    Camera(#[from] lantern_calibration::CalibrationError),
}
