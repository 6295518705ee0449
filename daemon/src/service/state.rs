//! The scene across restarts: what was acknowledged as durable survives `kill -9` and power loss.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use lantern_proto::Edit;
use serde::{Deserialize, Serialize};

/// Version of the file's layout.
const VERSION: u32 = 1;

/// What is kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    version: u32,
    /// Of the configuration's scene when this was written: a state of another scene is not shown.
    pub scene_fingerprint: String,
    /// The revision.
    pub revision: u64,
    /// Edits that rebuild it.
    pub edits: Vec<Edit>,
}

/// Why the state could not be kept or read.
#[derive(Debug, thiserror::Error)]
pub enum StateError {
    /// The file system refused.
    #[error("cannot {doing} {path}: {source}\nhint: the daemon must own its state_dir")]
    Io {
        /// What was being done.
        doing: &'static str,
        /// To what.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// The file is no state of this version.
    #[error(
        "{path} is no state that this version reads: {reason}\nhint: it was set aside, and the configuration's scene is shown"
    )]
    Unreadable {
        /// Which file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
}

/// The folder where the state lives.
#[derive(Clone, Debug)]
pub struct Store {
    folder: PathBuf,
}

fn io_error<'a>(doing: &'static str, path: &'a Path) -> impl FnOnce(io::Error) -> StateError + 'a {
    move |source| StateError::Io { doing, path: path.to_owned(), source }
}

impl Store {
    /// Makes the folder if it is missing.
    ///
    /// # Errors
    /// [`StateError::Io`].
    pub fn open(folder: &Path) -> Result<Self, StateError> {
        fs::create_dir_all(folder).map_err(io_error("create", folder))?;
        Ok(Self { folder: folder.to_owned() })
    }

    fn path(&self) -> PathBuf {
        self.folder.join("scene.json")
    }

    /// Writes a revision. When it returns, the revision is on the disk.
    ///
    /// # Errors
    /// [`StateError::Io`]; what was kept before is still there, unless the very last step failed, the sync of the folder: then either
    /// may be what a restart finds.
    pub fn save(&self, scene_fingerprint: &str, revision: u64, edits: Vec<Edit>) -> Result<(), StateError> {
        let state = State { version: VERSION, scene_fingerprint: scene_fingerprint.to_owned(), revision, edits };
        let (path, new) = (self.path(), self.folder.join("scene.json.new"));
        let text = serde_json::to_vec(&state).map_err(|e| io_error("write", &new)(io::Error::other(e)))?;

        // The new file is whole on the disk before its name replaces the old one's, and the name is on the disk before this
        // returns (rename is atomic; the folder's own sync makes it last).
        let mut file = File::create(&new).map_err(io_error("create", &new))?;
        file.write_all(&text).map_err(io_error("write", &new))?;
        file.sync_all().map_err(io_error("sync", &new))?;
        fs::rename(&new, &path).map_err(io_error("rename", &new))?;
        File::open(&self.folder).and_then(|f| f.sync_all()).map_err(io_error("sync", &self.folder))
    }

    /// Reads what is kept; `None` where nothing is, or where it belongs to another configuration's scene.
    ///
    /// # Errors
    /// [`StateError`]; an unreadable file has been set aside.
    pub fn load(&self, scene_fingerprint: &str) -> Result<Option<State>, StateError> {
        let path = self.path();
        let text = match fs::read(&path) {
            Ok(text) => text,
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(io_error("read", &path)(e)),
        };
        let read = serde_json::from_slice::<State>(&text).map_err(|e| e.to_string());
        let state = read.and_then(|s| {
            if s.version == VERSION {
                Ok(s)
            } else {
                Err(format!("its version is {}, this one writes {VERSION}", s.version))
            }
        });
        match state {
            Ok(state) if state.scene_fingerprint == scene_fingerprint => Ok(Some(state)),
            Ok(_) => {
                self.set_aside()?;
                tracing::warn!(
                    state = %path.display(),
                    "the configuration's [scene] has changed since the state was kept; the state was set aside"
                );
                Ok(None)
            }
            Err(reason) => {
                self.set_aside()?;
                Err(StateError::Unreadable { path, reason })
            }
        }
    }

    /// Moves what is kept out of the way, for a person to look at.
    ///
    /// # Errors
    /// [`StateError::Io`].
    pub fn set_aside(&self) -> Result<(), StateError> {
        let path = self.path();
        fs::rename(&path, self.folder.join("scene.json.aside")).map_err(io_error("set aside", &path))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lantern_proto::Remove;

    fn edits() -> Vec<Edit> {
        vec![Edit::Remove(Remove { node: "car".into() })]
    }

    #[test]
    fn what_was_saved_is_loaded_for_the_same_scene_only() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        assert_eq!(store.load("a").unwrap(), None);
        store.save("a", 7, edits()).unwrap();
        let state = store.load("a").unwrap().unwrap();
        assert_eq!((state.revision, state.edits), (7, edits()));
        assert_eq!(store.load("b").unwrap(), None);
        // Set aside, not lost.
        assert!(folder.path().join("scene.json.aside").exists());
        assert_eq!(store.load("a").unwrap(), None);
    }

    #[test]
    fn a_broken_state_is_set_aside() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        for broken in ["{", "{\"version\": 99, \"scene_fingerprint\": \"a\", \"revision\": 1, \"edits\": []}"] {
            fs::write(folder.path().join("scene.json"), broken).unwrap();
            assert!(matches!(store.load("a"), Err(StateError::Unreadable { .. })), "{broken}");
            assert_eq!(store.load("a").unwrap(), None);
        }
    }
}
