//! Calibration files of other programs: one file a format, behind one interface.
//!
//! Each format is read into a `posed::Posed`: a camera as OpenCV has it, in the file's own world and unit. From there on
//! they are alike: `Posed::calibration` applies what the configuration says of units, frames and depth. What a
//! file does not say, and the configuration neither, is an error that names the key; nothing is guessed.
//!
//! Files are strangers. Each is read up to a bound, and what is asked for while it is parsed is bounded by its length,
//! but for what is packed in an archive, which has bounds of its own ([`limits`]).

mod archive;
mod context;
mod error;
mod json;
pub mod limits;
mod mpcdi;
mod mpcdi_maps;
mod opencv;
pub(crate) mod pfm;
mod posed;
mod roomalive;
mod splash;
mod storage;
mod storage_xml;
mod storage_yaml;
mod text;
mod xml;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use glam::UVec2;
use lantern_config::{CalibrationFile, Format};

pub(crate) use context::have_same_shape;
pub use error::FileError;

use crate::Calibration;
use context::Context;

/// What stands in a calibration file, of whatever format.
///
/// # Errors
/// One that cannot be read.
pub fn read(path: &Path) -> Result<Vec<u8>, FileError> {
    let unreadable = |source| FileError::Unreadable { source };
    // One byte more than there may be tells a file that is too long, whatever its folder says of its length: a pipe has none.
    let opened = File::open(path).map_err(unreadable)?;
    let mut bytes = Vec::new();
    opened.take(limits::FILE_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    Ok(bytes)
}

/// Reads a projector's calibration from what stands in its file; `resolution_px` is the projector's.
///
/// # Errors
/// What is wrong with the file, or what neither it nor the configuration says.
pub fn from_bytes(bytes: &[u8], file: &CalibrationFile, resolution_px: UVec2) -> Result<Calibration, FileError> {
    limits::check("the file", bytes.len() as u64, limits::FILE_BYTES)?;
    let context = Context { file, resolution_px };
    let posed = match file.format {
        Format::OpenCv => opencv::read(bytes, &context)?,
        Format::Mpcdi => mpcdi::read(bytes, &context)?,
        Format::RoomAlive => roomalive::read(bytes, &context)?,
        Format::Splash => splash::read(bytes, &context)?,
    };
    posed.calibration(&context)
}
