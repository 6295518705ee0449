//! What can be wrong with a glTF file.

use std::path::{Path, PathBuf};

use crate::file::ReadError;

/// Something of a file cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {object}: {problem}; hint: {}", file.display(), problem.hint())]
pub(crate) struct GltfError {
    /// The file that was asked for.
    pub(crate) file: PathBuf,
    /// What in it: "accessor 3", "mesh 2 primitive 0".
    pub(crate) object: String,
    /// The cause.
    #[source]
    pub(crate) problem: Problem,
}

/// The cause.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Problem {
    /// The file, or one that it names, cannot be had.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// A name in the file leads out of the asset roots.
    #[error("names {0:?}, which is not under an asset root")]
    Outside(String),
    /// A name in the file that is no relative path and no data URI.
    #[error("names {uri:?}, which {cause}")]
    Uri {
        /// Shortened where it is long.
        uri: String,
        /// Why it leads nowhere.
        cause: String,
    },
    /// Neither GLB nor JSON, or a GLB whose chunks do not add up.
    #[error("{0}")]
    Container(String),
    /// JSON that is broken, or is not a glTF's.
    #[error("its JSON cannot be read: {0}")]
    Json(serde_json::Error),
    /// What `extensionsRequired` asks for.
    #[error("requires the extension {0}, which Lantern does not read")]
    Extension(String),
    /// A number that names nothing.
    #[error("refers to {what} {index}, of which there are {count}")]
    Index {
        /// The kind of thing.
        what: &'static str,
        /// The number.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// Fewer bytes than were declared.
    #[error("needs {needed} bytes of {of}, which has {available}")]
    Truncated {
        /// What the bytes are of.
        of: String,
        /// At least.
        needed: u64,
        /// At most.
        available: u64,
    },
    /// Offsets and counts whose sum no machine can hold.
    #[error("declares offsets and counts that overflow")]
    Overflow,
    /// Beyond a limit.
    #[error("{what}: {count}, above the limit of {limit} ({key})")]
    TooMany {
        /// The kind of thing.
        what: &'static str,
        /// How many.
        count: u64,
        /// The bound.
        limit: u64,
        /// Where the bound comes from.
        key: &'static str,
    },
    /// NaN or infinity, or so large that nothing can be computed with it.
    #[error("{what} {index} is {value:?}, which is not finite or beyond 1e9")]
    NotFinite {
        /// The kind of thing.
        what: &'static str,
        /// Which one.
        index: usize,
        /// What stands there.
        value: Vec<f32>,
    },
    /// A triangle's corner that is no vertex.
    #[error("index {index} is {vertex}, of {count} vertices")]
    Vertex {
        /// Which one.
        index: usize,
        /// What stands there.
        vertex: u32,
        /// How many there are.
        count: usize,
    },
    /// A node that is its own ancestor, or has two parents.
    #[error("is reached twice, so the nodes are not a tree")]
    NotATree,
    /// An image that cannot be decoded.
    #[error("cannot be decoded: {0}")]
    Image(image::ImageError),
    /// Any other value that glTF does not allow.
    #[error("{0}")]
    Value(String),
}

impl Problem {
    /// What to do about it.
    pub(crate) fn hint(&self) -> &'static str {
        match self {
            Self::Read(ReadError::TooLarge { .. }) | Self::TooMany { .. } => {
                "simplify the model, or raise the limit in the configuration's [limits]"
            }
            Self::Read(_) => "check that the file lies there and that the daemon may read it",
            Self::Outside(_) => "keep a model's buffers and textures beside it, or export it as one .glb",
            Self::Uri { .. } => "use a path relative to the file or a base64 data: uri, or export it as one .glb",
            Self::Container(_) | Self::Json(_) | Self::Truncated { .. } => {
                "the file is damaged or was not copied whole; fetch or export it again"
            }
            Self::Extension(_) => "export it without this extension (uncompressed meshes, PNG or JPEG textures)",
            Self::Image(_) => "textures are PNG or JPEG; open it in an image viewer, or export it again",
            Self::Index { .. }
            | Self::Overflow
            | Self::NotFinite { .. }
            | Self::Vertex { .. }
            | Self::NotATree
            | Self::Value(_) => "the glTF validator of Khronos shows all that is wrong with a file; export it again",
        }
    }
}

impl GltfError {
    /// The code of the edit that asked for the file.
    pub(crate) fn code(&self) -> &'static str {
        match &self.problem {
            Problem::Read(ReadError::TooLarge { .. }) | Problem::TooMany { .. } => "too-large",
            Problem::Read(_) if self.object == "file" => "bad-uri",
            Problem::Outside(_) => "outside-asset-roots",
            _ => "bad-gltf",
        }
    }
}

/// A problem with its object, before the file's name is added.
#[derive(Debug)]
pub(super) struct Located {
    object: String,
    problem: Problem,
}

impl Located {
    pub(super) fn in_file(self, file: &Path) -> GltfError {
        GltfError { file: file.to_owned(), object: self.object, problem: self.problem }
    }
}

/// A problem of an object.
pub(super) fn here(object: impl Into<String>, problem: Problem) -> Located {
    Located { object: object.into(), problem }
}

/// A value that glTF does not allow.
pub(super) fn bad(object: impl Into<String>, cause: impl Into<String>) -> Located {
    here(object, Problem::Value(cause.into()))
}

/// The thing that a number names.
pub(super) fn item<'a, T>(list: &'a [T], what: &'static str, index: usize, object: &str) -> Result<&'a T, Located> {
    list.get(index).ok_or_else(|| here(object, Problem::Index { what, index, count: list.len() }))
}
