//! opentrack's "UDP over network": six little-endian f64, x, y, z in cm and yaw, pitch, roll in degrees.
//!
//! Yaw turns about +y, pitch about +x, roll the other way about +z, and roll comes first: what opentrack itself does to a
//! translation when it compensates for rotation (`reltrans::rotate` with `euler_to_rmat` of its sources). With x to the
//! right, y up and z back that is: yaw + left, pitch + up, roll + clockwise from behind. Its users can flip each sign,
//! and so can ours.
//!
//! There is one body, no time, no number, no checksum, and no word for a face that is lost.

use crate::protocol::{BodyId, Heard, Protocol, Reading, Refusal, bad};
use glam::{DQuat, DVec3};
use std::net::SocketAddr;
use std::time::Instant;

const BYTES: usize = 48;

/// Reads opentrack's packets.
pub(crate) struct Opentrack {
    pub(crate) signs: [f64; 6],
}

impl Protocol for Opentrack {
    fn read(&mut self, datagram: &[u8], _from: SocketAddr, _at: Instant, heard: &mut Heard) -> Result<(), Refusal> {
        let Ok(bytes) = <&[u8; BYTES]>::try_from(datagram) else {
            return bad(format!("{} bytes instead of {BYTES}", datagram.len()));
        };
        let number = |at: usize| f64::from_le_bytes(std::array::from_fn(|byte| bytes[8 * at + byte]));
        let pose: [f64; 6] = std::array::from_fn(|at| self.signs[at] * number(at));
        if !pose.iter().all(|x| x.is_finite()) {
            return bad("a number that is not finite");
        }
        // Angles wrap at a turn or two; beyond, the bytes are no angles.
        if pose[3..].iter().any(|degrees| degrees.abs() > 1080.0) {
            return bad("an angle of more than three turns");
        }
        let [yaw, pitch, roll] = [3, 4, 5].map(|at: usize| pose[at].to_radians());
        heard.readings.push(Reading {
            position_m: Some(DVec3::new(pose[0], pose[1], pose[2]) / 100.0),
            orientation: Some(
                DQuat::from_rotation_y(yaw) * DQuat::from_rotation_x(pitch) * DQuat::from_rotation_z(-roll),
            ),
            ..Reading::of(BodyId::Only)
        });
        Ok(())
    }
}
