//! The configuration in memory.
//!
//! Vectors are arrays in metres, quaternions x, y, z, w, matrices arrays of rows, all in the world frame: right-handed,
//! +Y up. Paths are absolute or relative to the working folder: those of the file have been joined to its folder.

use crate::calibration::{Calibration, Matrix4};
use crate::places::Places;
use crate::protocol::Protocol;
use crate::scene::Scene;
use std::collections::BTreeMap;
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;

/// A whole configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// The folder of the file: what relative paths start from.
    pub base_dir: PathBuf,
    /// `[daemon]`.
    pub daemon: Daemon,
    /// `[device]`.
    pub device: Device,
    /// `[render]`.
    pub render: Render,
    /// `[metrics]`.
    pub metrics: Metrics,
    /// `[scene]`.
    pub scene: Scene,
    /// `[[body]]`, in the file's order.
    pub bodies: Vec<Body>,
    /// `[[tracker]]`, in the file's order.
    pub trackers: Vec<Tracker>,
    /// `[[projector]]`, in the file's order; at least one.
    pub projectors: Vec<Projector>,
    /// `[limits]`.
    pub limits: Limits,
    /// Where its entries stand in the text, for those who find something wrong with what an entry names.
    pub places: Places,
}

impl Config {
    /// The body whose pose is the viewer's eye; `None` where no body drives it.
    pub fn viewer(&self) -> Option<&Body> {
        self.bodies.iter().find(|body| body.drives == Some(Drives::Viewer))
    }
}

/// Where the daemon listens and what it keeps.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Daemon {
    /// The control socket, unless the command line or the environment names one.
    pub socket: Option<PathBuf>,
    /// The group whose members may operate the daemon, besides root and its own user, by name or by number; `None`: whoever can
    /// connect to the socket. Our addition to the contract.
    pub group: Option<String>,
    /// Where the scene is kept across restarts; `None`: nothing is kept.
    pub state_dir: Option<PathBuf>,
    /// The only folders from which a client may have files read.
    pub asset_roots: Vec<PathBuf>,
}

/// Which Vulkan device renders.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Device {
    /// Part of a name, a UUID, or an index; `None`: the best there is.
    pub select: Option<String>,
    /// By what it traces rays.
    pub ray_tracing: RayTracing,
}

/// By what rays are traced.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RayTracing {
    /// By the device's own ray queries where it has them and is no processor, else by walking the scene's structures.
    #[default]
    Auto,
    /// By walking the scene's structures in shaders, which every device can.
    Bvh,
    /// By the device's ray queries; one without is refused.
    RayQuery,
}

/// Numbers for Prometheus. Our addition to the contract.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Metrics {
    /// Where they can be had by HTTP, an address of the loopback; `None`: nowhere.
    pub listen: Option<SocketAddr>,
}

/// How frames are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Render {
    /// Per pixel, a square number from 1 to 256: a jittered grid, or for 1 the pixel's centre.
    pub samples: u32,
    /// Secondary rays deep, 0 to 64.
    pub max_depth: u32,
    /// When raster nodes are drawn.
    pub raster: RasterOrder,
    /// Whether overlapping projectors share the light of what both reach.
    pub blend: bool,
    /// To look for faults: every frame is made wholly anew, and nothing of the last one kept.
    pub always_full: bool,
    /// Whether frames may be coarser rather than late while things move; `None`: where an output shows them to people.
    pub degrade: Option<bool>,
}

impl Default for Render {
    fn default() -> Self {
        Self { samples: 4, max_depth: 8, raster: RasterOrder::After, blend: true, always_full: false, degrade: None }
    }
}

/// When raster nodes are drawn, beside the composite pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RasterOrder {
    /// First the raster nodes, then the traced image against their depth.
    Before,
    /// First the traced image with its depth, then the raster nodes.
    After,
}

/// Whatever a tracker can move.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Unique among bodies.
    pub name: String,
    /// What follows it; `None`: it shows in `status` alone.
    pub drives: Option<Drives>,
    /// Where it is until a tracker speaks; each at most 1e8.
    pub position_m: [f64; 3],
    /// From the tracked point to the eye (or to the node's origin), in the body's frame; each at most 1e8.
    pub offset_m: [f64; 3],
}

/// What a body moves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Drives {
    /// The eye.
    Viewer,
    /// The node of this name, which the scene has.
    Node(String),
    /// The projector of this name, which the configuration has. Its calibration holds where the body stands at its
    /// `position_m`, unturned.
    Projector(String),
}

