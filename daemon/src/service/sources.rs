//! What a configuration is read from: its own text, and the calibration files that it names.
//!
//! Each file is read once, so that what is used is also what can be kept for a start at which it has gone
//! ([`last_good`](super::last_good)).

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use lantern_calibration::formats::{self, FileError};
use lantern_config::{Config, Problem};

/// A configuration's text and calibration files, by content.
#[derive(Debug)]
pub struct Sources {
    path: PathBuf,
    text: String,
    /// By absolute path, so that a start from another folder finds them.
    files: BTreeMap<PathBuf, Arc<Vec<u8>>>,
    /// Nothing is read any more but what is there.
    kept: bool,
}

impl Sources {
    /// Reads a configuration's text; its files are read as they are asked for.
    ///
    /// # Errors
    /// Why it cannot be read, as one problem.
    pub fn read(path: &Path) -> Result<Self, Vec<Problem>> {
        let text = lantern_config::read_text(path)?;
        Ok(Self { path: path.to_owned(), text, files: BTreeMap::new(), kept: false })
    }

    /// What an earlier run has read. `path` is what the configuration's relative paths start from the folder of.
    pub fn kept(path: &Path, text: String, files: BTreeMap<PathBuf, Arc<Vec<u8>>>) -> Self {
        Self { path: path.to_owned(), text, files, kept: true }
    }

    /// The configuration file, as the caller named it.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What stands in it.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The calibration files that were read, by absolute path.
    pub fn files(&self) -> &BTreeMap<PathBuf, Arc<Vec<u8>>> {
        &self.files
    }

    /// What problems call the configuration.
    pub fn name(&self) -> String {
        format!("{}{}", self.path.display(), if self.kept { " as it last worked" } else { "" })
    }

    /// The configuration.
    ///
    /// # Errors
    /// All that is wrong with it.
    pub fn config(&self) -> Result<Config, Vec<Problem>> {
        Config::parse(&self.text, &self.name(), lantern_config::folder_of(&self.path))
    }

    /// What stands in a calibration file; a second projector of the same file gets the same.
    ///
    /// # Errors
    /// One that cannot be read, or was not kept.
    pub fn calibration(&mut self, path: &Path) -> Result<Arc<Vec<u8>>, FileError> {
        let absolute = std::path::absolute(path).map_err(|source| FileError::Unreadable { source })?;
        if let Some(bytes) = self.files.get(&absolute) {
            return Ok(bytes.clone());
        }
        if self.kept {
            return Err(FileError::Unreadable { source: io::ErrorKind::NotFound.into() });
        }
        let bytes = Arc::new(formats::read(path)?);
        self.files.insert(absolute, bytes.clone());
        Ok(bytes)
    }
}
