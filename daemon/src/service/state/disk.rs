//! Files that are replaced whole: after `kill -9` or a loss of power there is the old one or the new one, and nothing else.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// What the file system refused.
#[derive(Debug, thiserror::Error)]
#[error("cannot {doing} {path}: {source}\nhint: the state_dir must be the daemon's own, writable, and have room left")]
pub struct DiskError {
    doing: &'static str,
    path: PathBuf,
    source: io::Error,
}

/// Why a file was not taken in.
#[derive(Debug, thiserror::Error)]
pub enum Unread {
    /// There is none of that name.
    #[error("there is none")]
    Missing,
    /// A folder, a pipe or a device, which may have no end.
    #[error("it is no file")]
    NoFile,
    /// Longer than any of its kind.
    #[error("it is longer than {limit_bytes} bytes, which none is")]
    TooLong {
        /// How long it may be.
        limit_bytes: u64,
    },
    /// The file system refused.
    #[error("it cannot be read: {0}")]
    Refused(#[from] io::Error),
}

pub(super) fn failed<'a>(doing: &'static str, path: &'a Path) -> impl FnOnce(io::Error) -> DiskError + 'a {
    move |source| DiskError { doing, path: path.to_owned(), source }
}

/// Makes a folder that is to last, with those above it.
///
/// # Errors
/// [`DiskError`].
pub fn make_folder(folder: &Path) -> Result<(), DiskError> {
    fs::create_dir_all(folder).map_err(failed("create", folder))
}

/// Replaces a file. When it returns, the new one is on the disk.
///
/// # Errors
/// [`DiskError`]; what was there is still there, unless the very last step failed, the sync of the folder: then either may be
/// what is found after a loss of power.
pub fn replace(folder: &Path, name: &str, bytes: &[u8]) -> Result<(), DiskError> {
    let (path, fresh) = (folder.join(name), fresh(folder, name));

    // The new file is whole on the disk before its name replaces the old one's, and the name is on the disk before this returns
    // (rename is atomic; the folder's own sync makes it last).
    let written = File::create(&fresh).map_err(failed("create", &fresh)).and_then(|mut file| {
        file.write_all(bytes).map_err(failed("write", &fresh))?;
        file.sync_all().map_err(failed("sync", &fresh))
    });
    let replaced = written.and_then(|()| fs::rename(&fresh, &path).map_err(failed("rename", &fresh)));
    if replaced.is_err() {
        // On a full disk it would take room away; it may never have been there.
        let _ = fs::remove_file(&fresh);
    }
    replaced?;
    File::open(folder).and_then(|folder| folder.sync_all()).map_err(failed("sync", folder))
}

/// Where the next file of a name is written. One name alone, so that what a killed daemon leaves does not pile up.
fn fresh(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("{name}.new"))
}

/// Removes what a daemon that was killed while it wrote has left of a file's next one.
pub fn tidy(folder: &Path, name: &str) {
    // There is none as a rule; and where it cannot go, the next write says so.
    let _ = fs::remove_file(fresh(folder, name));
}

/// Reads a file up to a bound. Nothing but a file is opened, since a pipe would never answer.
///
/// # Errors
/// [`Unread`].
pub fn read(path: &Path, limit_bytes: u64) -> Result<Vec<u8>, Unread> {
    let found = fs::metadata(path).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound if fs::symlink_metadata(path).is_err() => Unread::Missing,
        _ => Unread::Refused(error),
    })?;
    if !found.is_file() {
        return Err(Unread::NoFile);
    }
    let too_long = Unread::TooLong { limit_bytes };
    if found.len() > limit_bytes {
        return Err(too_long);
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(limit_bytes + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit_bytes { Err(too_long) } else { Ok(bytes) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn a_full_disk_leaves_what_was_there_and_nothing_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        replace(folder.path(), "a", b"old").unwrap();
        symlink("/dev/full", folder.path().join("a.new")).unwrap();
        let error = replace(folder.path(), "a", b"new").unwrap_err().to_string();
        assert!(error.contains("write") && error.contains("No space") && error.contains("hint:"), "{error}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        assert_eq!(read(&folder.path().join("a"), 3).unwrap(), b"old");
        replace(folder.path(), "a", b"new").unwrap();
        assert_eq!(read(&folder.path().join("a"), 3).unwrap(), b"new");
    }

    #[test]
    fn nothing_but_a_file_of_some_length_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("long"), [0; 10]).unwrap();
        symlink("/dev/zero", at("endless")).unwrap();
        symlink("nowhere", at("dangling")).unwrap();
        assert!(matches!(read(&at("none"), 9), Err(Unread::Missing)));
        assert!(matches!(read(&at("long"), 9), Err(Unread::TooLong { limit_bytes: 9 })));
        assert!(matches!(read(&at("endless"), 9), Err(Unread::NoFile)));
        assert!(matches!(read(folder.path(), 9), Err(Unread::NoFile)));
        // Something is there, which must not be taken for nothing.
        assert!(matches!(read(&at("dangling"), 9), Err(Unread::Refused(_))));
        assert_eq!(read(&at("long"), 10).unwrap().len(), 10);
    }
}
