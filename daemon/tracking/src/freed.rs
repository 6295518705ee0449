//! FreeD's message D1: a tracked camera in 29 bytes, big-endian, 24-bit two's complement.
//!
//! | at | what |
//! |---|---|
//! | 0 | 0xD1 |
//! | 1 | camera's number |
//! | 2, 5, 8 | pan (+ right), tilt (+ up), roll (+ clockwise from behind), degrees / 32768 |
//! | 11, 14, 17 | X right, Y ahead, Z up, mm / 64 |
//! | 20, 23, 26 | zoom, focus, spare: not used |
//! | 28 | 0x40 less the sum of all before, modulo 256 |
//!
//! There is no time, no number and no word for a camera that is lost.

use crate::axes::Axes;
use crate::protocol::{BodyId, Heard, Protocol, Reading, Refusal, bad};
use glam::{DQuat, DVec3};
use std::net::SocketAddr;
use std::time::Instant;

const BYTES: usize = 29;
const TYPE_D1: u8 = 0xd1;

/// Reads D1 messages.
pub(crate) struct Freed;

impl Protocol for Freed {
    fn read(&mut self, datagram: &[u8], _from: SocketAddr, _at: Instant, heard: &mut Heard) -> Result<(), Refusal> {
        let Ok(bytes) = <&[u8; BYTES]>::try_from(datagram) else {
            return bad(format!("{} bytes instead of {BYTES}", datagram.len()));
        };
        if bytes[0] != TYPE_D1 {
            return bad(format!("message type {:#04x} is not 0xd1, a pose", bytes[0]));
        }
        let sum = bytes[..BYTES - 1].iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        if bytes[BYTES - 1] != 0x40_u8.wrapping_sub(sum) {
            return bad("checksum does not match");
        }

        let number = |at: usize| f64::from(i32::from_be_bytes([bytes[at], bytes[at + 1], bytes[at + 2], 0]) >> 8);
        let [pan, tilt, roll] = [2, 5, 8].map(|at| (number(at) / 32768.0).to_radians());
        let position_mm = DVec3::new(number(11), number(14), number(17)) / 64.0;
        heard.readings.push(Reading {
            position_m: Some(Axes::Z_UP.vector(position_mm / 1000.0)),
            orientation: Some(rotation(pan, tilt, roll)),
            ..Reading::of(BodyId::Number(bytes[1].into()))
        });
        Ok(())
    }
}

/// A camera that first rolls about its own axis, then tilts, then pans: right, up and clockwise are positive, rad.
fn rotation(pan: f64, tilt: f64, roll: f64) -> DQuat {
    DQuat::from_rotation_y(-pan) * DQuat::from_rotation_x(tilt) * DQuat::from_rotation_z(-roll)
}
