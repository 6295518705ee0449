//! From a projector's calibration to the frustum that its rays leave by.
//!
//! A projector is one matrix, clip-from-world, a lens and a resolution. Nothing here recovers a field of view, an aspect or a
//! centre from it in order to make rays ([`describe`] does so for people): the rays come from the unprojected clip
//! cube, and are exact for every invertible matrix. All arithmetic is in f64; [`GpuFrustum`] is what is left after the
//! last rounding.

mod brown_conrady;
mod clip;
pub mod describe;
pub mod doctor;
pub mod export;
pub mod formats;
mod frustum;
mod lens;
mod load;
mod maps;
mod packed;
mod packed_lens;
mod warp;
mod warp_blocks;

pub use brown_conrady::{BrownConrady, BrownConradyError, LENS_STEPS, OneToOne};
pub use clip::{Calibration, CalibrationError, Convention, Matrix4};
pub use frustum::{Frustum, Projected, Ray};
pub use lens::{Lens, LensError, Optics};
pub use load::LoadError;
pub use maps::{Map, Maps, MapsError};
pub use packed::{GpuFrustum, GpuRay};
pub use packed_lens::{GpuLens, LENS_BROWN_CONRADY, LENS_NONE, LENS_WARP};
pub use warp::{Grid, Warp, WarpError};
