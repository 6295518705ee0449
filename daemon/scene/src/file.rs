//! Where files may be read from, and reading them within a bound.

use std::io::Read;
use std::path::{Component, Path, PathBuf};
use std::time::SystemTime;

use crate::beneath;
use crate::builtin::SCHEME;
use crate::edit::Fault;

/// Whose word a path is.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Access<'a> {
    /// A client's: only under these folders (canonical paths).
    Roots(&'a [PathBuf]),
    /// The operator's: anywhere; what is relative is tried under the folders, in their order.
    Anywhere(&'a [PathBuf]),
    /// The daemon's own, stored earlier: a client's or the operator's.
    Stored(&'a [PathBuf]),
}

impl Access<'_> {
    /// Whether a canonical path may be read.
    pub(crate) fn allows(&self, canonical: &Path) -> bool {
        self.root_of(canonical).is_some()
    }

    /// The folder beneath which a canonical path may be read; `None` where it may not.
    fn root_of(&self, canonical: &Path) -> Option<&Path> {
        match self {
            Self::Roots(roots) => roots.iter().map(PathBuf::as_path).find(|root| canonical.starts_with(root)),
            Self::Anywhere(_) | Self::Stored(_) => Some(Path::new("/")),
        }
    }

    fn folders(&self) -> &[PathBuf] {
        match self {
            Self::Roots(folders) | Self::Anywhere(folders) | Self::Stored(folders) => folders,
        }
    }
}

/// The canonical path of a URI that is no builtin.
///
/// # Errors
/// `bad-uri` where there is no such file, `outside-asset-roots` where a client may not have it; a client learns nothing
/// of what lies outside.
pub(crate) fn locate(uri: &str, access: Access<'_>) -> Result<PathBuf, Fault> {
    let path = Path::new(uri.strip_prefix("file://").unwrap_or(uri));
    let scheme = uri.split_once(':').map(|(scheme, _)| scheme).filter(|scheme| *scheme != "file");
    if let Some(scheme) = scheme
        && !path.exists()
        && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))
    {
        let hint = format!("a path, or one of the {SCHEME} builtins");
        return Err(Fault::new(
            "bad-uri",
            "uri",
            format!("{uri:?} has the scheme {scheme:?}, which is not read; hint: {hint}"),
        ));
    }
    if uri.is_empty() || uri.contains('\0') {
        return Err(Fault::new(
            "bad-uri",
            "uri",
            "the uri is empty or holds a zero byte; hint: name a .gltf or .glb file",
        ));
    }
    let outside = || {
        let roots: Vec<String> = access.folders().iter().map(|root| root.display().to_string()).collect();
        let hint = match roots.as_slice() {
            [] => "the configuration names no daemon.asset_roots, so clients can have builtins alone".to_owned(),
            _ => format!("put the file under one of {}", roots.join(", ")),
        };
        Fault::new("outside-asset-roots", "uri", format!("{uri:?} is not under an asset root; hint: {hint}"))
    };
    let candidates: Vec<PathBuf> = if path.is_absolute() {
        vec![path.to_owned()]
    } else {
        access.folders().iter().map(|folder| folder.join(path)).collect()
    };

    // Canonical paths have neither `..` nor links, so a prefix of one is a folder that holds it. What cannot be made
    // canonical is judged by its letters, lest a client could ask which files exist.
    let mut denied = candidates.is_empty();
    for candidate in candidates {
        match candidate.canonicalize() {
            Ok(canonical) if access.allows(&canonical) => return Ok(canonical),
            Ok(_) => denied = true,
            Err(_) => denied |= !access.allows(&lexically_normal(&candidate)),
        }
    }
    if denied {
        return Err(outside());
    }
    let folders: Vec<String> = access.folders().iter().map(|folder| folder.display().to_string()).collect();
    let place = if path.is_absolute() || folders.is_empty() {
        String::new()
    } else {
        format!(" under {}", folders.join(" or "))
    };
    Err(Fault::new(
        "bad-uri",
        "uri",
        format!("there is no file {uri:?}{place}; hint: check its spelling and that the daemon may read it"),
    ))
}

