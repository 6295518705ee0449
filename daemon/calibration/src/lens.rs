//! From the ideal image of a projector's matrix to the real one that its lens makes.
//!
//! The matrix sends a point to a place in the *ideal* image. The lens moves that place to the *real* one, where the pixel is
//! that lights the point. A ray starts from the real place and goes the other way, per sample: nothing is resampled.

use std::sync::Arc;

use glam::{DVec2, UVec2};

use crate::brown_conrady::{BrownConrady, BrownConradyError, OneToOne};
use crate::warp::{Grid, Warp, WarpError};

/// What stands between the ideal image and the real one.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Lens {
    /// Nothing: the matrix says all.
    #[default]
    Pinhole,
    /// OpenCV's distortion.
    BrownConrady(BrownConrady),
    /// A measured grid.
    Warp(Arc<Warp>),
}

/// Why a lens cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LensError {
    /// A distortion.
    #[error(transparent)]
    BrownConrady(#[from] BrownConradyError),
    /// A warp.
    #[error(transparent)]
    Warp(#[from] WarpError),
}

/// A lens that is one to one over its image, by construction.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Optics {
    /// None.
    #[default]
    Pinhole,
    /// OpenCV's.
    BrownConrady(OneToOne),
    /// Measured.
    Warp(Arc<Grid>),
}

impl Optics {
    /// Checks a lens for an image of so many pixels.
    ///
    /// # Errors
    /// Numbers that are not finite; a lens that folds inside the image.
    pub fn new(lens: Lens, resolution_px: UVec2) -> Result<Self, LensError> {
        Ok(match lens {
            Lens::Pinhole => Self::Pinhole,
            Lens::BrownConrady(model) => Self::BrownConrady(model.one_to_one(resolution_px)?),
            Lens::Warp(warp) => Self::Warp(Arc::new(Grid::new(warp, resolution_px)?)),
        })
    }

    /// The lens.
    pub fn lens(&self) -> Lens {
        match self {
            Self::Pinhole => Lens::Pinhole,
            Self::BrownConrady(one_to_one) => Lens::BrownConrady(*one_to_one.model()),
            Self::Warp(grid) => Lens::Warp(Arc::clone(grid.warp())),
        }
    }

    /// The ideal place of a real one, px; `None` where no light goes.
    pub fn ideal_px(&self, real_px: DVec2) -> Option<DVec2> {
        match self {
            Self::Pinhole => Some(real_px),
            Self::BrownConrady(one_to_one) => one_to_one.ideal_px(real_px),
            Self::Warp(grid) => grid.ideal_px(real_px),
        }
    }

    /// A box in the ideal image around all that a rectangle of the real one shows: its lowest and highest place, px. `None`
    /// where the rectangle is dark.
    pub fn ideal_bounds(&self, low_px: DVec2, high_px: DVec2) -> Option<(DVec2, DVec2)> {
        match self {
            Self::Pinhole => Some((low_px, high_px)),
            Self::Warp(grid) => grid.ideal_bounds(low_px, high_px),
            Self::BrownConrady(one_to_one) => {
                // Nine places of the rectangle. Between three of a line a smooth map stands out by an eighth of their second
                // difference; it is given whole.
                let at = |x: f64, y: f64| one_to_one.ideal_px(low_px + (high_px - low_px) * DVec2::new(x, y) * 0.5);
                let lines: Option<Vec<[DVec2; 3]>> = (0..3)
                    .flat_map(|i| {
                        let i = f64::from(i);
                        [[at(0.0, i), at(1.0, i), at(2.0, i)], [at(i, 0.0), at(i, 1.0), at(i, 2.0)]]
                    })
                    .map(|[a, b, c]| Some([a?, b?, c?]))
                    .collect();
                let lines = lines?;
                let bend = lines.iter().map(|[a, b, c]| (*a - *b * 2.0 + *c).abs()).fold(DVec2::ZERO, DVec2::max);
                let places = || lines.iter().flatten().copied();
                let low = places().fold(DVec2::INFINITY, DVec2::min);
                Some((low - bend, places().fold(DVec2::NEG_INFINITY, DVec2::max) + bend))
            }
        }
    }

    /// The real place of an ideal one, px; `None` where the lens does not show it. May lie outside of the image.
    pub fn real_px(&self, ideal_px: DVec2) -> Option<DVec2> {
        match self {
            Self::Pinhole => Some(ideal_px),
            Self::BrownConrady(one_to_one) => one_to_one.real_px(ideal_px),
            Self::Warp(grid) => grid.real_px(ideal_px),
        }
    }
}
