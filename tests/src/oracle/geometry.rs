//! Rays and triangles.

use glam::DVec3;

/// A half line, or a piece of one, in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Metres.
    pub origin_m: DVec3,
    /// Unit length.
    pub direction: DVec3,
    /// Hits beyond it do not count, m; may be infinite.
    pub t_max_m: f64,
}

impl Ray {
    /// From a point on, without end.
    pub fn new(origin_m: DVec3, direction: DVec3) -> Self {
        Self { origin_m, direction, t_max_m: f64::INFINITY }
    }

    /// The point at a distance.
    pub fn at(&self, t_m: f64) -> DVec3 {
        self.origin_m + self.direction * t_m
    }
}

/// A triangle in the world, and where it came from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tri {
    /// Metres.
    pub corners_m: [DVec3; 3],
    /// Index into the scene's instances.
    pub instance: u32,
    /// The mesh's own number.
    pub triangle: u32,
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meeting {
    /// Distance along the ray, m.
    pub t_m: f64,
    /// Weights of the three corners; their sum is 1.
    pub weights: DVec3,
}

impl Tri {
    /// The closest corner of its box and the farthest.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let [a, b, c] = self.corners_m;
        (a.min(b).min(c), a.max(b).max(c))
    }

    /// Where a ray meets it from either side, at a distance in [0, t_max].
    ///
    /// By the three volumes that the ray spans with the edges. Of two triangles that share an edge, each finds the exact
    /// negative of the other's volume for it, so no ray slips through between them.
    pub fn meet(&self, ray: &Ray) -> Option<Meeting> {
        let [a, b, c] = self.corners_m.map(|corner_m| corner_m - ray.origin_m);
        let volumes =
            DVec3::new(ray.direction.dot(c.cross(b)), ray.direction.dot(a.cross(c)), ray.direction.dot(b.cross(a)));
        if volumes.min_element() < 0.0 && volumes.max_element() > 0.0 {
            return None;
        }
        let total = volumes.element_sum();
        if total == 0.0 {
            return None;
        }

        let weights = volumes / total;
        let t_m = (a * weights.x + b * weights.y + c * weights.z).dot(ray.direction);
        (t_m >= 0.0 && t_m <= ray.t_max_m).then_some(Meeting { t_m, weights })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRI: Tri = Tri { corners_m: [DVec3::ZERO, DVec3::X, DVec3::Y], instance: 0, triangle: 0 };

    #[test]
    fn weights_rebuild_the_point() {
        for from in [1.0, -1.0] {
            let ray = Ray::new(DVec3::new(0.25, 0.5, 2.0 * from), DVec3::Z * -from);
            let meeting = TRI.meet(&ray).expect("both sides are hit");
            assert!((meeting.t_m - 2.0).abs() < 1e-12);
            assert!((meeting.weights - DVec3::new(0.25, 0.25, 0.5)).length() < 1e-12, "{:?}", meeting.weights);
        }
    }

    #[test]
    fn what_is_beside_behind_or_beyond_is_missed() {
        assert_eq!(TRI.meet(&Ray::new(DVec3::new(0.6, 0.6, 1.0), DVec3::NEG_Z)), None);
        assert_eq!(TRI.meet(&Ray::new(DVec3::new(0.2, 0.2, 1.0), DVec3::Z)), None);
        let short = Ray { t_max_m: 0.99, ..Ray::new(DVec3::new(0.2, 0.2, 1.0), DVec3::NEG_Z) };
        assert_eq!(TRI.meet(&short), None);
        assert_eq!(TRI.meet(&Ray::new(DVec3::new(-1.0, 0.2, 0.0), DVec3::X)), None, "edge on");
    }
}
