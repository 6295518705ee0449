//! What a change makes stale: DESIGN section 4, as code.

use std::ops::BitOrAssign;

use lantern_scene::Changes;

/// The parts of a projector's picture that must be made anew. Each implies the composite.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stale {
    /// What each pixel lands on.
    pub primary: bool,
    /// Light that does not depend on the eye.
    pub light: bool,
    /// Light that does.
    pub look: bool,
    /// Blend weights.
    pub weight: bool,
    /// Colour and depth, and what is rasterised into them.
    pub composite: bool,
}

impl Stale {
    /// Nothing is.
    pub const NOTHING: Self = Self { primary: false, light: false, look: false, weight: false, composite: false };
    /// Everything is.
    pub const EVERYTHING: Self = Self { primary: true, light: true, look: true, weight: true, composite: true };

    /// Whether there is anything to do.
    pub fn any(self) -> bool {
        self != Self::NOTHING
    }
}

impl BitOrAssign for Stale {
    fn bitor_assign(&mut self, other: Self) {
        self.primary |= other.primary;
        self.light |= other.light;
        self.look |= other.look;
        self.weight |= other.weight;
        self.composite |= other.composite;
    }
}

/// One thing that changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// This projector's calibration.
    Calibration,
    /// The calibration of another projector.
    OtherCalibration,
    /// A prop or mask moved, came, went or changed its shape or role.
    Prop,
    /// A virtual thing did.
    Virtual,
    /// A raster node did.
    Raster,
    /// A material, texture, light or the environment.
    MaterialOrLight,
    /// The eye moved.
    Eye,
    /// A test pattern came or went.
    Pattern,
}

impl Change {
    /// The table's row.
    pub const fn makes_stale(self) -> Stale {
        let (primary, light, look, weight) = match self {
            Self::Calibration => (true, true, true, true),
            Self::OtherCalibration => (false, false, false, true),
            Self::Prop => (true, true, true, true),
            Self::Virtual => (false, true, true, false),
            Self::Raster | Self::Pattern => (false, false, false, false),
            Self::MaterialOrLight => (false, true, true, false),
            Self::Eye => (false, false, true, false),
        };
        Stale { primary, light, look, weight, composite: true }
    }
}

/// What two revisions' differences make stale on every projector.
pub fn stale_by(changes: &Changes) -> Stale {
    let mut stale = Stale::NOTHING;
    for (changed, change) in [
        (changes.geometry || changes.props_moved, Change::Prop),
        (changes.virtual_moved, Change::Virtual),
        (changes.raster_moved, Change::Raster),
        (changes.materials || changes.textures || changes.lights || changes.environment, Change::MaterialOrLight),
    ] {
        if changed {
            stale |= change.makes_stale();
        }
    }
    stale
}

#[cfg(test)]
mod tests {
    use super::*;

    /// DESIGN section 4 row by row: calibration, light without the eye, light with it, weights.
    #[test]
    fn the_table_is_the_design() {
        let row = |c: Change| {
            let s = c.makes_stale();
            (s.primary, s.light, s.look, s.weight)
        };
        assert_eq!(row(Change::Calibration), (true, true, true, true));
        assert_eq!(row(Change::OtherCalibration), (false, false, false, true));
        assert_eq!(row(Change::Prop), (true, true, true, true));
        assert_eq!(row(Change::Virtual), (false, true, true, false));
        assert_eq!(row(Change::MaterialOrLight), (false, true, true, false));
        assert_eq!(row(Change::Eye), (false, false, true, false));
        assert!(!Stale::NOTHING.any());
        assert!(Change::Raster.makes_stale().any());
    }
}
