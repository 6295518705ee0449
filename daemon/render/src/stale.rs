//! What a change makes stale: DESIGN section 4, as code.

use std::ops::BitOrAssign;

use lantern_scene::Changes;

/// How much of a part of the picture must be made anew.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Extent {
    /// Nothing of it.
    #[default]
    Nothing,
    /// The tiles that what has moved can reach ([`crate::moved`]).
    Reached,
    /// All of it.
    Whole,
}

impl Extent {
    /// Whether there is anything to do.
    pub fn any(self) -> bool {
        self != Self::Nothing
    }
}

impl BitOrAssign for Extent {
    fn bitor_assign(&mut self, other: Self) {
        *self = (*self).max(other);
    }
}

/// The parts of a projector's picture that must be made anew. Each implies the composite.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stale {
    /// What each pixel lands on.
    pub primary: Extent,
    /// Light that does not depend on the eye.
    pub light: Extent,
    /// Light that does.
    pub look: bool,
    /// Blend weights.
    pub weight: Extent,
    /// Colour and depth, and what is rasterised into them.
    pub composite: bool,
}

impl Stale {
    /// Nothing is.
    pub const NOTHING: Self = Self {
        primary: Extent::Nothing,
        light: Extent::Nothing,
        look: false,
        weight: Extent::Nothing,
        composite: false,
    };
    /// Everything is.
    pub const EVERYTHING: Self =
        Self { primary: Extent::Whole, light: Extent::Whole, look: true, weight: Extent::Whole, composite: true };

    /// Whether there is anything to do.
    pub fn any(self) -> bool {
        self != Self::NOTHING
    }

    /// Whether nothing is but what follows the eye.
    pub fn is_of_eye_alone(self) -> bool {
        self == Change::Eye.makes_stale()
    }

    /// Whether anything is that is made tile by tile.
    pub fn any_tiles(self) -> bool {
        self.primary.any() || self.light.any() || self.weight.any()
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
    /// The first virtual thing came, or the last one went: any line of sight may meet one now, or none can any more.
    AnyVirtual,
    /// A raster node did.
    Raster,
    /// A material, texture, light or the environment.
    MaterialOrLight,
    /// Shaders were made anew for what a scene has of textures and transmission, and may round otherwise.
    Pipelines,
    /// The shader that follows the eye was made anew for how a scene's rays branch.
    TreePipelines,
    /// The eye moved.
    Eye,
    /// A test pattern came or went.
    Pattern,
}

impl Change {
    /// The table's row.
    pub const fn makes_stale(self) -> Stale {
        use Extent::{Nothing, Reached, Whole};
        let (primary, light, look, weight) = match self {
            Self::Calibration => (Whole, Whole, true, Whole),
            Self::OtherCalibration => (Nothing, Nothing, false, Whole),
            Self::Prop => (Reached, Reached, true, Reached),
            Self::Virtual => (Nothing, Reached, true, Nothing),
            Self::AnyVirtual | Self::MaterialOrLight => (Nothing, Whole, true, Nothing),
            Self::Raster | Self::Pattern => (Nothing, Nothing, false, Nothing),
            Self::Pipelines => (Nothing, Whole, true, Whole),
            Self::TreePipelines | Self::Eye => (Nothing, Nothing, true, Nothing),
        };
        Stale { primary, light, look, weight, composite: true }
    }
}

/// What two revisions' differences make stale on every projector.
pub fn stale_by(changes: &Changes) -> Stale {
    let mut stale = Stale::NOTHING;
    for (changed, change) in [
        (changes.props_moved, Change::Prop),
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
        use Extent::{Nothing, Reached, Whole};
        let row = |c: Change| {
            let s = c.makes_stale();
            (s.primary, s.light, s.look, s.weight)
        };
        assert_eq!(row(Change::Calibration), (Whole, Whole, true, Whole));
        assert_eq!(row(Change::OtherCalibration), (Nothing, Nothing, false, Whole));
        assert_eq!(row(Change::Prop), (Reached, Reached, true, Reached));
        assert_eq!(row(Change::Virtual), (Nothing, Reached, true, Nothing));
        assert_eq!(row(Change::MaterialOrLight), (Nothing, Whole, true, Nothing));
        assert_eq!(row(Change::TreePipelines), row(Change::Eye));
        assert_eq!(row(Change::Eye), (Nothing, Nothing, true, Nothing));
        assert!(!Stale::NOTHING.any());
        assert!(Change::Raster.makes_stale().any() && !Change::Raster.makes_stale().any_tiles());
    }

    #[test]
    fn the_more_stale_of_two_counts() {
        let mut stale = Change::Prop.makes_stale();
        stale |= Change::MaterialOrLight.makes_stale();
        assert_eq!((stale.primary, stale.light, stale.weight), (Extent::Reached, Extent::Whole, Extent::Reached));
        stale |= Change::Virtual.makes_stale();
        assert_eq!(stale.light, Extent::Whole);
    }
}
