//! What a tracker speaks, with the settings that each protocol has of its own.

use std::net::SocketAddr;

/// Tracker protocols.
#[derive(Clone, Debug, PartialEq)]
pub enum Protocol {
    /// The contract's own 64-byte packets.
    Lantern,
    /// Open Sound Control 1.0.
    Osc(Osc),
    /// OptiTrack's NatNet, 3.0 and later.
    Natnet(Natnet),
    /// FreeD D1 of camera tracking.
    Freed,
    /// PosiStageNet 2.
    Psn,
    /// opentrack's "UDP over network".
    Opentrack(Opentrack),
    /// ART's DTRACK in ASCII.
    Dtrack(Dtrack),
}

impl Protocol {
    /// The name in the configuration and in `status`.
    pub fn as_str(&self) -> &'static str {
        match self {
            Self::Lantern => "lantern",
            Self::Osc(_) => "osc",
            Self::Natnet(_) => "natnet",
            Self::Freed => "freed",
            Self::Psn => "psn",
            Self::Opentrack(_) => "opentrack",
            Self::Dtrack(_) => "dtrack",
        }
    }
}

/// Which OSC messages hold poses.
#[derive(Clone, Debug, PartialEq)]
pub enum Osc {
    /// Virtual Motion Capture: `/VMC/Ext/{Hmd,Con,Tra}/Pos`, bodies by their serial names.
    Vmc,
    /// VRChat: `/tracking/trackers/{1..8,head}/{position,rotation}`.
    Vrchat,
    /// Bridges from OptiTrack: `/rigidbody/<id>/transformation` and `/rb`.
    Optitrack,
    /// The user's own.
    Free(OscPattern),
}

/// Messages of the user's own making.
#[derive(Clone, Debug, PartialEq)]
pub struct OscPattern {
    /// Segments between slashes: words, `*` for any one, and at most one `{id}` for the body's.
    pub address: String,
    /// What the arguments are, in their order.
    pub arguments: Vec<OscArgument>,
    /// The axes of positions and orientations.
    pub axes: Axes,
    /// The length that positions count, m.
    pub unit_m: f64,
}

impl OscPattern {
    /// The part of an address that stands for the body's id.
    pub const ID: &'static str = "{id}";

    /// Whether the messages tell one body from another; else all of them mean the one that there is.
    pub fn tells_bodies_apart(&self) -> bool {
        self.arguments.contains(&OscArgument::Id) || self.address.split('/').any(|part| part == Self::ID || part == "*")
    }
}

/// An argument of an OSC message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OscArgument {
    /// The body's id, a number or a string.
    Id,
    /// A coordinate of the position, by axis.
    Position(usize),
    /// A component of the quaternion: x, y, z, w.
    Quaternion(usize),
    /// A turn about an axis, degrees; about z first, then x, then y, as Unity has it.
    Turn(usize),
    /// The sender's time of measurement, s.
    Time,
    /// Anything, of no interest.
    Skip,
}

/// Axes that trackers use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Axes {
    /// x right, y up, z back: the world's own.
    #[default]
    YUp,
    /// x right, y up, z ahead: left-handed, as in Unity.
    YUpLeft,
    /// x right, y ahead, z up.
    ZUp,
    /// x ahead, y right, z up: left-handed, as in Unreal.
    ZUpLeft,
}

/// Settings of NatNet.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Natnet {
    /// How frames are laid out; `None`: the server is asked.
    pub version: Option<NatnetVersion>,
    /// The server's command port, where it is to be spoken to before it is heard: to connect to one that streams unicast.
    pub server: Option<SocketAddr>,
}

/// The version of a NatNet stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct NatnetVersion {
    /// 3 or 4.
    pub major: u8,
    /// From 0.
    pub minor: u8,
}

impl NatnetVersion {
    /// Whether its frames are laid out in a way that is known: 3.x and 4.x.
    pub fn is_known(self) -> bool {
        matches!(self, Self { major: 3, minor: 0..=1 } | Self { major: 4, .. })
    }
}

impl std::fmt::Display for NatnetVersion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}.{}", self.major, self.minor)
    }
}

/// Settings of opentrack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Opentrack {
    /// 1 or −1 for x, y, z, yaw, pitch and roll: what the sender has flipped.
    pub signs: [f64; 6],
}

impl Default for Opentrack {
    fn default() -> Self {
        Self { signs: [1.0; 6] }
    }
}

/// Settings of DTRACK.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dtrack {
    /// The room's axes, as calibrated: "normal" has z up, "powerwall" y.
    pub axes: Axes,
}
