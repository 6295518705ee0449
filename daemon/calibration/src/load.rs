//! From a projector of the configuration to its calibration.

use std::ops::Deref;
use std::path::{Path, PathBuf};

use lantern_config::{Calibration as Configured, Matrices, Projector};

use crate::formats::{self, FileError};
use crate::{Calibration, CalibrationError};

/// Why a projector has no calibration.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// Its matrices are none of a projector's.
    #[error(transparent)]
    Matrices(#[from] CalibrationError),
    /// Its file cannot be used.
    #[error("{} {error}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why, as what follows the file's name.
        error: FileError,
    },
}

impl LoadError {
    /// The key of `[projector.calibration]` at which it is to be shown.
    pub fn key(&self) -> &'static str {
        match self {
            Self::Matrices(CalibrationError::NotFinite { matrix, .. } | CalibrationError::Singular { matrix, .. }) => {
                matrix
            }
            Self::Matrices(_) => "",
            Self::File { error, .. } => error.key(),
        }
    }
}

impl Calibration {
    /// From a projector of the configuration: its matrices, or the file that it names.
    ///
    /// # Errors
    /// As [`Calibration::from_matrices`], [`formats::read`] and [`formats::from_bytes`].
    pub fn from_config(projector: &Projector) -> Result<Self, LoadError> {
        Self::from_config_by(projector, |path| formats::read(path).map(Box::new))
    }

    /// The same, where files are read by `read`: as it may be, from what they held when they were last good.
    ///
    /// # Errors
    /// As [`Calibration::from_config`], and what `read` says.
    pub fn from_config_by<B: Deref<Target = Vec<u8>>>(
        projector: &Projector,
        read: impl FnOnce(&Path) -> Result<B, FileError>,
    ) -> Result<Self, LoadError> {
        let resolution_px = projector.resolution_px.into();
        match &projector.calibration {
            Configured::Matrices(Matrices { convention, projection, view, .. }) => {
                Ok(Self::from_matrices(projection, view, (*convention).into(), resolution_px)?)
            }
            Configured::File(file) => read(&file.path)
                .and_then(|bytes| formats::from_bytes(&bytes, file, resolution_px))
                .map_err(|error| LoadError::File { path: file.path.clone(), error }),
        }
    }
}
