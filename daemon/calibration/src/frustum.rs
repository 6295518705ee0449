//! Where the pixels of a projector point, and where a point falls in its image.
//!
//! The clip cube's corners go through world-from-clip and are kept *homogeneous*; a pixel's two ends are interpolated
//! between them and divided last. Broecker, Smith and Thomas (ISMAR 2013, equations 1 to 3) divide first, which is
//! exact only while clip w is constant on the near and on the far plane: DESIGN, section 2.
//!
//! The sign of things. Let H = world-from-clip · (x, y, z, 1) for normalised x, y, z. The world point is H.xyz / H.w,
//! and clip-from-world takes (H.xyz / H.w, 1) to (x, y, z, 1) / H.w: the point's clip w is 1 / H.w. So a place is in
//! front of the projector where H.w > 0, at infinity where it is 0, behind where it is negative. Since rays run toward
//! growing clip w, they run toward *falling* H.w. Along one pixel's ray only z varies, and H.w changes with it by
//! world-from-clip's entry (3, 2), which is the same for every pixel: one look decides for the whole frustum which of
//! the two depth limits is the near one, whether depth is standard, reversed, infinite or behind a homography.
//!
//! All of that is the *ideal* image of the matrix. Where a lens stands before it, a place in the real image goes through
//! the lens first, and a point's place through it last; between the two nothing changes.

use glam::{DVec2, DVec3, DVec4};

use crate::{Calibration, clip::Convention};

/// Beside the largest entry of its row, a slope of H.w below this is rounding: the rays are parallel.
const PARALLEL_BELOW: f64 = 1e-12;

/// Beside the near plane's, an H.w below this is rounding: the far plane is at infinity (far/near above 1e9).
const INFINITE_BELOW: f64 = 1e-9;

/// A half line in the world, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// On the near plane.
    pub origin_m: DVec3,
    /// Unit length.
    pub direction: DVec3,
    /// Distance from the origin to the far plane; +inf where that lies at infinity or beyond.
    pub t_max_m: f64,
}

impl Ray {
    /// The point at distance `t_m`.
    pub fn at(&self, t_m: f64) -> DVec3 {
        self.origin_m + self.direction * t_m
    }
}

/// A point in the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projected {
    /// Continuous pixels from the top left corner; may lie outside of the image.
    pub place_px: DVec2,
    /// Above 0.
    pub clip_w: f64,
    /// What a depth attachment holds there; outside of 0 to 1 beyond the near or far plane.
    pub window_z: f64,
}

/// A homogeneous world point for each place in the ideal image: `at_00 + x·per_x + y·per_y`, x and y in pixels. An affine
/// form, since x and y enter world-from-clip · (x, y, z, 1) once each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Plane {
    /// At the top left corner of the image.
    pub(crate) at_00: DVec4,
    /// Per pixel to the right.
    pub(crate) per_x: DVec4,
    /// Per pixel down.
    pub(crate) per_y: DVec4,
}

impl Plane {
    /// The plane of normalised depth `ndc_z`.
    fn of(calibration: &Calibration, ndc_z: f64) -> Self {
        let world_from_clip = calibration.world_from_clip();
        let size_px = calibration.resolution_px().as_dvec2();
        let corner = |at_px: DVec2| {
            let ndc = calibration.ndc_from_px(at_px);
            world_from_clip * DVec4::new(ndc.x, ndc.y, ndc_z, 1.0)
        };
        let y_sign = calibration.convention().y_sign();
        Self {
            at_00: corner(DVec2::ZERO),
            per_x: world_from_clip.col(0) * (2.0 / size_px.x),
            per_y: world_from_clip.col(1) * (2.0 * y_sign / size_px.y),
        }
    }

    /// The homogeneous point of a place.
    pub(crate) fn at(&self, place_px: DVec2) -> DVec4 {
        self.at_00 + self.per_x * place_px.x + self.per_y * place_px.y
    }

    /// The same under a change of each of its vectors.
    pub(crate) fn map(&self, change: impl Fn(DVec4) -> DVec4) -> Self {
        Self { at_00: change(self.at_00), per_x: change(self.per_x), per_y: change(self.per_y) }
    }
}

/// A projector's frustum: every primary ray, and the way back.
#[derive(Clone, Debug, PartialEq)]
pub struct Frustum {
    calibration: Calibration,
    near: Plane,
    /// w = 0: each ray's point at infinity, which is its direction.
    along: Plane,
    far: Plane,
    reversed: bool,
    parallel: bool,
}

