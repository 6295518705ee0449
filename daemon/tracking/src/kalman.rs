//! A Kalman filter for a motion of constant velocity, for three axes alike, and how much what it hears shakes.
//!
//! The model is that of Kalman (*A New Approach to Linear Filtering and Prediction Problems*, 1960) with white noise for
//! acceleration (Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section
//! 6.2). All axes have the same variances, so these are kept once. docs/performance.md compares it with the 1€ filter
//! (Casiez, Roussel and Vogel, CHI 2012).

use glam::DVec3;

/// What is known of a kind of motion beforehand. Units are m for places and rad for orientations.
#[derive(Debug)]
pub(crate) struct Tuning {
    /// Spectral density of the acceleration, unit²/s³: how soon another velocity is believed.
    pub(crate) agility: f64,
    /// Standard deviation of what is heard: at first, at least, at most.
    pub(crate) noise: [f64; 3],
    /// Standard deviation of a velocity that nobody has said anything about, unit/s.
    pub(crate) first_velocity: f64,
    /// Standard deviation of a velocity that a tracker says itself, unit/s.
    pub(crate) said_velocity: f64,
    /// What nobody sees, unit.
    pub(crate) unseen: f64,
}

/// Of heads and of what hands carry, m. Measured: docs/performance.md.
pub(crate) const PLACE: Tuning =
    Tuning { agility: 1.0, noise: [0.5e-3, 0.3e-3, 20e-3], first_velocity: 1.0, said_velocity: 0.02, unseen: 1e-5 };

/// Of their orientations, rad.
pub(crate) const TURN: Tuning =
    Tuning { agility: 25.0, noise: [1e-3, 0.5e-3, 50e-3], first_velocity: 5.0, said_velocity: 0.1, unseen: 1e-5 };

/// Variances of place and velocity, and their covariance, of each axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Variances {
    place: f64,
    both: f64,
    velocity: f64,
}

impl Variances {
    /// Of a place heard for the first time.
    pub(crate) fn new(tuning: &Tuning, noise: &Noise) -> Self {
        Self { place: noise.variance, both: 0.0, velocity: tuning.first_velocity.powi(2) }
    }

    /// After a time without news, s.
    pub(crate) fn pass(&mut self, dt_s: f64, tuning: &Tuning) {
        let Self { both, velocity, .. } = *self;
        self.place += dt_s * (2.0 * both + dt_s * (velocity + tuning.agility * dt_s / 3.0));
        self.both += dt_s * (velocity + tuning.agility * dt_s / 2.0);
        self.velocity += dt_s * tuning.agility;
    }

    /// A place is heard: by how much of the surprise place and velocity are to be corrected; the latter in 1/s.
    pub(crate) fn hear_place(&mut self, variance: f64) -> [f64; 2] {
        let sum = self.place + variance;
        let gains = [self.place / sum, self.both / sum];
        self.velocity -= gains[1] * self.both;
        self.both -= gains[0] * self.both;
        self.place -= gains[0] * self.place;
        gains
    }

    /// A velocity is heard: as [`Self::hear_place`]; the former in s.
    pub(crate) fn hear_velocity(&mut self, variance: f64) -> [f64; 2] {
        let sum = self.velocity + variance;
        let gains = [self.both / sum, self.velocity / sum];
        self.place -= gains[0] * self.both;
        self.both -= gains[1] * self.both;
        self.velocity -= gains[1] * self.velocity;
        gains
    }

    /// How much of a velocity is to be believed, 0 to 1: none of one that is no greater than its own uncertainty, so that what
    /// stands still does not shake, and nearly all of a motion. The form is that of James and Stein's estimator (1961) with its
    /// positive part; the constant is that of three axes' whole variance.
    pub(crate) fn belief(&self, velocity: DVec3) -> f64 {
        let square = velocity.length_squared();
        if square > 0.0 { (1.0 - 3.0 * self.velocity / square).max(0.0) } else { 0.0 }
    }
}

/// By how much what is heard shakes, learnt from it.
///
/// Third differences of a smooth motion nearly vanish, while those of noise of variance r have 20 r, each axis. Their lower
/// 30 % is where the estimate is held, so that neither gaps nor hasty moves count.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Noise {
    /// Of each axis, unit².
    pub(crate) variance: f64,
    /// The last step, and the one before.
    steps: [Option<DVec3>; 2],
}

/// The quantile that is held, and the squared length of a third difference there, in variances of an axis: 20 times that
/// quantile of χ² with three degrees of freedom.
const QUANTILE: f64 = 0.3;
const SQUARE_AT_QUANTILE: f64 = 20.0 * 1.424;

/// How far one step moves the estimate, as a logarithm: a factor of 10 takes some 30 to 80 of them.
const PACE: f64 = 0.1;

