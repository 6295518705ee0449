//! The frustum as the GPU reads it, and the GPU's arithmetic on it.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, DVec4, Vec2, Vec3, Vec4};

use crate::{Frustum, frustum::Plane};

/// A frustum relative to a scene origin; 176 bytes, eleven `vec4`, so the same in std140 and std430.
///
/// Its twin is `GpuFrustum` in `shaders-glsl/include/frustum.glsl`. A *functional* is a row vector for (P, 1), where P
/// is a point in metres relative to the scene origin. With `near = near_00 + x·near_dx + y·near_dy` at a place (x, y)
/// in pixels, and `far` likewise:
///
/// - no ray where `near.w ≤ 0`;
/// - origin = `near.xyz / near.w`, m;
/// - direction = `normalize(far.xyz·near.w − near.xyz·far.w)`;
/// - t_max = `length(far.xyz·near.w − near.xyz·far.w) / (near.w·far.w)` m where `far.w > 0`, else infinite;
/// - window z of P = `z_base + depth_row·(P, 1) / clip_w·(P, 1)`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct GpuFrustum {
    /// Homogeneous point on the near plane (the true near side, reversed depth or not) at the image's top left corner.
    pub near_00: [f32; 4],
    /// Its change per pixel to the right.
    pub near_dx: [f32; 4],
    /// Its change per pixel down.
    pub near_dy: [f32; 4],
    /// Homogeneous point on the far plane at the top left corner; w = 0 is a direction.
    pub far_00: [f32; 4],
    /// Its change per pixel to the right.
    pub far_dx: [f32; 4],
    /// Its change per pixel down.
    pub far_dy: [f32; 4],
    /// Functional of clip x, in the projector's own convention.
    pub clip_x: [f32; 4],
    /// Functional of clip y.
    pub clip_y: [f32; 4],
    /// Functional of clip w.
    pub clip_w: [f32; 4],
    /// Functional of (window z − `z_base`) · clip w: it vanishes on the far plane, where it is computed in f64.
    pub depth_row: [f32; 4],
    /// Columns and rows.
    pub resolution_px: [f32; 2],
    /// 1 for standard depth, 0 for reversed: window z of the far plane.
    pub z_base: f32,
    /// Pixel row = (clip y / clip w · `y_sign` · ½ + ½) · rows.
    pub y_sign: f32,
}

/// A ray as the GPU has it: f32, relative to the scene origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GpuRay {
    /// Metres.
    pub origin_m: Vec3,
    /// Unit length.
    pub direction: Vec3,
    /// Metres; +inf where the far plane is at infinity.
    pub t_max_m: f32,
}

impl GpuFrustum {
    /// Packs a frustum; world points become relative to `origin_m`. Everything is computed in f64 and rounded once.
    pub fn new(frustum: &Frustum, origin_m: DVec3) -> Self {
        let near = relative(frustum.near(), origin_m);
        let far = relative(frustum.far(), origin_m);

        // The functionals share one scale, so that their quotients stay; it is that of clip w.
        let clip_from_world = frustum.calibration().clip_from_world();
        let scale = clip_from_world.row(3).abs().max_element().recip();
        let functional = |row: DVec4| {
            let at_origin = row.truncate().dot(origin_m) + row.w;
            (row.truncate().extend(at_origin) * scale).as_vec4().to_array()
        };
        let (z_base, depth_row) = frustum.depth_form();
        Self {
            near_00: near.at_00.as_vec4().to_array(),
            near_dx: near.per_x.as_vec4().to_array(),
            near_dy: near.per_y.as_vec4().to_array(),
            far_00: far.at_00.as_vec4().to_array(),
            far_dx: far.per_x.as_vec4().to_array(),
            far_dy: far.per_y.as_vec4().to_array(),
            clip_x: functional(clip_from_world.row(0)),
            clip_y: functional(clip_from_world.row(1)),
            clip_w: functional(clip_from_world.row(3)),
            depth_row: functional(depth_row),
            resolution_px: frustum.calibration().resolution_px().as_vec2().to_array(),
            z_base: z_base as f32,
            y_sign: frustum.calibration().convention().y_sign() as f32,
        }
    }

    /// The ray of a place in pixels, by the shader's own steps in the shader's own precision.
    pub fn ray(&self, place_px: Vec2) -> Option<GpuRay> {
        let at = |at_00: [f32; 4], dx: [f32; 4], dy: [f32; 4]| {
            Vec4::from(at_00) + Vec4::from(dx) * place_px.x + Vec4::from(dy) * place_px.y
        };
        let near = at(self.near_00, self.near_dx, self.near_dy);
        let far = at(self.far_00, self.far_dx, self.far_dy);
        if near.w <= 0.0 {
            return None;
        }
        let along = far.truncate() * near.w - near.truncate() * far.w;
        let length = along.length();
        let t_max_m = if far.w > 0.0 { length / (near.w * far.w) } else { f32::INFINITY };
        Some(GpuRay { origin_m: near.truncate() / near.w, direction: along / length, t_max_m })
    }

    /// The pixel of a point relative to the scene origin, by the shader's own steps; `None` where clip w is not above 0.
    pub fn place_px(&self, point_m: Vec3) -> Option<Vec2> {
        let point = point_m.extend(1.0);
        let clip_w = Vec4::from(self.clip_w).dot(point);
        if clip_w <= 0.0 {
            return None;
        }
        let ndc = Vec2::new(Vec4::from(self.clip_x).dot(point), Vec4::from(self.clip_y).dot(point)) / clip_w;
        Some((ndc * Vec2::new(1.0, self.y_sign) * 0.5 + 0.5) * Vec2::from(self.resolution_px))
    }

    /// Window z of a point relative to the scene origin, by the shader's own steps.
    pub fn window_z(&self, point_m: Vec3) -> f32 {
        let point = point_m.extend(1.0);
        self.z_base + Vec4::from(self.depth_row).dot(point) / Vec4::from(self.clip_w).dot(point)
    }
}

/// A plane relative to a new origin, in homogeneous form, scaled so that the largest entry at its top left corner is 1.
/// Any positive scale is the same plane; this one keeps f32 far from its ends.
fn relative(plane: &Plane, origin_m: DVec3) -> Plane {
    let moved = plane.map(|v| (v.truncate() - origin_m * v.w).extend(v.w));
    let largest = moved.at_00.abs().max_element().max(f64::MIN_POSITIVE);
    moved.map(|v| v / largest)
}