/// A source of poses.
#[derive(Clone, Debug, PartialEq)]
pub struct Tracker {
    /// Unique among trackers.
    pub name: String,
    /// What it speaks.
    pub protocol: Protocol,
    /// Where it is listened to: an address of this machine, or a multicast group.
    pub listen: SocketAddr,
    /// The network interface on which a multicast group is joined, by name or by address; groups have one.
    pub interface: Option<String>,
    /// Source addresses that are listened to.
    pub allow: Vec<IpAddr>,
    /// The tracker's id of a body, a number without leading zeros or a name → the body's name.
    pub bodies: BTreeMap<String, String>,
    /// A rotation, a translation and a uniform scale.
    pub world_from_tracker: Matrix4,
    /// `None`: its poses are taken as they are. Else they are predicted to when the light of a frame leaves the projector, and
    /// this is how old they are at least when they are heard, ms, 0 to 150.
    pub predict_lead_ms: Option<f64>,
}

/// One projector.
#[derive(Clone, Debug, PartialEq)]
pub struct Projector {
    /// Unique among projectors.
    pub name: String,
    /// Width and height, each from 1 to 16384.
    pub resolution_px: [u32; 2],
    /// Where its image goes.
    pub output: Output,
    /// From the world to its image.
    pub calibration: Calibration,
}

/// Where an image goes, and when.
#[derive(Clone, Debug, PartialEq)]
pub struct Output {
    /// Where.
    pub kind: OutputKind,
    /// Frames a second, 1 to 1000; `None`: what the screen says, and 60 where none does.
    pub refresh_hz: Option<f64>,
    /// From a frame's completion to its light, ms; 0 to 1000.
    pub latency_ms: f64,
    /// What its pixels are made of.
    pub pixels: Pixels,
    /// For HDR: how bright white is, cd/m²; 1 to 10000.
    pub white_nits: f64,
}

impl Default for Output {
    fn default() -> Self {
        let kind = OutputKind::Headless;
        Self { kind, refresh_hz: None, latency_ms: 0.0, pixels: Pixels::Bits8, white_nits: 203.0 }
    }
}

/// Where an image goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum OutputKind {
    /// Nowhere: it is kept for snapshots.
    Headless,
    /// Into a window of a desktop.
    Window {
        /// An X11 display (`:0`) or a Wayland socket (`wayland-1`); `None`: what the environment names, Wayland first.
        server: Option<String>,
        /// Whether it covers a monitor, and which.
        fullscreen: Fullscreen,
    },
    /// To a display without a desktop.
    Display {
        /// The connector that it is plugged in at, such as `DP-1`.
        connector: Option<String>,
        /// Who it is by its EDID, wherever it is plugged in.
        edid: Option<String>,
    },
    /// To clients of the control socket, in memory that they import.
    Export,
}

/// Whether a window covers a monitor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fullscreen {
    /// It stands where the window manager likes.
    No,
    /// Some monitor.
    Any,
    /// The monitor of this name.
    On(String),
}

/// What an output's pixels are made of; where the screen does not offer it, the next best is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pixels {
    /// Eight bits a channel, sRGB.
    Bits8,
    /// Ten bits a channel, sRGB.
    Bits10,
    /// Ten bits a channel, BT.2020 and the perceptual quantiser.
    Hdr10,
}

/// Bounds on what is taken in, so that memory is bounded whatever a client sends. Our addition to the contract.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Clients of the control socket at a time. Default 16.
    pub max_clients: u32,
    /// Of each client; one that asks more is read more slowly. Default 4000.
    pub max_requests_per_s: u32,
    /// Nodes of the scene, those inside files counted; materials of all nodes likewise. Default 65536.
    pub max_nodes: u32,
    /// Lights that shine, those inside files counted. Default 16; at most 32, so that no walk of rays through many lights
    /// reaches the 65,535 turns after which lavapipe 22.3 ends loops silently.
    pub max_lights: u32,
    /// Triangles of all meshes, each counted once however often it is placed. Default 16 million.
    pub max_triangles: u64,
    /// Texels of all textures. Default 64 Mi.
    pub max_texels: u64,
    /// One file with all that it names, MiB. Default 1024.
    pub max_file_mib: u32,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            max_clients: 16,
            max_requests_per_s: 4000,
            max_nodes: 65_536,
            max_lights: 16,
            max_triangles: 16_000_000,
            max_texels: 1 << 26,
            max_file_mib: 1024,
        }
    }
}
