//! What a calibration suffers from, in words, with the remedy.
//!
//! Rays are exact for every invertible matrix, so nothing here is needed to make them: a wrong calibration makes a black
//! projector and no word of why. What is said is either *certain*, and then the calibration is refused, or *suspicious*:
//! some good calibration could look so, and it is taken with a warning. What hangs on the scene is never certain, since
//! clients can change it, but for a distance that no projector lights over.

mod image;
mod place;
mod stored;
mod units;

use std::fmt;

use glam::DVec3;
use lantern_config::Calibration as Configured;

use crate::describe::Description;
use crate::{Calibration, Frustum};

pub use place::nothing_in_view;

/// What is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Ailment {
    /// Matrices stored by columns are read by rows, or the other way.
    Transposed,
    /// The image is mirrored.
    Mirrored,
    /// Axes are those of a left-handed world.
    LeftHanded,
    /// Lengths are read in another unit than they were written in.
    WrongUnits,
    /// It was made for another image.
    WrongResolution,
    /// The optical axis lies farther outside of the image than lenses shift.
    PrincipalPointOutside,
    /// The props are nearer than the near plane.
    NearPlaneBehindProps,
    /// No prop is in the image.
    NothingInView,
}

impl Ailment {
    /// The name for programs.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Transposed => "transposed",
            Self::Mirrored => "mirrored",
            Self::LeftHanded => "left-handed",
            Self::WrongUnits => "wrong-units",
            Self::WrongResolution => "wrong-resolution",
            Self::PrincipalPointOutside => "principal-point-outside",
            Self::NearPlaneBehindProps => "near-plane-behind-props",
            Self::NothingInView => "nothing-in-view",
        }
    }
}

/// What was found, and what to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// What kind of thing.
    pub ailment: Ailment,
    /// Whether no good calibration looks so.
    pub certain: bool,
    /// The key of `[projector.calibration]` that it is about.
    pub key: &'static str,
    /// What is wrong.
    pub message: String,
    /// What to do.
    pub hint: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; hint: {}", self.message, self.hint)
    }
}

/// The box around all props, world, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Props {
    /// Its lowest corner.
    pub low_m: DVec3,
    /// Its highest corner.
    pub high_m: DVec3,
}

impl Props {
    fn corners_m(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let pick = |bit: usize, low: f64, high: f64| if i & bit == 0 { low } else { high };
            let (low, high) = (self.low_m, self.high_m);
            DVec3::new(pick(1, low.x, high.x), pick(2, low.y, high.y), pick(4, low.z, high.z))
        })
    }

    fn middle_m(&self) -> DVec3 {
        (self.low_m + self.high_m) * 0.5
    }
}

/// A projector to be looked at.
struct Patient<'a> {
    configured: &'a Configured,
    calibration: &'a Calibration,
    seen: Description,
}

/// Everything that is found. `props` is `None` where the scene has none, or is not known.
pub fn examine(configured: &Configured, calibration: &Calibration, props: Option<&Props>) -> Vec<Finding> {
    // Of what is transposed nothing else can be said.
    if let Configured::Matrices(matrices) = configured
        && let Some(finding) = stored::transposed(matrices)
    {
        return vec![finding];
    }
    let patient = Patient { configured, calibration, seen: Description::of(&Frustum::new(calibration.clone())) };
    let mut findings: Vec<Finding> = [
        image::mirrored(&patient),
        image::pixels_not_square(&patient),
        image::made_for_another_image(&patient),
        image::principal_point_outside(&patient),
    ]
    .into_iter()
    .flatten()
    .collect();
    findings.extend(place::place(&patient, props));
    findings
}
