//! The socket file: made whole, owned by one daemon at a time, gone when that one goes.

use rustix::fs::{FlockOperation, flock};
use std::fs::{DirBuilder, File, OpenOptions, Permissions};
use std::io;
use std::os::unix::fs::{DirBuilderExt, FileTypeExt, MetadataExt, OpenOptionsExt, PermissionsExt, chown};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

/// Owner and group may talk to the daemon, others may not.
const SOCKET_MODE: u32 = 0o660;

/// The socket is made under this suffix and then given its name, so that nobody meets it with other rights.
const NEW_SUFFIX: &str = ".new";

/// The longest path that a Unix socket can have on Linux (`sun_path`, its final NUL left off).
const MAX_PATH_BYTES: usize = 107 - NEW_SUFFIX.len();

/// A socket that cannot be listened at.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// Another daemon is there.
    #[error("another lanternd listens at {}; hint: stop it, or give this one its own --socket", path.display())]
    Taken {
        /// The socket.
        path: PathBuf,
    },
    /// Something else is there.
    #[error("{} is there and is no socket; hint: name another --socket, or move that file away", path.display())]
    NoSocket {
        /// The file.
        path: PathBuf,
    },
    /// More than the system can bind.
    #[error("the socket path {} has {} bytes; hint: take one of {MAX_PATH_BYTES} at most", path.display(), path.as_os_str().len())]
    TooLong {
        /// The path.
        path: PathBuf,
    },
    /// The system refused.
    #[error("cannot {operation} {}: {source}; hint: name another --socket, or see who may write there", path.display())]
    System {
        /// What was done.
        operation: &'static str,
        /// To what.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// A socket that clients can connect to, and that nobody answers at yet.
///
/// Bound before the slow parts of a start, so that a second daemon is told at once. The file goes when this is dropped.
#[derive(Debug)]
pub struct Listener {
    socket: UnixListener,
    path: PathBuf,
    /// What goes with it; nothing of a socket that was handed over, which is systemd's to remove.
    own: Option<Own>,
}

/// A socket file of our own making.
#[derive(Debug)]
struct Own {
    /// The file's number, to know it from one that took its place.
    inode: u64,
    /// Locked as long as it is open. The file stays: to remove it would let two daemons hold two locks of one name.
    _lock: File,
}

impl Listener {
    /// Makes the socket file, mode 0660, and its folder where there is none. A file that a dead daemon left is replaced. It is
    /// given to a group, where one is named and the daemon may.
    ///
    /// # Errors
    /// [`ControlError`]: another daemon is there, something that is no socket is, or the system refuses.
    pub fn bind(path: &Path, gid: Option<u32>) -> Result<Self, ControlError> {
        let system = |operation, path: &Path| {
            let path = path.to_owned();
            move |source: io::Error| ControlError::System { operation, path, source }
        };
        if path.as_os_str().len() > MAX_PATH_BYTES {
            return Err(ControlError::TooLong { path: path.to_owned() });
        }
        if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            let made = DirBuilder::new().recursive(true).mode(0o755).create(folder);
            made.map_err(system("make the folder", folder))?;
        }

        // The lock decides between two daemons that start at the same moment.
        let lock_path = with_suffix(path, ".lock");
        let lock = OpenOptions::new().create(true).truncate(false).write(true).mode(0o600).open(&lock_path);
        let lock = lock.map_err(system("open the lock", &lock_path))?;
        flock(&lock, FlockOperation::NonBlockingLockExclusive).map_err(|error| match error {
            rustix::io::Errno::WOULDBLOCK => ControlError::Taken { path: path.to_owned() },
            error => ControlError::System { operation: "lock", path: lock_path.clone(), source: error.into() },
        })?;

        // Whoever holds no lock may listen all the same, such as a daemon whose lock file was removed: ask.
        if let Ok(metadata) = std::fs::symlink_metadata(path) {
            if !metadata.file_type().is_socket() {
                return Err(ControlError::NoSocket { path: path.to_owned() });
            }
            if UnixStream::connect(path).is_ok() {
                return Err(ControlError::Taken { path: path.to_owned() });
            }
            tracing::info!(socket = %path.display(), "replacing a socket file that nobody listens at");
        }

        let new_path = with_suffix(path, NEW_SUFFIX);
        match std::fs::remove_file(&new_path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                return Err(system("remove", &new_path)(error));
            }
            _ => {}
        }
        let socket = UnixListener::bind(&new_path).map_err(system("bind", &new_path))?;
        if let Err(error) = gid.map_or(Ok(()), |gid| chown(&new_path, None, Some(gid))) {
            let hint =
                "whoever is of daemon.group alone cannot connect; be of that group, or let systemd make the socket";
            tracing::warn!(socket = %path.display(), gid, %error, "the socket cannot be given to its group: {hint}");
        }
        std::fs::set_permissions(&new_path, Permissions::from_mode(SOCKET_MODE))
            .map_err(system("set the rights of", &new_path))?;
        let inode = std::fs::symlink_metadata(&new_path).map_err(system("look at", &new_path))?.ino();
        std::fs::rename(&new_path, path).map_err(system("rename the socket to", path))?;
        socket.set_nonblocking(true).map_err(system("set up", path))?;
        Ok(Self { socket, path: path.to_owned(), own: Some(Own { inode, _lock: lock }) })
    }

    /// Takes a socket that another has made and listens at, with whatever rights that one gave it.
    ///
    /// # Errors
    /// [`ControlError::System`] where the system says nothing of it.
    pub fn handed_over(socket: UnixListener) -> Result<Self, ControlError> {
        let address = socket.local_addr().and_then(|address| {
            socket.set_nonblocking(true)?;
            Ok(address)
        });
        let system =
            |source| ControlError::System { operation: "set up", path: "the socket of systemd".into(), source };
        let path = address.map_err(system)?.as_pathname().unwrap_or(Path::new("(without a name)")).to_owned();
        Ok(Self { socket, path, own: None })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The socket once more, for the runtime that serves it.
    pub(super) fn try_clone(&self) -> io::Result<UnixListener> {
        self.socket.try_clone()
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        let Some(own) = &self.own else { return };
        let is_ours = std::fs::symlink_metadata(&self.path).is_ok_and(|metadata| metadata.ino() == own.inode);
        if is_ours && let Err(error) = std::fs::remove_file(&self.path) {
            tracing::warn!(socket = %self.path.display(), %error, "cannot remove the socket file");
        }
    }
}

fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}
