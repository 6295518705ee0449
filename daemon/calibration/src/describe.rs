//! What a calibration sees, for people: position, direction, field of view, lens shift. Rays never use any of it.

use std::fmt;

use glam::{DVec2, DVec3, UVec2};

use crate::{Convention, Frustum};

/// Beside the other entries of a homogeneous point, a w below this puts it at infinity.
const INFINITE_BELOW: f64 = 1e-12;

/// A projector in words and numbers, in the world frame. Angles in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Description {
    /// Columns and rows.
    pub resolution_px: UVec2,
    /// Its clip space.
    pub convention: Convention,
    /// Whether window z falls with distance.
    pub reversed_depth: bool,
    /// Where all rays meet, m; `None` when they are parallel.
    pub position_m: Option<DVec3>,
    /// The optical axis: perpendicular to the planes of equal clip w, or along the rays when they are parallel.
    pub axis: DVec3,
    /// What the middle of the image looks at and which way up; `None` when that place has no ray.
    pub middle: Option<Middle>,
    /// The angle between the rays at the middles of the left and right edge, and of the top and bottom edge; `None`
    /// when the rays are parallel, or when one of the four is missing.
    pub field_of_view_rad: Option<DVec2>,
    /// How far the middle of the image stands off the axis, right and up, in widths and heights of the image; `None`
    /// when the rays are parallel.
    pub lens_shift: Option<DVec2>,
}

/// The ray of the middle of the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Middle {
    /// Unit length.
    pub direction: DVec3,
    /// The way that the image's top points, at a right angle to `direction`.
    pub up: DVec3,
    /// Whether the image is mirrored, as a rear projection is.
    pub mirrored: bool,
    /// From the centre of projection (from the near plane when the rays are parallel) to the near plane, m.
    pub near_m: f64,
    /// The same to the far plane, m; may be infinite.
    pub far_m: f64,
    /// Width and height of the image on the near plane, m.
    pub near_size_m: DVec2,
}

impl Description {
    /// Describes a frustum.
    pub fn of(frustum: &Frustum) -> Self {
        let calibration = frustum.calibration();
        let clip_from_world = calibration.clip_from_world();
        let size_px = calibration.resolution_px().as_dvec2();

        // Every ray holds the point whose clip x, y and w are 0: world-from-clip's column for z.
        let centre = calibration.world_from_clip().col(2);
        let at_infinity =
            frustum.is_parallel() || centre.w.abs() <= INFINITE_BELOW * centre.truncate().abs().max_element();
        let position_m = (!at_infinity).then(|| centre.truncate() / centre.w);

        let middle_ray = frustum.ray(size_px * 0.5);
        let axis = if at_infinity {
            middle_ray.map_or_else(|| centre.truncate().normalize_or_zero(), |ray| ray.direction)
        } else {
            clip_from_world.row(3).truncate().normalize_or_zero()
        };

        // The axis as a direction (w = 0) falls where the lens is not shifted.
        let lens_shift = (!at_infinity)
            .then(|| clip_from_world * axis.extend(0.0))
            .filter(|clip| clip.w > 0.0)
            .map(|clip| (size_px * 0.5 - calibration.px_from_ndc(DVec2::new(clip.x, clip.y) / clip.w)) / size_px)
            .map(|right_down| DVec2::new(right_down.x, -right_down.y));

        let angle = |a_px: DVec2, b_px: DVec2| {
            let (a, b) = (frustum.ray(a_px)?.direction, frustum.ray(b_px)?.direction);
            Some(a.cross(b).length().atan2(a.dot(b)))
        };
        let field_of_view_rad = (!at_infinity)
            .then(|| {
                let across = angle(DVec2::new(0.0, size_px.y * 0.5), DVec2::new(size_px.x, size_px.y * 0.5))?;
                let upright = angle(DVec2::new(size_px.x * 0.5, 0.0), DVec2::new(size_px.x * 0.5, size_px.y))?;
                Some(DVec2::new(across, upright))
            })
            .flatten();

        Self {
            resolution_px: calibration.resolution_px(),
            convention: calibration.convention(),
            reversed_depth: frustum.is_reversed(),
            position_m,
            axis,
            middle: Middle::of(frustum, position_m),
            field_of_view_rad,
            lens_shift,
        }
    }
}

impl Middle {
    fn of(frustum: &Frustum, position_m: Option<DVec3>) -> Option<Self> {
        let size_px = frustum.calibration().resolution_px().as_dvec2();
        let middle_px = size_px * 0.5;
        let ray = frustum.ray(middle_px)?;

        // One pixel to the right and one down on the near plane give the image's sides.
        let right = frustum.ray(middle_px + DVec2::X)?.origin_m - ray.origin_m;
        let down = frustum.ray(middle_px + DVec2::Y)?.origin_m - ray.origin_m;
        let near_m = position_m.map_or(0.0, |position_m| position_m.distance(ray.origin_m));
        Some(Self {
            direction: ray.direction,
            up: (-down).reject_from_normalized(ray.direction).normalize_or_zero(),
            mirrored: right.cross(down).dot(ray.direction) < 0.0,
            near_m,
            far_m: near_m + ray.t_max_m,
            near_size_m: DVec2::new(right.length(), down.length()) * size_px,
        })
    }
}

impl fmt::Display for Description {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let clip_space = match self.convention {
            Convention::OpenGl => "OpenGL",
            Convention::Vulkan => "Vulkan",
        };
        let depth = if self.reversed_depth { "reversed" } else { "standard" };
        let UVec2 { x: columns, y: rows } = self.resolution_px;
        writeln!(f, "{columns} × {rows} pixels, {clip_space} clip space, {depth} depth")?;

