//! The last configuration that worked, with the calibration files that it named, by content: what a start shows where the file in use
//! has come to be wrong, or a calibration has gone.
//!
//! `last-good/` below the state's folder holds `configuration.json`, which names the others by their checksums. These are written before it
//! and removed after it, so that it never names one that is not there.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use lantern_calibration::formats::limits::FILE_BYTES;
use serde::{Deserialize, Serialize};

use super::sources::Sources;
use super::state::disk::{self, DiskError, Unread};
use super::state::document::{self, Document, DocumentError};

const FILE: &str = "configuration.json";
const FORMAT: &str = "lantern configuration";
/// Of the form of [`Manifest`]. One of another version is not used, and the next configuration that works takes its place.
const VERSION: u32 = 1;

/// A text of 16 MiB, the longest that is read, with every character escaped.
const MAX_BYTES: u64 = 100 << 20;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    /// The configuration file, absolute.
    path: PathBuf,
    text: String,
    /// The calibration files' checksums, by absolute path.
    files: BTreeMap<PathBuf, String>,
}

/// Why a configuration could not be kept.
#[derive(Debug, thiserror::Error)]
pub enum KeepError {
    /// The file system refused.
    #[error(transparent)]
    Disk(#[from] DiskError),
    /// Its path is no path any more, or no text.
    #[error("the configuration's path cannot be kept: {0}")]
    Path(String),
}

/// Why there is no configuration to go back to.
#[derive(Debug, thiserror::Error)]
pub enum FindError {
    /// Nothing of ours.
    #[error("{path}: {source}", path = path.display())]
    Unread {
        /// What could not be read.
        path: PathBuf,
        /// Why.
        source: Unread,
    },
    /// It is damaged, or something else.
    #[error("{path}: {reason}", path = path.display())]
    Unusable {
        /// What cannot be used.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// Another file's.
    #[error("{path} was kept of the configuration file {of}", path = path.display(), of = of.display())]
    Another {
        /// Where it is.
        path: PathBuf,
        /// Whose it is.
        of: PathBuf,
    },
}

/// The folder where it lives.
#[derive(Debug)]
pub struct LastGood {
    folder: PathBuf,
}

impl LastGood {
    /// Below the folder where the state lives.
    pub fn below(state_dir: &Path) -> Self {
        Self { folder: state_dir.join("last-good") }
    }

    /// Keeps a configuration that works, in place of the one before; writes nothing where it is the same.
    ///
    /// # Errors
    /// [`KeepError`]; then the one before is still there.
    pub fn keep(&self, sources: &Sources) -> Result<(), KeepError> {
        let path = std::path::absolute(sources.path()).map_err(|error| KeepError::Path(error.to_string()))?;
        let named: Vec<_> = sources.files().values().map(|bytes| (document::checksum(bytes), bytes)).collect();
        let files = sources.files().keys().cloned().zip(named.iter().map(|(checksum, _)| checksum.clone())).collect();
        let manifest = serde_json::to_vec(&Manifest { path, text: sources.text().to_owned(), files });
        let manifest = manifest.map_err(|error| KeepError::Path(error.to_string()))?;
        let manifest = document::seal(FORMAT, VERSION, &manifest);

        disk::make_folder(&self.folder)?;
        for (checksum, bytes) in &named {
            let there = fs::metadata(self.folder.join(checksum)).is_ok_and(|file| file.len() == bytes.len() as u64);
            if !there {
                disk::replace(&self.folder, checksum, bytes)?;
            }
        }
        if disk::read(&self.folder.join(FILE), MAX_BYTES).is_ok_and(|before| before == manifest) {
            return Ok(());
        }
        disk::replace(&self.folder, FILE, &manifest)?;
        self.remove_all_but(&named.into_iter().map(|(checksum, _)| checksum).collect::<Vec<_>>());
        Ok(())
    }

    /// Removes what the configuration before has named, and what a daemon that was killed has left.
    fn remove_all_but(&self, checksums: &[String]) {
        let Ok(entries) = fs::read_dir(&self.folder) else { return };
        for entry in entries.flatten() {
            let name = entry.file_name();
            let needed = name == FILE || checksums.iter().any(|checksum| name == checksum.as_str());
            if !needed && let Err(error) = fs::remove_file(entry.path()) {
                tracing::warn!(path = %entry.path().display(), %error, "what an earlier configuration needed cannot be removed");
            }
        }
    }

