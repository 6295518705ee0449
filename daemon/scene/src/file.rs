//! Where files may be read from, and reading them within a bound.

use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};
use std::time::SystemTime;

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
        match self {
            Self::Roots(roots) => roots.iter().any(|root| canonical.starts_with(root)),
            Self::Anywhere(_) | Self::Stored(_) => true,
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

/// Reads a regular file of at most `limit` bytes.
///
/// # Errors
/// Before anything is read where its size says that it is larger.
pub(crate) fn read(path: &Path, limit: u64) -> Result<Vec<u8>, ReadError> {
    // Opening a pipe would wait for a writer, so what it is comes first.
    let metadata = path.metadata()?;
    if !metadata.is_file() {
        return Err(ReadError::NotAFile);
    }
    let too_large = |bytes| ReadError::TooLarge { bytes, limit };
    if metadata.len() > limit {
        return Err(too_large(metadata.len()));
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(limit + 1).read_to_end(&mut bytes)?;
    // A file that grew meanwhile, or one of /proc whose size reads 0.
    if bytes.len() as u64 > limit {
        return Err(too_large(bytes.len() as u64));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let path = folder.path().join("a");
        std::fs::write(&path, b"12345").unwrap();
        assert_eq!(read(&path, 5).unwrap(), b"12345");
        assert!(matches!(read(&path, 4), Err(ReadError::TooLarge { bytes: 5, limit: 4 })));
        assert!(matches!(read(folder.path(), 4), Err(ReadError::NotAFile)));
        assert!(matches!(read(Path::new("/dev/zero"), 4), Err(ReadError::NotAFile)));
        assert!(matches!(read(&folder.path().join("b"), 4), Err(ReadError::Io(_))));
    }
}
