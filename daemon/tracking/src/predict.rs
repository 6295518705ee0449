//! Where a body will be when the light of a frame leaves the projector.
//!
//! A [`Kalman filter`](crate::kalman) for the place and one for the orientation, each fed by what is heard of it alone, give a
//! velocity each; the pose of a moment is that of the last measurement, moved on along them. A prediction reaches no further
//! than [`FARTHEST`], and of a body that falls silent nothing is made up: within [`SILENT_AFTER`] and [`FADE`] the pose goes
//! back to the last one that was said, and stays there.

use crate::kalman::{Noise, PLACE, TURN, Tuning, Variances};
use crate::pose::{BodyPose, Update, is_place};
use glam::{DQuat, DVec3};
use std::time::{Duration, Instant};

/// The farthest that anything is predicted from its measurement: beyond that, a straight line says nothing of a head.
pub(crate) const FARTHEST: Duration = Duration::from_millis(150);

/// A body of which nothing was heard for so long is silent, and what is predicted of it fades …
const SILENT_AFTER: Duration = Duration::from_millis(250);

/// … to what was said last, within this.
const FADE: Duration = Duration::from_millis(250);

/// What comes after a longer pause is no continuation: velocities start anew.
const PAUSE: Duration = Duration::from_millis(500);

/// What is said again, to the bit, so soon after is the same measurement sent twice, not a body that has stopped.
const REPETITION: Duration = Duration::from_millis(15);

/// By how much the ways of packets differ, where nothing tells of any one (the standard deviation).
const JITTER: Duration = Duration::from_millis(2);

/// Something that moves: sums and differences of it are steps.
trait Place: Copy + PartialEq {
    /// What is known of its motions.
    const TUNING: Tuning;

    /// The step from another to this one.
    fn minus(self, other: Self) -> DVec3;

    /// This one, a step further.
    fn plus(self, step: DVec3) -> Self;
}

impl Place for DVec3 {
    const TUNING: Tuning = PLACE;

    fn minus(self, other: Self) -> DVec3 {
        self - other
    }

    fn plus(self, step: DVec3) -> Self {
        self + step
    }
}

/// Steps are rotations about an axis of the world, as its direction times the angle, rad, by the shorter way.
impl Place for DQuat {
    const TUNING: Tuning = TURN;

    fn minus(self, other: Self) -> DVec3 {
        let turn = self * other.conjugate();
        // Both signs are the same turn, one of them by the longer way.
        if turn.w < 0.0 { -turn } else { turn }.to_scaled_axis()
    }

    fn plus(self, step: DVec3) -> Self {
        (Self::from_scaled_axis(step) * self).normalize()
    }
}

/// When something was measured and heard.
#[derive(Clone, Copy, Debug)]
struct Stamp {
    /// On our clock, as far as that is known.
    measured: Instant,
    /// On the sender's own, ns: without the jitter of the way.
    sender_ns: Option<u64>,
    received: Instant,
}

impl Stamp {
    /// How long after another something was measured; `None` where it was before, or so long after that it does not go on from
    /// there.
    fn since(&self, other: &Self) -> Option<Duration> {
        let by_sender = || self.sender_ns?.checked_sub(other.sender_ns?).map(Duration::from_nanos);
        let by_us = || self.measured.checked_duration_since(other.measured);
        let goes_on = |passed: &Duration| *passed <= PAUSE;
        let heard = self.received.saturating_duration_since(other.received);
        by_sender().filter(goes_on).or_else(by_us).filter(goes_on).filter(|_| heard <= PAUSE)
    }
}

/// Place or orientation of one body.
#[derive(Debug)]
struct Channel<T> {
    /// As it was said last.
    said: T,
    /// As it is estimated to have been then.
    place: T,
    /// Of that moment, a second; the part of it that is believed.
    velocity: DVec3,
    believed: f64,
    variances: Variances,
    noise: Noise,
    stamp: Stamp,
}

impl<T: Place> Channel<T> {
    fn new(said: T, velocity: Option<DVec3>, stamp: Stamp, noise: Noise) -> Self {
        let variances = Variances::new(&T::TUNING, &noise);
        let mut this = Self { said, place: said, velocity: DVec3::ZERO, believed: 0.0, variances, noise, stamp };
        this.hear_velocity(velocity);
        this
    }

    /// Takes what is said of it; `velocity` where the tracker says that itself.
    fn hear(&mut self, said: T, velocity: Option<DVec3>, stamp: Stamp) {
        let Some(passed) = stamp.since(&self.stamp) else {
            // How much the tracker shakes is still known, and nothing else.
            self.noise.interrupt();
            *self = Self::new(said, velocity, stamp, self.noise);
            return;
        };
        if said == self.said && (self.rests() || passed < REPETITION) {
            let measured = if passed < REPETITION { self.stamp } else { stamp };
            self.stamp = Stamp { received: stamp.received, ..measured };
            return;
        }

        let passed_s = passed.as_secs_f64();
        self.noise.hear(said.minus(self.said), &T::TUNING);
        self.variances.pass(passed_s, &T::TUNING);
        let expected = self.place.plus(self.velocity * passed_s);
        let surprise = said.minus(expected);
        // A moment that nobody says is known no better than packets come in time.
        let unknown_s = if stamp.sender_ns.is_some() { 0.0 } else { JITTER.as_secs_f64() };
        let of_moment = self.velocity.length_squared() * unknown_s * unknown_s;
        let [of_place, of_velocity] = self.variances.hear_place(self.noise.variance + of_moment);
        self.place = expected.plus(surprise * of_place);
        self.velocity += surprise * of_velocity;
        (self.said, self.stamp) = (said, stamp);
        self.hear_velocity(velocity);
        self.settle();
    }