fn lexically_normal(path: &Path) -> PathBuf {
    let mut normal = PathBuf::new();
    for component in path.components() {
        match component {
            Component::ParentDir => {
                normal.pop();
            }
            Component::CurDir => {}
            other => normal.push(other),
        }
    }
    normal
}

/// What tells that a file is still the one that was loaded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Stamp {
    modified: Option<SystemTime>,
    bytes: u64,
}

impl Stamp {
    pub(crate) fn of(path: &Path) -> Option<Self> {
        let metadata = path.metadata().ok()?;
        Some(Self { modified: metadata.modified().ok(), bytes: metadata.len() })
    }
}

/// Why a file was not read.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ReadError {
    /// The system's word.
    #[error("cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// Somebody put a link there after the path was judged, or it never was under a root.
    #[error("leads elsewhere by now")]
    Elsewhere,
    /// A folder, a pipe or a device.
    #[error("is not a regular file")]
    NotAFile,
    /// Beyond the limit; nothing was read.
    #[error("is {bytes} bytes, above the limit of {limit}")]
    TooLarge {
        /// As the file system says.
        bytes: u64,
        /// The bound.
        limit: u64,
    },
}

/// Reads a regular file of at most `limit` bytes, by its canonical path.
///
/// The path has been judged, and whoever may write where it leads may have changed that since. So no link is followed on the way
/// from the root, and what is asked about the file is asked about the one that was opened.
///
/// # Errors
/// Before anything is read where its size says that it is larger.
pub(crate) fn read(canonical: &Path, access: Access<'_>, limit: u64) -> Result<Vec<u8>, ReadError> {
    let root = access.root_of(canonical).ok_or(ReadError::Elsewhere)?;
    let below = canonical.strip_prefix(root).map_err(|_| ReadError::Elsewhere)?;
    let file = beneath::open(root, below)?.ok_or(ReadError::Elsewhere)?;
    let metadata = file.metadata()?;
    if !metadata.is_file() {
        return Err(ReadError::NotAFile);
    }
    let too_large = |bytes| ReadError::TooLarge { bytes, limit };
    if metadata.len() > limit {
        return Err(too_large(metadata.len()));
    }
    let mut bytes = Vec::new();
    file.take(limit + 1).read_to_end(&mut bytes)?;
    // A file that grew meanwhile, or one of /proc whose size reads 0.
    if bytes.len() as u64 > limit {
        return Err(too_large(bytes.len() as u64));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::fs::{CWD, FileType, Mode, RenameFlags};
    use std::os::unix::fs::symlink;
    use std::sync::atomic::{AtomicBool, Ordering};

    #[test]
    fn clients_stay_under_their_roots() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().canonicalize().unwrap();
        let root = folder.join("root");
        std::fs::create_dir(&root).unwrap();
        std::fs::write(root.join("in.glb"), b"x").unwrap();
        std::fs::write(folder.join("out.glb"), b"x").unwrap();
        std::os::unix::fs::symlink(folder.join("out.glb"), root.join("link.glb")).unwrap();
        let roots = [root.clone()];
        let client = |uri: &str| locate(uri, Access::Roots(&roots)).map_err(|fault| fault.code);

        assert_eq!(client("in.glb"), Ok(root.join("in.glb")));
        assert_eq!(client(root.join("in.glb").to_str().unwrap()), Ok(root.join("in.glb")));
        assert_eq!(client("./../root/in.glb"), Ok(root.join("in.glb")));
        assert_eq!(client("missing.glb"), Err("bad-uri"));
        assert_eq!(client("http://example.org/a.glb"), Err("bad-uri"));
        assert_eq!(client(""), Err("bad-uri"));
        for outside in ["../out.glb", "link.glb", "../missing.glb", "/etc/passwd", "/etc/missing"] {
            assert_eq!(client(outside), Err("outside-asset-roots"), "{outside}");
        }
        assert_eq!(locate("a.glb", Access::Roots(&[])).unwrap_err().code, "outside-asset-roots");
        assert!(locate("../out.glb", Access::Anywhere(&roots)).is_ok());
    }

    #[test]
    fn only_regular_files_within_the_limit_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().canonicalize().unwrap();
        let path = folder.join("a");
        std::fs::write(&path, b"12345").unwrap();
        let read = |path: &Path, limit| super::read(path, Access::Anywhere(&[]), limit);
        assert_eq!(read(&path, 5).unwrap(), b"12345");
        assert!(matches!(read(&path, 4), Err(ReadError::TooLarge { bytes: 5, limit: 4 })));
        assert!(matches!(read(&folder, 4), Err(ReadError::NotAFile)));
        assert!(matches!(read(Path::new("/dev/zero"), 4), Err(ReadError::NotAFile)));
        assert!(matches!(read(&folder.join("b"), 4), Err(ReadError::Io(_))));
        // A pipe that nobody writes to would hold up whoever opens it to read.
        rustix::fs::mknodat(rustix::fs::CWD, folder.join("pipe"), FileType::Fifo, Mode::RUSR, 0).unwrap();
        assert!(matches!(read(&folder.join("pipe"), 4), Err(ReadError::NotAFile)));
        let _socket = std::os::unix::net::UnixListener::bind(folder.join("socket")).unwrap();
        assert!(read(&folder.join("socket"), 4).is_err());
    }

    #[test]
    fn links_lead_where_they_may_and_are_not_followed_later() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().canonicalize().unwrap();
        let (root, out) = (folder.join("root"), folder.join("out"));
        std::fs::create_dir_all(root.join("deep")).unwrap();
        std::fs::create_dir(&out).unwrap();
        std::fs::write(root.join("deep/a.glb"), b"in").unwrap();
        std::fs::write(out.join("a.glb"), b"out").unwrap();
        symlink("deep/a.glb", root.join("within.glb")).unwrap();
        let roots = [root.clone()];
        let access = Access::Roots(&roots);

        // A link that stays below the root is the file that it leads to.
        let located = locate("within.glb", access).unwrap();
        assert_eq!(
            (located.as_path(), read(&located, access, 9).unwrap()),
            (root.join("deep/a.glb").as_path(), b"in".to_vec())
        );

        // Judged, and then exchanged: first the file, then the folder around it.
        std::fs::rename(root.join("deep/a.glb"), root.join("kept")).unwrap();
        symlink(out.join("a.glb"), root.join("deep/a.glb")).unwrap();
        assert!(matches!(read(&located, access, 9), Err(ReadError::Elsewhere)));
        std::fs::rename(root.join("deep"), root.join("was")).unwrap();
        symlink(&out, root.join("deep")).unwrap();
        assert!(matches!(read(&located, access, 9), Err(ReadError::Elsewhere)));
        assert!(matches!(read(&out.join("a.glb"), access, 9), Err(ReadError::Elsewhere)));
    }

    #[test]
    fn nothing_from_outside_is_read_while_links_come_and_go() {
        const TRIES: usize = 3000;
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().canonicalize().unwrap();
        let (root, out) = (folder.join("root"), folder.join("out"));
        for place in [root.join("deep"), root.join("spare"), out.clone()] {
            std::fs::create_dir_all(&place).unwrap();
            std::fs::write(place.join("a.glb"), if place == out { "out" } else { "in" }).unwrap();
        }
        symlink(&out, root.join("link")).unwrap();
        let (roots, done) = ([root.clone()], AtomicBool::new(false));
        let access = Access::Roots(&roots);
        std::thread::scope(|scope| {
            // The folder is now itself and now a link that leads out.
            scope.spawn(|| {
                while !done.load(Ordering::Relaxed) {
                    let (deep, link) = (root.join("deep"), root.join("link"));
                    rustix::fs::renameat_with(CWD, &deep, CWD, &link, RenameFlags::EXCHANGE).unwrap();
                }
            });
            let (mut inside, mut outside, mut refused) = (0, 0, 0);
            for _ in 0..TRIES {
                match locate("deep/a.glb", access).map(|path| super::read(&path, access, 9)) {
                    Ok(Ok(bytes)) if bytes == b"in" => inside += 1,
                    Ok(Ok(_)) => outside += 1,
                    Ok(Err(_)) | Err(_) => refused += 1,
                }
            }
            // The other one ends whatever has been found.
            done.store(true, Ordering::Relaxed);
            assert_eq!(outside, 0, "a link was followed");
            assert!(inside > 0 && refused > 0, "{inside} read and {refused} refused: nothing was tried");
        });
    }
}
