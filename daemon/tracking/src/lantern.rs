//! The protocol `lantern`: 64-byte packets (CONTRACT, "UDP pose").

use crate::protocol::{Protocol, Reading};
use glam::{DQuat, Quat, Vec3};
use lantern_proto::PosePacket;

/// Reads [`PosePacket`]s.
pub(crate) struct Lantern;

impl Protocol for Lantern {
    fn read(&mut self, datagram: &[u8]) -> Result<Reading, String> {
        let packet = PosePacket::decode(datagram).map_err(|error| error.to_string())?;
        let vector = |v: [f32; 3]| Vec3::from_array(v).as_dvec3();
        Ok(Reading {
            body_id: packet.body_id,
            sequence: packet.sequence,
            measured_ns: packet.measured_ns,
            position_m: packet.position_m.map(vector),
            // The packet's norm is off by 1 % at most, and rotations must not scale.
            orientation: packet.orientation.map(|q| DQuat::normalize(Quat::from_array(q).as_dquat())),
            velocity_m_s: packet.velocity_m_s.map(vector),
        })
    }
}
