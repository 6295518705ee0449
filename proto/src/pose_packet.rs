//! The UDP pose packet of protocol `lantern`: 64 bytes, little-endian (CONTRACT, "UDP pose").

/// The length of every packet.
pub const POSE_PACKET_BYTES: usize = 64;

/// The first four bytes.
pub const POSE_PACKET_MAGIC: [u8; 4] = *b"LNTP";

/// The only version.
pub const POSE_PACKET_VERSION: u8 = 1;

/// Flag bit: the position is valid.
pub const POSE_FLAG_POSITION: u8 = 1;
/// Flag bit: the orientation is valid.
pub const POSE_FLAG_ORIENTATION: u8 = 2;
/// Flag bit: the velocity is valid.
pub const POSE_FLAG_VELOCITY: u8 = 4;

/// How far a quaternion's norm may be from 1.
const NORM_TOLERANCE: f64 = 0.01;

/// One packet. A field whose flag is off is `None`, whatever its bytes say.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PosePacket {
    /// The tracker's number of the body.
    pub body_id: u16,
    /// Grows by packet and wraps.
    pub sequence: u32,
    /// When it was measured, ns on the sender's own clock; `None` where the sender does not know (0 on the wire).
    pub measured_ns: Option<u64>,
    /// Metres, in the tracker's frame.
    pub position_m: Option<[f32; 3]>,
    /// Tracker from body, x, y, z, w; its norm is 1 within 1 %.
    pub orientation: Option<[f32; 4]>,
    /// Metres a second, in the tracker's frame.
    pub velocity_m_s: Option<[f32; 3]>,
}

/// Why a datagram is no pose packet.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PosePacketError {
    /// Any length but 64.
    #[error("{bytes} bytes instead of {POSE_PACKET_BYTES}")]
    Length {
        /// What came.
        bytes: usize,
    },
    /// Other first bytes.
    #[error("magic {magic:02x?} instead of \"LNTP\"")]
    Magic {
        /// What came.
        magic: [u8; 4],
    },
    /// A version that this daemon does not know.
    #[error("version {version} instead of {POSE_PACKET_VERSION}")]
    Version {
        /// What came.
        version: u8,
    },
    /// NaN or an infinity.
    #[error("non-finite {field}")]
    NonFinite {
        /// `position`, `orientation` or `velocity`.
        field: &'static str,
    },
    /// The quaternion is no rotation.
    #[error("quaternion norm {norm:.4} is off by more than 1 %")]
    Norm {
        /// What came.
        norm: f64,
    },
}

impl PosePacket {
    /// Reads a datagram.
    ///
    /// # Errors
    /// What is wrong with it first: length, magic, version, non-finite number, norm. A number is checked whether or not
    /// its flag says that it is valid, a norm only where it does: an absent orientation is often all zeros. The word at
    /// 12 and the flag bits that version 1 does not name are for later versions and are not looked at.
    pub fn decode(bytes: &[u8]) -> Result<Self, PosePacketError> {
        let bytes: &[u8; POSE_PACKET_BYTES] =
            bytes.try_into().map_err(|_| PosePacketError::Length { bytes: bytes.len() })?;
        let magic = take::<4>(bytes, 0);
        if magic != POSE_PACKET_MAGIC {
            return Err(PosePacketError::Magic { magic });
        }
        if bytes[4] != POSE_PACKET_VERSION {
            return Err(PosePacketError::Version { version: bytes[4] });
        }
        let flags = bytes[5];

        let position_m = floats::<3>(bytes, 24, "position")?;
        let orientation = floats::<4>(bytes, 36, "orientation")?;
        let velocity_m_s = floats::<3>(bytes, 52, "velocity")?;
        let valid = |bit: u8| flags & bit != 0;
        if valid(POSE_FLAG_ORIENTATION) {
            let norm = orientation.iter().map(|&x| f64::from(x) * f64::from(x)).sum::<f64>().sqrt();
            if (norm - 1.0).abs() > NORM_TOLERANCE {
                return Err(PosePacketError::Norm { norm });
            }
        }

        let measured_ns = u64::from_le_bytes(take(bytes, 16));
        Ok(Self {
            body_id: u16::from_le_bytes(take(bytes, 6)),
            sequence: u32::from_le_bytes(take(bytes, 8)),
            measured_ns: (measured_ns != 0).then_some(measured_ns),
            position_m: valid(POSE_FLAG_POSITION).then_some(position_m),
            orientation: valid(POSE_FLAG_ORIENTATION).then_some(orientation),
            velocity_m_s: valid(POSE_FLAG_VELOCITY).then_some(velocity_m_s),
        })
    }