impl Frustum {
    /// Unprojects the clip cube.
    pub fn new(calibration: Calibration) -> Self {
        // Which depth limit is near: H.w falls with z where depth is standard. Parallel rays have no growing clip w;
        // theirs runs from the convention's first limit to its second.
        let world_from_clip = calibration.world_from_clip();
        let w_row = world_from_clip.row(3);
        let parallel = w_row.z.abs() <= PARALLEL_BELOW * w_row.abs().max_element();
        let reversed = !parallel && w_row.z > 0.0;
        let [first, second] = calibration.convention().depth_limits();
        let (near_z, far_z) = if reversed { (second, first) } else { (first, second) };
        let near = Plane::of(&calibration, near_z);
        let mut far = Plane::of(&calibration, far_z);

        // An infinite far plane comes out of the inversion as one of H.w = 1e-17 or so, of either sign.
        let size_px = calibration.resolution_px().as_dvec2();
        let corners_px = [DVec2::ZERO, DVec2::new(size_px.x, 0.0), DVec2::new(0.0, size_px.y), size_px];
        let largest_w = |plane: &Plane| corners_px.iter().map(|&at| plane.at(at).w.abs()).fold(0.0, f64::max);
        if largest_w(&far) <= INFINITE_BELOW * largest_w(&near) {
            far = far.map(|v| v.truncate().extend(0.0));
        }

        // The ray's direction is far.xyz · near.w − near.xyz · far.w: the difference of the two divided points, times both
        // w, so that no far w of 0 is divided by, and the sign stays right through infinity, where far w turns negative.
        // Since far = near + step · world-from-clip's z column, it is linear in the near point, hence affine in the
        // pixel, and need not be taken as a difference of large products for each ray.
        let z_column = world_from_clip.col(2) * (far_z - near_z);
        let along = near.map(|n| (z_column.truncate() * n.w - n.truncate() * z_column.w).extend(0.0));
        Self { calibration, near, along, far, reversed, parallel }
    }

    /// What it was made from.
    pub fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    /// Whether window z falls with distance.
    pub fn is_reversed(&self) -> bool {
        self.reversed
    }

    /// Whether the centre of projection is at infinity.
    pub fn is_parallel(&self) -> bool {
        self.parallel
    }

    pub(crate) fn near(&self) -> &Plane {
        &self.near
    }

    pub(crate) fn along(&self) -> &Plane {
        &self.along
    }

    /// The eight corners of the ideal image in homogeneous world coordinates: the near four, then the far four, each in the order top
    /// left, top right, bottom left, bottom right of the image. One with w = 0 is a direction.
    pub fn corners(&self) -> [DVec4; 8] {
        let size_px = self.calibration.resolution_px().as_dvec2();
        let places_px = [DVec2::ZERO, DVec2::new(size_px.x, 0.0), DVec2::new(0.0, size_px.y), size_px];
        std::array::from_fn(|i| if i < 4 { self.near.at(places_px[i]) } else { self.far.at(places_px[i - 4]) })
    }

    /// The ray of a place in the image, in continuous pixels from the top left corner (a pixel's centre is at + ½).
    ///
    /// `None` where the lens sends no light, or where even the near end has clip w ≤ 0, as a strong homography can bring about in a part of the image: a
    /// rasteriser clips all that such a pixel could show.
    pub fn ray(&self, place_px: DVec2) -> Option<Ray> {
        let ideal_px = self.calibration.optics().ideal_px(place_px)?;
        let near = self.near.at(ideal_px);
        let far = self.far.at(ideal_px);
        if near.w <= 0.0 {
            return None;
        }

        let along = self.along.at(ideal_px).truncate();
        let length = along.length();
        let origin_m = near.truncate() / near.w;
        let t_max_m = if far.w > 0.0 { length / (near.w * far.w) } else { f64::INFINITY };
        Some(Ray { origin_m, direction: along / length, t_max_m })
    }

    /// Where a world point falls; `None` where its clip w is not above 0, or where the lens does not show it.
    pub fn project(&self, world_m: DVec3) -> Option<Projected> {
        let clip = self.calibration.clip_from_world() * world_m.extend(1.0);
        if clip.w <= 0.0 {
            return None;
        }
        let ideal_px = self.calibration.px_from_ndc(DVec2::new(clip.x, clip.y) / clip.w);
        Some(Projected {
            place_px: self.calibration.optics().real_px(ideal_px)?,
            clip_w: clip.w,
            window_z: self.calibration.convention().window_z(clip.z / clip.w),
        })
    }

    /// Window z as `base + row · P / (w_row · P)`, with the base at whichever end is far: there the row's value is small
    /// and exact, where z / w would be the difference of two nearly equal numbers.
    pub(crate) fn depth_form(&self) -> (f64, DVec4) {
        let clip_from_world = self.calibration.clip_from_world();
        let (z_row, w_row) = (clip_from_world.row(2), clip_from_world.row(3));
        match (self.calibration.convention(), self.reversed) {
            (Convention::OpenGl, false) => (1.0, (z_row - w_row) * 0.5),
            (Convention::OpenGl, true) => (0.0, (z_row + w_row) * 0.5),
            (Convention::Vulkan, false) => (1.0, z_row - w_row),
            (Convention::Vulkan, true) => (0.0, z_row),
        }
    }
}