    fn hear_velocity(&mut self, said: Option<DVec3>) {
        if let Some(said) = said {
            let surprise = said - self.velocity;
            let [of_place, of_velocity] = self.variances.hear_velocity(T::TUNING.said_velocity.powi(2));
            self.place = self.place.plus(surprise * of_place);
            self.velocity += surprise * of_velocity;
        }
        self.believed = self.variances.belief(self.velocity);
    }

    /// What differs from rest by less than anybody sees rests, so that nothing has to be shown anew for its sake.
    fn settle(&mut self) {
        let farthest = self.velocity * (self.believed * FARTHEST.as_secs_f64());
        if farthest.length() < T::TUNING.unseen && self.place.minus(self.said).length() < T::TUNING.unseen {
            (self.place, self.velocity, self.believed) = (self.said, DVec3::ZERO, 0.0);
        }
    }

    /// Whether it is, now and later, where it was said to be.
    fn rests(&self) -> bool {
        self.velocity == DVec3::ZERO && self.place == self.said
    }

    /// At a time, as seen from now.
    fn at(&self, time: Instant, now: Instant) -> T {
        let silence = self.silence(now);
        if self.rests() || silence >= FADE {
            return self.said;
        }
        let there = self.place.plus(self.velocity * (self.believed * self.since_measured(time).as_secs_f64()));
        if silence.is_zero() {
            return there;
        }
        let left = 1.0 - silence.as_secs_f64() / FADE.as_secs_f64();
        // Without a kink at either end.
        self.said.plus(there.minus(self.said) * (left * left * (3.0 - 2.0 * left)))
    }

    /// For how much longer than trackers may be it has been silent, by now.
    fn silence(&self, now: Instant) -> Duration {
        now.saturating_duration_since(self.stamp.received).saturating_sub(SILENT_AFTER)
    }

    /// How far ahead of its measurement it is shown at a time; `None` where, by now, it has gone back to that.
    fn ahead(&self, time: Instant, now: Instant) -> Option<Duration> {
        (self.silence(now) < FADE).then(|| self.since_measured(time))
    }

    /// How far a time is ahead of the last measurement, as far as that is predicted.
    fn since_measured(&self, time: Instant) -> Duration {
        time.saturating_duration_since(self.stamp.measured).min(FARTHEST)
    }

    /// Until when it changes, if nothing more is heard.
    fn changes_until(&self) -> Option<Instant> {
        (!self.rests()).then(|| self.stamp.received + SILENT_AFTER + FADE)
    }
}

/// One body's motion.
#[derive(Debug, Default)]
pub(crate) struct Predictor {
    position: Option<Channel<DVec3>>,
    orientation: Option<Channel<DQuat>>,
}

/// Adds what is said of a place to its channel.
fn hear<T: Place>(channel: &mut Option<Channel<T>>, said: Option<T>, velocity: Option<DVec3>, stamp: Stamp) {
    match (channel, said) {
        (_, None) => {}
        (Some(channel), Some(said)) => channel.hear(said, velocity, stamp),
        (none, Some(said)) => *none = Some(Channel::new(said, velocity, stamp, Noise::new(&T::TUNING))),
    }
}

impl Predictor {
    /// Takes what a tracker says that was `received`, and `measured` so.
    pub(crate) fn hear(&mut self, update: &Update, measured: Instant, received: Instant) {
        let stamp = Stamp { measured, sender_ns: update.timing.sender_ns, received };
        hear(&mut self.position, update.position_m, update.velocity_m_s, stamp);
        hear(&mut self.orientation, update.orientation, None, stamp);
    }

    /// The pose at a time, as far as it is known now, and how far ahead of its measurement; `pose` is the last one that was said.
    /// A body at rest is as far ahead as any other, since it is expected to stay; one that has been silent until its prediction
    /// has faded is not ahead.
    pub(crate) fn at(&self, pose: &BodyPose, time: Instant, now: Instant) -> (BodyPose, Option<Duration>) {
        let mut pose = pose.clone();
        if let Some(channel) = &self.position {
            // Places that are far from each other tell of velocities that lead out of where anything can be.
            let there = channel.at(time, now);
            pose.position_m = if is_place(there) { there } else { channel.said };
        }
        if let Some(channel) = &self.orientation {
            pose.orientation = channel.at(time, now);
        }
        let position = self.position.as_ref().and_then(|channel| channel.ahead(time, now));
        (pose, position.max(self.orientation.as_ref().and_then(|channel| channel.ahead(time, now))))
    }

    /// Until when the pose changes, if nothing more is heard; `None` of a body at rest.
    pub(crate) fn changes_until(&self) -> Option<Instant> {
        let position = self.position.as_ref().and_then(Channel::changes_until);
        position.max(self.orientation.as_ref().and_then(Channel::changes_until))
    }
}

#[cfg(test)]
mod tests;
