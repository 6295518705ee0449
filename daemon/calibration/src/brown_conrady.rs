//! The lens of Brown (Decentering Distortion of Lenses, 1966) and Conrady (1919), with OpenCV's five coefficients.
//!
//! With `x` a place about the centre in focal lengths and `r = |x|`, the distorted place is
//!
//! ```text
//! x·(1 + k1·r² + k2·r⁴ + k3·r⁶) + (2·p1·x·y + p2·(r² + 2·x²), p1·(r² + 2·y²) + 2·p2·x·y)
//! ```
//!
//! Its Jacobian is symmetric, so that the model is the gradient of a potential. Where both eigenvalues are above 0 on a
//! whole disc, the potential is strictly convex there and no two places of the disc share an image. That is the
//! proof that [`OneToOne`] keeps; beyond its disc the polynomial folds back, and nothing that lies there is shown.

use glam::{DMat2, DVec2, UVec2};

/// The slope of the model, distorted by ideal, that is still taken. Below it an image is stretched so far that the f32 of
/// a shader no longer finds the ideal place to 0.01 px.
const LEAST_SLOPE: f64 = 0.01;

/// Circles and directions in which the slope is looked at, over the radius that the image needs.
const CIRCLES: u32 = 256;
const DIRECTIONS: u32 = 128;

/// The disc may grow to so many times the image's radius before it must hold the image.
const FARTHEST: u32 = 64;

/// How much more than the image the disc holds where the model allows it: what is rasterised reaches over the edges.
const MARGIN: f64 = 1.1;

/// Steps of Newton's method in a shader, and how near to a place of the image they must come, px. Twin of `LENS_STEPS` in
/// `shaders-glsl/include/lens.glsl`.
pub const LENS_STEPS: u32 = 8;
const SHADER_RESIDUAL_PX: f64 = 1e-3;

/// Newton's steps, and the residual in focal lengths at which they end: below 1e-10 px of any projector.
const STEPS: u32 = 64;
const RESIDUAL: f64 = 1e-14;

/// OpenCV's distortion of a lens. Places are continuous pixels from the top left corner of the image: OpenCV's `cx` is
/// `centre_px.x − ½`, since it counts from the middle of the first pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BrownConrady {
    /// Focal lengths, px.
    pub focal_px: DVec2,
    /// Where the optical axis meets the image, continuous px.
    pub centre_px: DVec2,
    /// Radial, of r².
    pub k1: f64,
    /// Radial, of r⁴.
    pub k2: f64,
    /// Tangential, along y.
    pub p1: f64,
    /// Tangential, along x.
    pub p2: f64,
    /// Radial, of r⁶.
    pub k3: f64,
}

/// Why a lens of Brown and Conrady cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BrownConradyError {
    /// A number that is NaN or infinite, or a focal length of 0.
    #[error("the lens has {name} = {value}; hint: every number must be finite, and the focal lengths not 0")]
    Number {
        /// Which number.
        name: &'static str,
        /// What it is.
        value: f64,
    },
    /// The polynomial folds back.
    #[error(
        "the lens folds back {folds_px:.0} px from its centre, where the image reaches to {image_px:.0} px, so places of \
         the image have no ray or two; hint: the distortion coefficients (k1, k2, p1, p2, k3) hold only over the part of \
         the image that was calibrated: look for a swapped order, or calibrate with the board out to the corners"
    )]
    Folds {
        /// How far from the centre in the distorted image, px of the mean focal length.
        folds_px: f64,
        /// How far the image's farthest corner lies from the centre, in the same measure.
        image_px: f64,
    },
    /// Nearly folded.
    #[error(
        "the lens all but folds inside its image: {LENS_STEPS} steps do not find where its pixels look; hint: look for a \
         swapped order of the distortion coefficients (k1, k2, p1, p2, k3)"
    )]
    Slow,
}

impl BrownConrady {
    /// The place in the real image of a place in the ideal one, whether or not the model holds there.
    pub fn distort_px(&self, ideal_px: DVec2) -> DVec2 {
        self.centre_px + self.focal_px * self.distorted((ideal_px - self.centre_px) / self.focal_px)
    }

    /// The model itself, in focal lengths about the centre.
    fn distorted(&self, at: DVec2) -> DVec2 {
        let r2 = at.length_squared();
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let both = 2.0 * at.x * at.y;
        at * radial
            + DVec2::new(
                self.p1 * both + self.p2 * (r2 + 2.0 * at.x * at.x),
                self.p1 * (r2 + 2.0 * at.y * at.y) + self.p2 * both,
            )
    }

    /// Its Jacobian, which is symmetric.
    fn slope(&self, at: DVec2) -> DMat2 {
        let r2 = at.length_squared();
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let growth = 2.0 * self.k1 + r2 * (4.0 * self.k2 + r2 * 6.0 * self.k3);
        let across = growth * at.x * at.y + 2.0 * (self.p1 * at.x + self.p2 * at.y);
        DMat2::from_cols(
            DVec2::new(radial + growth * at.x * at.x + 2.0 * self.p1 * at.y + 6.0 * self.p2 * at.x, across),
            DVec2::new(across, radial + growth * at.y * at.y + 6.0 * self.p1 * at.y + 2.0 * self.p2 * at.x),
        )
    }

    /// The smaller eigenvalue of [`Self::slope`].
    fn least_slope(&self, at: DVec2) -> f64 {
        let slope = self.slope(at);
        let (mean, half) = (0.5 * (slope.x_axis.x + slope.y_axis.y), 0.5 * (slope.x_axis.x - slope.y_axis.y));
        mean - half.hypot(slope.x_axis.y)
    }

