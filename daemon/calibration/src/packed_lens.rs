//! A lens as the GPU reads it.

use bytemuck::{Pod, Zeroable};
use glam::UVec2;

use crate::lens::Optics;
use crate::{Calibration, Grid};

/// From node to node of the grid that leads back through a warp, ideal px.
const INVERSE_STEP_PX: f64 = 8.0;

/// Values of [`GpuLens::kind`]; twins of `LENS_*` in `shaders-glsl/include/lens.glsl`.
pub const LENS_NONE: u32 = 0;
/// OpenCV's distortion.
pub const LENS_BROWN_CONRADY: u32 = 1;
/// A measured warp.
pub const LENS_WARP: u32 = 2;

/// A lens; 96 bytes, std430. Its twin is `GpuLens` in `shaders-glsl/include/lens.glsl`. What a kind does not need is 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct GpuLens {
    /// Focal lengths, px.
    pub focal_px: [f32; 2],
    /// The distortion's centre, continuous px.
    pub centre_px: [f32; 2],
    /// OpenCV's first four coefficients.
    pub k1_k2_p1_p2: [f32; 4],
    /// And its fifth.
    pub k3: f32,
    /// Radius of the disc of ideal places on which the model holds, focal lengths.
    pub reach: f32,
    /// [`LENS_NONE`], [`LENS_BROWN_CONRADY`] or [`LENS_WARP`].
    pub kind: u32,
    /// 1 where an alpha map says what the projector's share of the light is.
    pub has_alpha: u32,
    /// The warp's columns and rows.
    pub nodes: [u32; 2],
    /// Those of the grid that leads back.
    pub inverse_nodes: [u32; 2],
    /// The warp's nodes a pixel.
    pub nodes_a_px: [f32; 2],
    /// Where the inverse grid's first node lies in the ideal image, px.
    pub inverse_low_px: [f32; 2],
    /// From one of its nodes to the next, px.
    pub inverse_step_px: f32,
    /// The warp's first texel: ideal place, and 1 where the node is lit.
    pub first_texel: u32,
    /// The inverse grid's first texel: real place, and 1 where it is known.
    pub inverse_first_texel: u32,
    /// Zero.
    pub pad0: u32,
}

impl GpuLens {
    /// Packs a calibration's lens; what it reads beside itself is appended to `texels`.
    pub fn new(calibration: &Calibration, texels: &mut Vec<[f32; 4]>) -> Self {
        let has_alpha = u32::from(calibration.maps().alpha.is_some());
        match calibration.optics() {
            Optics::Pinhole => Self { kind: LENS_NONE, has_alpha, ..Self::default() },
            Optics::BrownConrady(one_to_one) => {
                let model = one_to_one.model();
                Self {
                    focal_px: model.focal_px.as_vec2().to_array(),
                    centre_px: model.centre_px.as_vec2().to_array(),
                    k1_k2_p1_p2: [model.k1, model.k2, model.p1, model.p2].map(|k| k as f32),
                    k3: model.k3 as f32,
                    reach: one_to_one.reach() as f32,
                    kind: LENS_BROWN_CONRADY,
                    has_alpha,
                    ..Self::default()
                }
            }
            Optics::Warp(grid) => Self { has_alpha, ..Self::of_warp(grid, calibration.resolution_px(), texels) },
        }
    }

    fn of_warp(grid: &Grid, resolution_px: UVec2, texels: &mut Vec<[f32; 4]>) -> Self {
        let resolution_px = resolution_px.as_dvec2();
        let inverse = grid.inverse(resolution_px, INVERSE_STEP_PX);
        let first_texel = texels.len() as u32;
        texels.extend(grid.nodes().map(|(at, lit)| [at.x, at.y, f32::from(u8::from(lit)), 0.0]));
        let inverse_first_texel = texels.len() as u32;
        texels.extend(inverse.real_px.iter().map(|at| if at.is_nan() { [0.0; 4] } else { [at.x, at.y, 1.0, 0.0] }));
        Self {
            kind: LENS_WARP,
            nodes: grid.warp().size.to_array(),
            inverse_nodes: inverse.nodes.to_array(),
            nodes_a_px: (grid.warp().size.as_dvec2() / resolution_px).as_vec2().to_array(),
            inverse_low_px: inverse.low_px.as_vec2().to_array(),
            inverse_step_px: inverse.step_px as f32,
            first_texel,
            inverse_first_texel,
            ..Self::default()
        }
    }
}