impl Noise {
    pub(crate) fn new(tuning: &Tuning) -> Self {
        Self { variance: tuning.noise[0].powi(2), steps: [None; 2] }
    }

    /// What is heard next belongs to no step.
    pub(crate) fn interrupt(&mut self) {
        self.steps = [None; 2];
    }

    /// What was heard lies by `step` from what was heard before.
    pub(crate) fn hear(&mut self, step: DVec3, tuning: &Tuning) {
        if let [Some(last), Some(before)] = self.steps {
            let sample = (step - 2.0 * last + before).length_squared() / SQUARE_AT_QUANTILE;
            let toward = if sample > self.variance { QUANTILE } else { QUANTILE - 1.0 };
            let [_, least, most] = tuning.noise.map(|deviation| deviation * deviation);
            self.variance = (self.variance * (PACE * toward).exp()).clamp(least, most);
        }
        self.steps = [Some(step), self.steps[0]];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paths_tests::{Path, Random};

    /// Against the textbook: products of 2 × 2 matrices.
    #[test]
    fn variances_are_those_of_the_matrices() {
        use glam::{DMat2, DVec2};
        let noise = Noise::new(&PLACE);
        let mut variances = Variances::new(&PLACE, &noise);
        let mut p = DMat2::from_diagonal(DVec2::new(noise.variance, 1.0));
        let outer = |a: DVec2, b: DVec2| DMat2::from_cols(a * b.x, a * b.y);
        for step in 0..50 {
            let dt = 0.004 + 0.001 * f64::from(step % 7);
            variances.pass(dt, &PLACE);
            let f = DMat2::from_cols(DVec2::X, DVec2::new(dt, 1.0));
            let (cube, square) = (dt.powi(3) / 3.0, dt * dt / 2.0);
            p = f * p * f.transpose() + DMat2::from_cols(DVec2::new(cube, square), DVec2::new(square, dt));
            let (axis, variance) = if step % 3 == 0 { (DVec2::Y, 4e-4) } else { (DVec2::X, 2.5e-7) };
            let gain = p * axis / (axis.dot(p * axis) + variance);
            p -= outer(gain, p.transpose() * axis);
            let gains = if step % 3 == 0 { variances.hear_velocity(variance) } else { variances.hear_place(variance) };
            assert!((DVec2::from_array(gains) - gain).length() < 1e-9 * gain.length(), "{step}");
            let of = [variances.place - p.x_axis.x, variances.both - p.y_axis.x, variances.velocity - p.y_axis.y];
            assert!(of.iter().all(|error| error.abs() < 1e-12), "{step}: {of:?}");
        }
    }

    #[test]
    fn noise_is_learnt_at_rest_and_in_motion() {
        for (deviation, moves, rate_hz) in
            [(0.5e-3, false, 120.0), (3e-3, false, 60.0), (1e-3, true, 120.0), (4e-3, true, 240.0), (10e-3, true, 60.0)]
        {
            let mut random = Random::new(7);
            let path = Path::brisk();
            let mut noise = Noise::new(&PLACE);
            let (mut before, mut sum, mut count) = (None, 0.0, 0.0);
            for step in 0..2000 {
                let t = f64::from(step) / rate_hz;
                let place = if moves { path.place(t) } else { DVec3::ONE } + random.normal() * deviation;
                if let Some(before) = before.replace(place) {
                    // One in twenty is lost, which makes its neighbours' differences large.
                    if step % 20 != 0 {
                        noise.hear(place - before, &PLACE);
                    }
                }
                if step > 300 {
                    (sum, count) = (sum + noise.variance.sqrt(), count + 1.0);
                }
            }
            let learnt = sum / count;
            assert!((0.8..1.35).contains(&(learnt / deviation)), "{learnt} for {deviation}, moving: {moves}");
        }
        // It stays within its bounds.
        let mut noise = Noise::new(&PLACE);
        (0..1000).for_each(|_| noise.hear(DVec3::ZERO, &PLACE));
        assert!((noise.variance.sqrt() - PLACE.noise[1]).abs() < 1e-12);
        (0..1000).for_each(|step| noise.hear(DVec3::splat(f64::from(step % 2)), &PLACE));
        assert!((noise.variance.sqrt() - PLACE.noise[2]).abs() < 1e-12);
    }

    #[test]
    fn belief_grows_from_none_to_all() {
        let mut variances = Variances::new(&PLACE, &Noise::new(&PLACE));
        variances.velocity = 0.01f64.powi(2);
        assert_eq!(variances.belief(DVec3::ZERO), 0.0);
        assert_eq!(variances.belief(DVec3::X * 0.017), 0.0);
        assert!((0.2..0.3).contains(&variances.belief(DVec3::X * 0.02)));
        assert!(variances.belief(DVec3::X) > 0.999);
    }
}