    /// Whether the shader's steps, whole ones that are held within the disc, find the ideal places of a grid over an image.
    fn is_found_in_time(&self, reach: f64, size_px: DVec2) -> bool {
        let enough = SHADER_RESIDUAL_PX / self.focal_px.abs().max_element();
        let found = |place_px: DVec2| {
            let wanted = (place_px - self.centre_px) / self.focal_px;
            let at = (0..LENS_STEPS).fold(wanted.clamp_length_max(reach), |at, _| {
                let step = self.slope(at).inverse() * (wanted - self.distorted(at));
                (at + step).clamp_length_max(reach)
            });
            (wanted - self.distorted(at)).length() <= enough
        };
        let across = |i: u32| f64::from(i) / f64::from(CIRCLES / 4);
        (0..=CIRCLES / 4).all(|y| (0..=CIRCLES / 4).all(|x| found(DVec2::new(across(x), across(y)) * size_px)))
    }

    /// Checks that every place of an image has one ideal place.
    ///
    /// # Errors
    /// A number that is not finite; a model that folds back inside the image, with how far from the centre.
    pub fn one_to_one(self, resolution_px: UVec2) -> Result<OneToOne, BrownConradyError> {
        let numbers = [
            ("fx", self.focal_px.x),
            ("fy", self.focal_px.y),
            ("cx", self.centre_px.x),
            ("cy", self.centre_px.y),
            ("k1", self.k1),
            ("k2", self.k2),
            ("p1", self.p1),
            ("p2", self.p2),
            ("k3", self.k3),
        ];
        let usable = |(name, value): &(&str, f64)| value.is_finite() && !(name.starts_with('f') && *value == 0.0);
        if let Some(&(name, value)) = numbers.iter().find(|number| !usable(number)) {
            return Err(BrownConradyError::Number { name, value });
        }

        // The image lies in the disc around the centre through its farthest corner.
        let size_px = resolution_px.as_dvec2();
        let corners_px = [DVec2::ZERO, DVec2::new(size_px.x, 0.0), DVec2::new(0.0, size_px.y), size_px];
        let image = corners_px.map(|corner_px| ((corner_px - self.centre_px) / self.focal_px).length());
        let image = image.into_iter().fold(0.0, f64::max);

        // A disc of ideal places, grown circle by circle while the slope holds, until the image of its rim lies outside of
        // the image's disc on every side: then its own image holds the whole of it. From there a little on.
        let mut holds = None;
        let (mut reach, mut covered) = (0.0, 0.0);
        for circle in 1..=CIRCLES * FARTHEST {
            let radius = image * f64::from(circle) / f64::from(CIRCLES);
            if holds.is_some_and(|holds: f64| radius > MARGIN * holds) {
                break;
            }
            let rim = (0..DIRECTIONS)
                .map(|i| DVec2::from_angle(f64::from(i) * std::f64::consts::TAU / f64::from(DIRECTIONS)) * radius);
            let (slope, nearest) = rim.fold((f64::INFINITY, f64::INFINITY), |(slope, nearest), at| {
                (slope.min(self.least_slope(at)), nearest.min(self.distorted(at).length()))
            });
            // Written so that a NaN, from numbers that overflow, ends the disc too.
            let taken = slope >= LEAST_SLOPE;
            if !taken {
                break;
            }
            (reach, covered) = (radius, nearest);
            if holds.is_none() && covered >= image {
                holds = Some(radius);
            }
        }
        if holds.is_none() {
            let mean_px = 0.5 * (self.focal_px.x.abs() + self.focal_px.y.abs());
            return Err(BrownConradyError::Folds { folds_px: covered * mean_px, image_px: image * mean_px });
        }
        if !self.is_found_in_time(reach, size_px) {
            return Err(BrownConradyError::Slow);
        }
        Ok(OneToOne { model: self, reach })
    }
}

/// A model with the disc on which it is known to be one to one, which holds the whole image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OneToOne {
    model: BrownConrady,
    reach: f64,
}

impl OneToOne {
    /// The model.
    pub fn model(&self) -> &BrownConrady {
        &self.model
    }

    /// The radius of the disc of ideal places, in focal lengths.
    pub fn reach(&self) -> f64 {
        self.reach
    }

    /// The place in the real image; `None` beyond the disc, where the polynomial means nothing.
    pub fn real_px(&self, ideal_px: DVec2) -> Option<DVec2> {
        let at = (ideal_px - self.model.centre_px) / self.model.focal_px;
        (at.length() <= self.reach).then(|| self.model.distort_px(ideal_px))
    }

    /// The place in the ideal image; `None` where no place of the disc comes to it.
    ///
    /// Newton's method with shortened steps: the potential is convex, so that each step leads downhill.
    pub fn ideal_px(&self, real_px: DVec2) -> Option<DVec2> {
        let wanted = (real_px - self.model.centre_px) / self.model.focal_px;
        let mut at = wanted.clamp_length_max(self.reach);
        let mut residual = wanted - self.model.distorted(at);
        for _ in 0..STEPS {
            let enough = RESIDUAL * (1.0 + wanted.length());
            if residual.length() <= enough {
                break;
            }
            let step = self.model.slope(at).inverse() * residual;
            let shorter = (0..32).map(|halvings| at + step * 0.5f64.powi(halvings));
            let better = shorter
                .filter(|next| next.length() <= self.reach)
                .map(|next| (next, wanted - self.model.distorted(next)))
                .find(|(_, left)| left.length() < residual.length());
            // No step is shorter than the last digit: this is as near as f64 comes, or the place lies beyond the disc.
            let Some((next, left)) = better else { break };
            (at, residual) = (next, left);
        }
        let found = residual.length() <= 16.0 * RESIDUAL * (1.0 + wanted.length());
        found.then(|| self.model.centre_px + self.model.focal_px * at)
    }
}