        match self.position_m {
            Some(at_m) => writeln!(f, "stands at {} m", triple(at_m))?,
            None => writeln!(f, "stands at infinity: its rays are parallel")?,
        }
        writeln!(f, "looks along {}", triple(self.axis))?;
        if let Some(angles_rad) = self.field_of_view_rad {
            let [across, upright] = angles_rad.to_array().map(f64::to_degrees);
            writeln!(f, "sees {across:.2}° across and {upright:.2}° from top to bottom")?;
        }
        if let Some(shift) = self.lens_shift {
            let (right, up) = (shift.x * 100.0, shift.y * 100.0);
            let (sideways, upward) = (if right < 0.0 { "left" } else { "right" }, if up < 0.0 { "down" } else { "up" });
            writeln!(f, "lens shift {:.1} % {sideways}, {:.1} % {upward}", right.abs(), up.abs())?;
        }
        let Some(middle) = self.middle else {
            return write!(f, "the middle of its image has no ray: clip w is not above 0 there");
        };
        writeln!(
            f,
            "the middle of its image points along {}, its top along {}",
            triple(middle.direction),
            triple(middle.up)
        )?;
        if middle.mirrored {
            writeln!(f, "its image is mirrored")?;
        }
        if self.position_m.is_none() {
            writeln!(f, "its image is {:.3} m wide and {:.3} m high", middle.near_size_m.x, middle.near_size_m.y)?;
        }
        write!(f, "reaches from {:.3} m to ", middle.near_m)?;
        if middle.far_m.is_finite() { write!(f, "{:.3} m", middle.far_m) } else { write!(f, "infinity") }
    }
}

/// Three decimals, and no minus before a zero.
fn triple(v: DVec3) -> String {
    let [x, y, z] = v.to_array().map(|c| format!("{:.3}", if c.abs() < 5e-4 { 0.0 } else { c }));
    format!("({x}, {y}, {z})")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Calibration, Matrix4};

    const IDENTITY: Matrix4 = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

    fn described(projection: &Matrix4, view: &Matrix4, convention: Convention) -> Description {
        let calibration = Calibration::from_matrices(projection, view, convention, UVec2::new(1280, 800)).unwrap();
        Description::of(&Frustum::new(calibration))
    }

    /// 90° across, shifted by a quarter of its height upward, standing at (1, 2, 3), looking along −Z.
    const PROJECTION: Matrix4 =
        [[1.0, 0.0, 0.0, 0.0], [0.0, 1.6, 0.5, 0.0], [0.0, 0.0, -1.002, -0.2002], [0.0, 0.0, -1.0, 0.0]];
    const VIEW: Matrix4 = [[1.0, 0.0, 0.0, -1.0], [0.0, 1.0, 0.0, -2.0], [0.0, 0.0, 1.0, -3.0], [0.0, 0.0, 0.0, 1.0]];

    #[test]
    fn a_shifted_projector_is_described() {
        let seen = described(&PROJECTION, &VIEW, Convention::OpenGl);
        assert!((seen.position_m.unwrap() - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-9);
        assert!((seen.axis - DVec3::NEG_Z).length() < 1e-12);
        assert!((seen.lens_shift.unwrap() - DVec2::new(0.0, 0.25)).length() < 1e-12, "{:?}", seen.lens_shift);
        let middle = seen.middle.unwrap();
        assert!(!middle.mirrored && middle.up.y > 0.9 && middle.direction.y > 0.2, "{middle:?}");
        let ratio = middle.far_m / middle.near_m;
        assert!((ratio - 1001.0).abs() < 0.01, "{ratio}");
        // The horizontal edges' middles lie above the axis, so a little less than 90° are between them.
        let across = seen.field_of_view_rad.unwrap().x.to_degrees();
        let expected = 2.0 * (1.0 / (1.0f64 + 0.3125 * 0.3125).sqrt()).atan().to_degrees();
        assert!((across - expected).abs() < 1e-9, "{across} {expected}");

        let text = seen.to_string();
        for part in ["stands at (1.000, 2.000, 3.000) m", "looks along (0.000, 0.000, -1.000)", "25.0 % up"] {
            assert!(text.contains(part), "{text}");
        }
    }

    #[test]
    fn mirroring_is_noticed() {
        let mut mirrored = PROJECTION;
        mirrored[0][0] = -1.0;
        assert!(described(&mirrored, &VIEW, Convention::OpenGl).middle.unwrap().mirrored);
        assert!(described(&PROJECTION, &VIEW, Convention::Vulkan).middle.unwrap().mirrored);
    }

    #[test]
    fn a_parallel_projector_stands_at_infinity() {
        let mut orthographic = IDENTITY;
        orthographic[0][0] = 0.5;
        orthographic[2] = [0.0, 0.0, -0.2, -1.2];
        let seen = described(&orthographic, &VIEW, Convention::OpenGl);
        assert_eq!((seen.position_m, seen.field_of_view_rad, seen.lens_shift), (None, None, None));
        assert!((seen.axis - DVec3::NEG_Z).length() < 1e-12);
        let middle = seen.middle.unwrap();
        assert!((middle.near_size_m - DVec2::new(4.0, 2.0)).length() < 1e-9 && (middle.far_m - 10.0).abs() < 1e-9);
        assert!(seen.to_string().contains("stands at infinity"));
    }
}
