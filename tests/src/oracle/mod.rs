//! The oracle: the shaders' plain twin on the CPU, in f64, sharing nothing with them but the scene's data.
//!
//! Same names as in `shaders-glsl/`, own arithmetic: its own triangle intersection, its own acceleration structure over
//! world-space triangles, its own microfacets. It is slow, and it is what the GPU's images are compared with.
//!
//! Positions are metres in the world's own frame, not relative to the scene's origin; colours are linear RGB.

pub mod bvh;
pub mod environment;
pub mod geometry;
pub mod image;
pub mod jitter;
pub mod light;
pub mod primary;
pub mod secondary;
pub mod shade;
pub mod surface;
pub mod texture;
pub mod world;

pub use image::{Picture, Pixel, Settings, render, render_pixel};
pub use world::World;
