//! The configuration's types, its commented default and its errors.
//!
//! [`Config::load`] reads a file and gives either a configuration in which every name resolves and every number is in
//! its range, or all that is wrong with it: each [`Problem`] says where, why and what to do. Nothing is opened but that
//! one file; whether the files that it names can be read is for those who read them to say.
//!
//! The format is the contract's ("Config"), and two additions: `[[scene.material]]` and `[[scene.light]]` take the
//! fields of the edits of the same name, and `[limits]` bounds what is taken in (see [`Limits`]).

mod calibration;
mod load;
mod places;
mod problem;
mod protocol;
mod read;
mod reader;
mod scene;
mod types;

pub use calibration::{Calibration, CalibrationFile, Convention, Format, Matrices, Matrix4, Order, Unit};
pub use load::{folder_of, read_text, state_dir_of};
pub use places::Places;
pub use problem::Problem;
pub use protocol::{Axes, Dtrack, Natnet, NatnetVersion, Opentrack, Osc, OscArgument, OscPattern, Protocol};
pub use scene::{Environment, LightKind, Role, Scene, SceneLight, SceneMaterial, SceneNode};
pub use types::{
    Body, Config, Daemon, Device, Drives, Fullscreen, Limits, Metrics, Output, OutputKind, Pixels, Projector,
    RasterOrder, RayTracing, Render, Tracker,
};

/// The demo's configuration, commented; also the place to start a configuration of one's own from.
pub const DEMO_TOML: &str = include_str!("../demo.toml");