    /// Writes the datagram. Absent fields are zeros.
    pub fn encode(&self) -> [u8; POSE_PACKET_BYTES] {
        let mut bytes = [0; POSE_PACKET_BYTES];
        let mut put = |at: usize, data: &[u8]| bytes[at..at + data.len()].copy_from_slice(data);
        let flag = |present: bool, bit: u8| if present { bit } else { 0 };
        put(0, &POSE_PACKET_MAGIC);
        put(4, &[POSE_PACKET_VERSION]);
        put(
            5,
            &[flag(self.position_m.is_some(), POSE_FLAG_POSITION)
                | flag(self.orientation.is_some(), POSE_FLAG_ORIENTATION)
                | flag(self.velocity_m_s.is_some(), POSE_FLAG_VELOCITY)],
        );
        put(6, &self.body_id.to_le_bytes());
        put(8, &self.sequence.to_le_bytes());
        put(16, &self.measured_ns.unwrap_or(0).to_le_bytes());
        let numbers = self.position_m.unwrap_or_default().into_iter();
        let numbers = numbers.chain(self.orientation.unwrap_or_default()).chain(self.velocity_m_s.unwrap_or_default());
        for (index, number) in numbers.enumerate() {
            put(24 + 4 * index, &number.to_le_bytes());
        }
        bytes
    }
}

/// Whether `sequence` is newer than `last`, in serial number arithmetic (RFC 1982): less than half the range ahead.
pub fn sequence_is_newer(sequence: u32, last: u32) -> bool {
    matches!(sequence.wrapping_sub(last), 1..=0x7fff_ffff)
}

fn take<const N: usize>(bytes: &[u8; POSE_PACKET_BYTES], at: usize) -> [u8; N] {
    std::array::from_fn(|i| bytes[at + i])
}

