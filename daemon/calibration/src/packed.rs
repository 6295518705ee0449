//! The frustum as the GPU reads it, and the GPU's arithmetic on it.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, DVec4, Vec2, Vec3, Vec4};

use crate::Frustum;

/// A frustum relative to a scene origin; 176 bytes, eleven `vec4`, so the same in std140 and std430.
///
/// Its twin is `GpuFrustum` in `shaders-glsl/include/frame.glsl`. A *functional* is a row vector for (P, 1), where P is a
/// point in metres relative to the scene origin. At a place (x, y) in pixels let `near = near_00 + x·near_dx + y·near_dy`,
/// `far` likewise, and `s = 2·z_base − 1`. Then
///
/// - there is no ray where `near.w ≤ 0`;
/// - origin = `near.xyz / near.w`, m, whose clip w is `w₀ = 1 / near.w`;
/// - direction `d = normalize(far.xyz)`;
/// - t_max = `w₀ / (s · dot(depth_row.xyz, d))` m where that is above 0, else infinite;
/// - window z at distance t = `z_base + (t·dot(depth_row.xyz, d) − s·w₀) / (w₀ + t·dot(clip_w.xyz, d))`: no large numbers
///   cancel in it, wherever the scene origin is;
/// - window z of any P = `z_base + depth_row·(P, 1) / clip_w·(P, 1)`, which loses digits as P is far from the origin and
///   near to the projector.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct GpuFrustum {
    /// Homogeneous point on the near plane (the true near side, reversed depth or not) at the image's top left corner.
    pub near_00: [f32; 4],
    /// Its change per pixel to the right.
    pub near_dx: [f32; 4],
    /// Its change per pixel down.
    pub near_dy: [f32; 4],
    /// The ray's point at infinity at the top left corner: its direction, not normalised; w = 0.
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
    /// Clip w at the origin, in the scale of [`GpuFrustum::clip_w`].
    pub origin_clip_w: f32,
}

impl GpuFrustum {
    /// Packs a frustum; world points become relative to `origin_m`. Everything is computed in f64 and rounded once.
    pub fn new(frustum: &Frustum, origin_m: DVec3) -> Self {
        // One scale for all functionals, and its inverse for the near plane, so that 1 / near.w is the functional of
        // clip w. Any positive scale would do; this one keeps f32 far from its ends. Directions have their own.
        let clip_from_world = frustum.calibration().clip_from_world();
        let scale = clip_from_world.row(3).abs().max_element().recip();
        let near = frustum.near().map(|v| (v.truncate() - origin_m * v.w).extend(v.w) / scale);
        let largest = frustum.along().at_00.abs().max_element();
        let far = frustum.along().map(|v| v / largest);
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
        let direction = far.truncate().normalize();
        let rise = self.depth_sign() * Vec4::from(self.depth_row).truncate().dot(direction);
        let t_max_m = if rise > 0.0 { near.w.recip() / rise } else { f32::INFINITY };
        Some(GpuRay { origin_m: near.truncate() / near.w, direction, t_max_m, origin_clip_w: near.w.recip() })
    }

    fn depth_sign(&self) -> f32 {
        2.0 * self.z_base - 1.0
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

    /// Window z at a distance along a ray of this frustum, by the shader's own steps.
    pub fn window_z(&self, ray: &GpuRay, t_m: f32) -> f32 {
        let [rise, growth] = [self.depth_row, self.clip_w].map(|row| Vec4::from(row).truncate().dot(ray.direction));
        let w = ray.origin_clip_w;
        self.z_base + (t_m * rise - self.depth_sign() * w) / (w + t_m * growth)
    }

    /// Window z of any point relative to the scene origin, by the shader's own steps.
    pub fn window_z_of(&self, point_m: Vec3) -> f32 {
        let point = point_m.extend(1.0);
        self.z_base + Vec4::from(self.depth_row).dot(point) / Vec4::from(self.clip_w).dot(point)
    }
}
