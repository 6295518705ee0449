//! The protocol `lantern`: 64-byte packets (CONTRACT, "UDP pose").

use crate::protocol::{BodyId, Heard, Protocol, Reading, Refusal};
use glam::{DQuat, Quat, Vec3};
use lantern_proto::PosePacket;
use std::net::SocketAddr;
use std::time::Instant;

/// Reads [`PosePacket`]s.
pub(crate) struct Lantern;

impl Protocol for Lantern {
    fn read(&mut self, datagram: &[u8], _from: SocketAddr, _at: Instant, heard: &mut Heard) -> Result<(), Refusal> {
        let packet = PosePacket::decode(datagram).map_err(|error| Refusal::Bad(error.to_string()))?;
        let vector = |v: [f32; 3]| Vec3::from_array(v).as_dvec3();
        heard.readings.push(Reading {
            body: BodyId::Number(packet.body_id.into()),
            sequence: Some(packet.sequence),
            measured_ns: packet.measured_ns,
            position_m: packet.position_m.map(vector),
            // The packet's norm is off by 1 % at most, and rotations must not scale.
            orientation: packet.orientation.map(|q| DQuat::normalize(Quat::from_array(q).as_dquat())),
            velocity_m_s: packet.velocity_m_s.map(vector),
        });
        Ok(())
    }
}
