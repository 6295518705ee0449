//! From a projector's calibration to the frustum that its rays leave by.
//!
//! A projector is one matrix, clip-from-world, and a resolution. Nothing here recovers a field of view, an aspect or a
//! centre from it in order to make rays ([`describe`] does so for people): the rays come from the unprojected clip
//! cube, and are exact for every invertible matrix. All arithmetic is in f64; [`GpuFrustum`] is what is left after the
//! last rounding.

mod clip;
pub mod describe;
mod frustum;
mod packed;

pub use clip::{Calibration, CalibrationError, Convention, Matrix4};
pub use frustum::{Frustum, Projected, Ray};
pub use packed::{GpuFrustum, GpuRay};