fn floats<const N: usize>(
    bytes: &[u8; POSE_PACKET_BYTES],
    at: usize,
    field: &'static str,
) -> Result<[f32; N], PosePacketError> {
    let numbers: [f32; N] = std::array::from_fn(|i| f32::from_le_bytes(take(bytes, at + 4 * i)));
    if numbers.iter().all(|x| x.is_finite()) { Ok(numbers) } else { Err(PosePacketError::NonFinite { field }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn packet() -> PosePacket {
        PosePacket {
            body_id: 0x0201,
            sequence: 0x0605_0403,
            measured_ns: Some(0x1122_3344_5566_7788),
            position_m: Some([1.0, -2.0, 3.5]),
            orientation: Some([0.0, 0.6, 0.0, 0.8]),
            velocity_m_s: Some([0.25, 0.0, -0.5]),
        }
    }

    #[test]
    fn layout_is_the_contracts() {
        let bytes = packet().encode();
        assert_eq!(&bytes[..16], b"LNTP\x01\x07\x01\x02\x03\x04\x05\x06\0\0\0\0");
        assert_eq!(&bytes[16..24], &0x1122_3344_5566_7788_u64.to_le_bytes());
        assert_eq!(&bytes[24..28], &1.0_f32.to_le_bytes());
        assert_eq!(&bytes[48..52], &0.8_f32.to_le_bytes());
        assert_eq!(&bytes[60..64], &(-0.5_f32).to_le_bytes());
        assert_eq!(PosePacket::decode(&bytes), Ok(packet()));
    }

    #[test]
    fn flags_say_what_is_there() {
        for flags in 0..8_u8 {
            let mut bytes = packet().encode();
            bytes[5] = flags;
            let read = PosePacket::decode(&bytes).unwrap();
            assert_eq!(read.position_m.is_some(), flags & 1 != 0);
            assert_eq!(read.orientation.is_some(), flags & 2 != 0);
            assert_eq!(read.velocity_m_s.is_some(), flags & 4 != 0);
        }
        let position_alone = PosePacket { position_m: Some([0.0; 3]), ..PosePacket::default() };
        assert_eq!(PosePacket::decode(&position_alone.encode()), Ok(position_alone));
    }

    #[test]
    fn each_reason_of_rejection() {
        let with = |at: usize, data: &[u8]| {
            let mut bytes = packet().encode();
            bytes[at..at + data.len()].copy_from_slice(data);
            PosePacket::decode(&bytes).unwrap_err()
        };
        for bytes in [0, 63, 65, 1500] {
            assert_eq!(PosePacket::decode(&vec![0; bytes]), Err(PosePacketError::Length { bytes }));
        }
        assert_eq!(with(0, b"LNTQ"), PosePacketError::Magic { magic: *b"LNTQ" });
        assert_eq!(with(4, &[2]), PosePacketError::Version { version: 2 });
        for (at, field) in [(24, "position"), (48, "orientation"), (60, "velocity")] {
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                assert_eq!(with(at, &bad.to_le_bytes()), PosePacketError::NonFinite { field });
            }
        }
        assert!(
            matches!(with(48, &0.82_f32.to_le_bytes()), PosePacketError::Norm { norm } if (norm - 1.016).abs() < 1e-3)
        );
        assert!(matches!(with(48, &0.0_f32.to_le_bytes()), PosePacketError::Norm { .. }));
    }

    #[test]
    fn norm_may_be_off_by_one_percent() {
        for (norm, good) in [(0.9899, false), (0.9901, true), (1.0, true), (1.0099, true), (1.0101, false)] {
            let packet = PosePacket { orientation: Some([0.0, 0.0, 0.0, norm]), ..packet() };
            assert_eq!(PosePacket::decode(&packet.encode()).is_ok(), good, "{norm}");
        }
    }

    #[test]
    fn sequences_wrap() {
        assert!(sequence_is_newer(1, 0));
        assert!(sequence_is_newer(0, u32::MAX));
        assert!(sequence_is_newer(5, u32::MAX - 5));
        assert!(!sequence_is_newer(7, 7));
        assert!(!sequence_is_newer(6, 7));
        assert!(!sequence_is_newer(u32::MAX, 0));
        assert!(!sequence_is_newer(0x8000_0000, 0));
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(
            body_id: u16,
            sequence: u32,
            measured in 1_u64..,
            position in proptest::array::uniform3(-1e6_f32..1e6),
            velocity in proptest::option::of(proptest::array::uniform3(-1e3_f32..1e3)),
            turn_rad in 0.0_f32..6.3,
        ) {
            let (sin, cos) = turn_rad.sin_cos();
            let packet = PosePacket {
                body_id, sequence, measured_ns: Some(measured), position_m: Some(position),
                orientation: Some([sin, 0.0, 0.0, cos]), velocity_m_s: velocity,
            };
            prop_assert_eq!(PosePacket::decode(&packet.encode()), Ok(packet));
        }

        /// No datagram can make it panic, and what it accepts is finite.
        #[test]
        fn garbage_is_rejected_or_sane(mut bytes in proptest::collection::vec(any::<u8>(), POSE_PACKET_BYTES)) {
            bytes[..5].copy_from_slice(b"LNTP\x01");
            bytes[5] &= 7;
            bytes[12..16].fill(0);
            if let Ok(packet) = PosePacket::decode(&bytes) {
                prop_assert!(packet.position_m.unwrap_or_default().iter().all(|x| x.is_finite()));
            }
        }
    }
}
