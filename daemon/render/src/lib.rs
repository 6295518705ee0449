//! The passes, their order, and what each change makes stale.
//!
//! What a pixel *hits* depends on the projector, the props and nothing else; what it *shows* depends on the eye. The two are
//! separate passes with buffers between them ([`primary`] and [`light`], then [`secondary`]), so that a moving eye costs the last
//! alone ([`stale`] is the table). [`composite`] turns the result into colour and depth in the projector's own convention,
//! [`raster`] draws what the rasteriser owns against it, [`resolve`] ends with the picture.
//!
//! A pass knows the buffers it reads and writes, not who asked; [`projector`] knows their order, [`renderer`] a device's projectors.

mod arena;
mod block;
mod bound;
mod catalogue;
mod error;
mod export;
mod frame;
pub mod ideal_tiles;
mod jitter;
mod lenses;
mod loads;
pub mod moved;
mod pattern;
mod pipelines;
mod present;
mod readback;
mod record;
mod report;
mod room;
mod scene_buffers;
mod settings;
pub mod shaders;
pub mod stale;
mod store;
mod structures;
mod targets;
pub mod tile_lists;

pub mod blend;
pub mod composite;
pub mod edges;
pub mod light;
pub mod primary;
pub mod projector;
pub mod raster;
pub mod renderer;
pub mod resolve;
pub mod secondary;
pub mod tiles;
pub mod visible;

pub use block::bytes_beyond;
pub use error::RenderError;
pub use export::ExportLayout;
pub use frame::{GpuFrame, GpuSetup, MAX_VIEWERS};
pub use loads::Loads;
pub use pattern::Pattern;
pub use present::Target;
pub use readback::{Layer, LayerImage, Texels};
pub use record::{RayKind, RecordHead, Recorded, RecordedRay};
pub use renderer::{Renderer, UPLOAD_BYTES_A_FRAME};
pub use report::{FrameReport, ProjectorReport, RayCounts, Span};
pub use settings::{ProjectorSpec, RasterOrder, Settings, Walk};
