//! From the axes that trackers use to ours: x right, y up, z back.

use glam::{DMat3, DQuat, DVec3};

/// A change of axes: each of ours is one of theirs, or its opposite.
///
/// It takes the axes of bodies along with those of the room: a body that the tracker sees unturned is unturned for us.
/// So a rotation R becomes C·R·Cᵀ, where C is this change: it turns about the axis that the change makes of its own, and
/// the other way round where hands change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Axes {
    ours_from_theirs: DMat3,
    /// 1, or −1 where the tracker's axes are left-handed.
    hand: f64,
}

impl Axes {
    /// By what each of our axes is in theirs.
    const fn new(x: DVec3, y: DVec3, z: DVec3, hand: f64) -> Self {
        let rows = [x.to_array(), y.to_array(), z.to_array()];
        let ours_from_theirs = DMat3::from_cols_array(&[
            rows[0][0], rows[1][0], rows[2][0], rows[0][1], rows[1][1], rows[2][1], rows[0][2], rows[1][2], rows[2][2],
        ]);
        Self { ours_from_theirs, hand }
    }

    /// Ours.
    pub(crate) const Y_UP: Self = Self::new(DVec3::X, DVec3::Y, DVec3::Z, 1.0);
    /// x right, y up, z ahead: Unity's, PosiStageNet's.
    pub(crate) const Y_UP_LEFT: Self = Self::new(DVec3::X, DVec3::Y, DVec3::NEG_Z, -1.0);
    /// x right, y ahead, z up: FreeD's, and DTRACK's "normal".
    pub(crate) const Z_UP: Self = Self::new(DVec3::X, DVec3::Z, DVec3::NEG_Y, 1.0);
    /// x ahead, y right, z up: Unreal's.
    pub(crate) const Z_UP_LEFT: Self = Self::new(DVec3::Y, DVec3::Z, DVec3::NEG_X, -1.0);

    /// As the configuration names them.
    pub(crate) fn configured(axes: lantern_config::Axes) -> Self {
        match axes {
            lantern_config::Axes::YUp => Self::Y_UP,
            lantern_config::Axes::YUpLeft => Self::Y_UP_LEFT,
            lantern_config::Axes::ZUp => Self::Z_UP,
            lantern_config::Axes::ZUpLeft => Self::Z_UP_LEFT,
        }
    }

    /// A point or a direction.
    pub(crate) fn vector(&self, v: DVec3) -> DVec3 {
        self.ours_from_theirs * v
    }

    /// A turn about an axis, by its length.
    pub(crate) fn turn(&self, v: DVec3) -> DVec3 {
        self.hand * self.vector(v)
    }

    /// A rotation.
    pub(crate) fn rotation(&self, q: DQuat) -> DQuat {
        let v = self.turn(DVec3::new(q.x, q.y, q.z));
        DQuat::from_xyzw(v.x, v.y, v.z, q.w)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Axes; 4] = [Axes::Y_UP, Axes::Y_UP_LEFT, Axes::Z_UP, Axes::Z_UP_LEFT];

    #[test]
    fn hands_are_as_said() {
        for axes in ALL {
            assert_eq!(axes.ours_from_theirs.determinant(), axes.hand, "{axes:?}");
        }
    }

    /// What is ahead, to the right and on top is the same before and after.
    #[test]
    fn directions_by_hand() {
        let [ahead, right, up] = [DVec3::NEG_Z, DVec3::X, DVec3::Y];
        let by_hand = [
            (Axes::Y_UP, [DVec3::NEG_Z, DVec3::X, DVec3::Y]),
            (Axes::Y_UP_LEFT, [DVec3::Z, DVec3::X, DVec3::Y]),
            (Axes::Z_UP, [DVec3::Y, DVec3::X, DVec3::Z]),
            (Axes::Z_UP_LEFT, [DVec3::X, DVec3::Y, DVec3::Z]),
        ];
        for (axes, theirs) in by_hand {
            assert_eq!(theirs.map(|v| axes.vector(v)), [ahead, right, up], "{axes:?}");
        }
    }

    /// A rotation is converted so that what it does to a vector is the same before and after.
    #[test]
    fn rotations_do_the_same_to_the_same_things() {
        let q = DQuat::from_xyzw(0.1, -0.5, 0.3, 0.7).normalize();
        let v = DVec3::new(0.3, -1.2, 2.5);
        for axes in ALL {
            let error = axes.vector(q * v) - axes.rotation(q) * axes.vector(v);
            assert!(error.length() < 1e-12, "{axes:?}");
            let turn = axes.turn(q.to_scaled_axis());
            assert!((DQuat::from_scaled_axis(turn).dot(axes.rotation(q)).abs() - 1.0).abs() < 1e-12, "{axes:?}");
        }
        // FORMATS: left-handed Y up to ours, p = (x, y, −z), q = (−x, −y, z, w).
        assert_eq!(Axes::Y_UP_LEFT.vector(v), DVec3::new(v.x, v.y, -v.z));
        assert_eq!(Axes::Y_UP_LEFT.rotation(q), DQuat::from_xyzw(-q.x, -q.y, q.z, q.w));
    }
}