    /// What was kept of a configuration file; `None` where nothing was.
    ///
    /// # Errors
    /// [`FindError`].
    pub fn find(&self, config: &Path) -> Result<Option<Sources>, FindError> {
        let path = self.folder.join(FILE);
        let file = match disk::read(&path, MAX_BYTES) {
            Err(Unread::Missing) => return Ok(None),
            other => other.map_err(unread(&path))?,
        };
        let manifest = match document::open(FORMAT, &file) {
            Ok(Document { version: VERSION, body }) => serde_json::from_slice(body).map_err(|error| error.to_string()),
            Ok(Document { version, .. }) => Err(format!("its version is {version}, and this release reads {VERSION}")),
            Err(error) => Err(error.to_string()),
        };
        let Manifest { path: of, text, files } = manifest.map_err(unusable(&path))?;
        if !std::path::absolute(config).is_ok_and(|config| config == of) {
            return Err(FindError::Another { path, of });
        }
        let read = |(path, checksum): (PathBuf, String)| Ok((path, Arc::new(self.content(&checksum)?)));
        let files = files.into_iter().map(read).collect::<Result<_, FindError>>()?;
        Ok(Some(Sources::kept(config, text, files)))
    }

    /// The file of a checksum.
    fn content(&self, checksum: &str) -> Result<Vec<u8>, FindError> {
        // The manifest is whole, by its own checksum, and so it has no path in it that leads out of the folder; one that it had would
        // be no file's checksum.
        let path = self.folder.join(checksum);
        let bytes = disk::read(&path, FILE_BYTES).map_err(unread(&path))?;
        if document::checksum(&bytes) != checksum {
            return Err(unusable(&path)(DocumentError::Damaged.to_string()));
        }
        Ok(bytes)
    }
}

fn unread(path: &Path) -> impl FnOnce(Unread) -> FindError {
    let path = path.to_owned();
    |source| FindError::Unread { path, source }
}

fn unusable(path: &Path) -> impl FnOnce(String) -> FindError {
    let path = path.to_owned();
    |reason| FindError::Unusable { path, reason }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sources of a configuration that names calibration files, which are read.
    fn sources(folder: &Path, text: &str, files: &[(&str, &[u8])]) -> Sources {
        let config = folder.join("lantern.toml");
        fs::write(&config, text).unwrap();
        let mut sources = Sources::read(&config).unwrap();
        for (name, bytes) in files {
            fs::write(folder.join(name), bytes).unwrap();
            assert_eq!(sources.calibration(&folder.join(name)).unwrap().as_slice(), *bytes);
        }
        sources
    }

    fn names(folder: &Path) -> usize {
        fs::read_dir(folder.join("state/last-good")).unwrap().count()
    }

    #[test]
    fn what_was_kept_is_found_when_all_of_it_has_gone() {
        let folder = tempfile::tempdir().unwrap();
        let (folder, config) = (folder.path(), folder.path().join("lantern.toml"));
        let last_good = LastGood::below(&folder.join("state"));
        assert!(last_good.find(&config).unwrap().is_none());
        let both = [("left.yml", &b"left"[..]), ("right.yml", b"right")];
        last_good.keep(&sources(folder, "one", &both)).unwrap();
        for name in ["lantern.toml", "left.yml", "right.yml"] {
            fs::remove_file(folder.join(name)).unwrap();
        }
        let mut found = last_good.find(&config).unwrap().unwrap();
        assert_eq!(found.text(), "one");
        assert_eq!(*found.calibration(&folder.join("right.yml")).unwrap(), b"right".to_vec());
        assert!(found.calibration(&folder.join("other.yml")).is_err());

        // The next takes its place, and what it does not need goes; the same again writes nothing.
        last_good.keep(&sources(folder, "two", &[("left.yml", b"left")])).unwrap();
        assert_eq!(names(folder), 2);
        let written = |name: &str| fs::metadata(folder.join("state/last-good").join(name)).unwrap().modified().unwrap();
        let before = written(FILE);
        last_good.keep(&sources(folder, "two", &[("left.yml", b"left")])).unwrap();
        assert_eq!(written(FILE), before);
        assert_eq!(last_good.find(&config).unwrap().unwrap().text(), "two");
        let another = last_good.find(&folder.join("other.toml")).unwrap_err();
        assert!(matches!(another, FindError::Another { .. }), "{another}");
    }

    #[test]
    fn nothing_damaged_is_used() {
        let folder = tempfile::tempdir().unwrap();
        let (folder, config) = (folder.path(), folder.path().join("lantern.toml"));
        let last_good = LastGood::below(&folder.join("state"));
        for damage in [FILE, &document::checksum(b"left")] {
            let good = sources(folder, "one", &[("left.yml", b"left")]);
            last_good.keep(&good).unwrap();
            let path = folder.join("state/last-good").join(damage);
            let mut bytes = fs::read(&path).unwrap();
            *bytes.last_mut().unwrap() ^= 1;
            fs::write(&path, bytes).unwrap();
            assert!(matches!(last_good.find(&config).unwrap_err(), FindError::Unusable { .. }), "{damage}");
            fs::remove_file(&path).unwrap();
            // What is missing is written again.
            last_good.keep(&good).unwrap();
            assert!(last_good.find(&config).unwrap().is_some(), "{damage}");
        }
    }
}
