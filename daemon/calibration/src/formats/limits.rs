//! How much of a file is taken in.

use super::FileError;

/// Any file, an archive with its maps included. A map of 4096 × 2160 pixels of three floats is 101 MiB.
pub const FILE_BYTES: u64 = 256 << 20;

/// A text: XML, YAML or JSON, packed or not. An ensemble of a dozen projectors and cameras is 200 KiB.
pub const TEXT_BYTES: u64 = 8 << 20;

/// Elements of an XML or a YAML tree.
pub const NODES: u32 = 1 << 18;

/// How deep a tree may be.
pub const DEPTH: usize = 64;

/// Files in an archive.
pub const MEMBERS: usize = 4096;

/// Pixels of a map: 4096 × 4096.
pub const MAP_PX: u64 = 1 << 24;

/// Refuses what is too long.
pub(super) fn check(what: &str, bytes: u64, limit_bytes: u64) -> Result<(), FileError> {
    if bytes > limit_bytes {
        return Err(FileError::TooLarge { what: what.to_owned(), limit_bytes });
    }
    Ok(())
}
