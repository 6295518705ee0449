//! Synthetic motions of heads for the tests of prediction, and what a tracker and a network make of them.

use glam::{DQuat, DVec3};
use proptest::prelude::Rng;
use proptest::test_runner::{RngAlgorithm, TestRng};
use std::f64::consts::TAU;

/// The same numbers in every run.
pub(crate) struct Random(TestRng);

impl Random {
    pub(crate) fn new(seed: u8) -> Self {
        Self(TestRng::from_seed(RngAlgorithm::ChaCha, &[seed; 32]))
    }

    /// In (0, 1].
    pub(crate) fn unit(&mut self) -> f64 {
        ((self.0.next_u64() >> 11) + 1) as f64 / (1u64 << 53) as f64
    }

    /// Of mean 0 and deviation 1, each axis (Box and Muller).
    pub(crate) fn normal(&mut self) -> DVec3 {
        let mut one = || (-2.0 * self.unit().ln()).sqrt() * (TAU * self.unit()).cos();
        DVec3::new(one(), one(), one())
    }
}

/// Where a head goes: sines of a few frequencies, or strides from place to place with rests in between.
pub(crate) enum Path {
    /// Frequency, Hz; amplitude, m; phase of each axis, rad.
    Sines(Vec<(f64, f64, DVec3)>),
    /// Start, s; length, s; from; to.
    Strides(Vec<(f64, f64, DVec3, DVec3)>),
    /// Nowhere.
    Rest,
}

impl Path {
    fn sines(of: [(f64, f64); 3]) -> Self {
        let mut random = Random::new(1);
        Self::Sines(of.map(|(hz, m)| (hz, m, DVec3::new(random.unit(), random.unit(), random.unit()) * TAU)).to_vec())
    }

    /// Somebody who walks about slowly.
    pub(crate) fn sway() -> Self {
        Self::sines([(0.3, 0.3), (0.8, 0.08), (1.7, 0.02)])
    }

    /// Somebody who hastens: up to 3 m/s and 20 m/s².
    pub(crate) fn brisk() -> Self {
        Self::sines([(0.5, 0.25), (1.1, 0.1), (2.3, 0.03)])
    }

    /// From place to place, with the least jerk (Flash and Hogan 1985), and rests.
    pub(crate) fn strides() -> Self {
        let mut random = Random::new(5);
        let (mut start, mut from, mut strides) = (0.5, DVec3::ZERO, Vec::new());
        while start < 60.0 {
            let length = 0.5 + 0.7 * random.unit();
            let to = (DVec3::new(random.unit(), random.unit(), random.unit()) - 0.5) * DVec3::new(1.0, 0.3, 0.7);
            strides.push((start, length, from, to));
            (start, from) = (start + length + 0.3 + 0.7 * random.unit(), to);
        }
        Self::Strides(strides)
    }

    /// Where it is, m, after so many seconds.
    pub(crate) fn place(&self, t: f64) -> DVec3 {
        match self {
            Self::Sines(waves) => {
                waves.iter().map(|(hz, m, phase)| (DVec3::splat(TAU * hz * t) + *phase).map(f64::sin) * *m).sum()
            }
            Self::Strides(strides) => {
                let now = strides.iter().rev().find(|(start, ..)| *start <= t);
                now.map_or(DVec3::ZERO, |(start, length, from, to)| {
                    let s = ((t - start) / length).min(1.0);
                    from.lerp(*to, s * s * s * (10.0 - s * (15.0 - 6.0 * s)))
                })
            }
            Self::Rest => DVec3::ZERO,
        }
    }

    /// How it is turned: by 2 rad for a metre, about all axes.
    pub(crate) fn turn(&self, t: f64) -> DQuat {
        DQuat::from_scaled_axis(self.place(t) * 2.0)
    }

    /// Its velocity, m/s.
    pub(crate) fn velocity(&self, t: f64) -> DVec3 {
        (self.place(t + 1e-4) - self.place(t - 1e-4)) / 2e-4
    }
}

/// A tracker and the way from it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Way {
    /// Measurements a second.
    pub(crate) rate_hz: f64,
    /// What every packet takes, s.
    pub(crate) latency_s: f64,
    /// What it takes beyond, on the average: exponentially spread, s.
    pub(crate) jitter_s: f64,
    /// The part of packets that never comes.
    pub(crate) loss: f64,
    /// Standard deviation of places, m, and of turns, rad.
    pub(crate) noise: [f64; 2],
}

/// A packet: when it was measured and when it comes, s; what it says.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Packet {
    pub(crate) measured_s: f64,
    pub(crate) received_s: f64,
    pub(crate) place: DVec3,
    pub(crate) turn: DQuat,
    pub(crate) velocity: DVec3,
}

impl Way {
    /// What comes of a motion of so many seconds, in the order in which it comes; what is overtaken is dropped, as sources do.
    pub(crate) fn packets(&self, path: &Path, length_s: f64) -> Vec<Packet> {
        let mut random = Random::new(2);
        let mut packets = Vec::new();
        for index in 0..(length_s * self.rate_hz) as u32 {
            let measured_s = f64::from(index) / self.rate_hz;
            let late_s = -self.jitter_s * random.unit().ln();
            let packet = Packet {
                measured_s,
                received_s: measured_s + self.latency_s + late_s,
                place: path.place(measured_s) + random.normal() * self.noise[0],
                turn: DQuat::from_scaled_axis(random.normal() * self.noise[1]) * path.turn(measured_s),
                velocity: path.velocity(measured_s),
            };
            if random.unit() > self.loss {
                packets.push(packet);
            }
        }
        packets.sort_by(|a, b| a.received_s.total_cmp(&b.received_s));
        let mut newest = -1.0;
        packets.retain(|packet| {
            let is_newer = packet.measured_s > newest;
            newest = packet.measured_s.max(newest);
            is_newer
        });
        packets
    }
}
