//! A zip of a calibration: names in whatever case, and what is packed is read up to a bound.

use std::io::{Cursor, Read};

use zip::ZipArchive;

use super::text::malformed;
use super::{FileError, limits};

const FORMAT: &str = "an MPCDI archive";

/// What each entry of a zip's directory starts with.
const ENTRY: &[u8] = b"PK\x01\x02";

/// An archive in memory.
pub(super) struct Archive<'a>(ZipArchive<Cursor<&'a [u8]>>);

impl<'a> Archive<'a> {
    /// Whether a file is a zip.
    pub(super) fn is(bytes: &[u8]) -> bool {
        bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(b"PK\x05\x06")
    }

    /// Opens one.
    pub(super) fn open(bytes: &'a [u8]) -> Result<Self, FileError> {
        // The directory is read as a whole, with some hundred bytes of memory for each entry.
        let entries = bytes.windows(ENTRY.len()).filter(|window| *window == ENTRY).take(limits::MEMBERS + 1).count();
        if entries > limits::MEMBERS {
            return Err(malformed(FORMAT, format!("it has more than {} files", limits::MEMBERS)));
        }
        let archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| malformed(FORMAT, error.to_string()))?;
        Ok(Self(archive))
    }

    /// The first file that has the name, or whose name ends so after a folder's.
    pub(super) fn read(&mut self, name: &str, limit_bytes: u64) -> Result<Vec<u8>, FileError> {
        let wanted = plain(name);
        let names =
            (0..self.0.len()).map(|index| self.0.name_for_index(index).and_then(Result::ok).map(|name| plain(&name)));
        let names: Vec<_> = names.collect();
        let ends_so = |name: &str| name.strip_suffix(&wanted).is_some_and(|folder| folder.ends_with('/'));
        let index = names
            .iter()
            .position(|name| name.as_deref() == Some(&wanted))
            .or_else(|| names.iter().position(|name| name.as_deref().is_some_and(ends_so)));
        let index = index.ok_or_else(|| malformed(FORMAT, format!("there is no {name:?} in it")))?;

        // What its header says of its length is a stranger's word: one byte past the bound tells what is too long.
        let damaged = |error: String| malformed(FORMAT, format!("{name:?} in it: {error}"));
        let member = self.0.by_index(index).map_err(|error| damaged(error.to_string()))?;
        let mut bytes = Vec::new();
        member.take(limit_bytes + 1).read_to_end(&mut bytes).map_err(|error| damaged(error.to_string()))?;
        limits::check(&format!("{name:?} in it"), bytes.len() as u64, limit_bytes)?;
        Ok(bytes)
    }
}

/// A name to compare: as Windows writes it or not, in one case.
fn plain(name: &str) -> String {
    name.replace('\\', "/").trim_start_matches("./").to_ascii_lowercase()
}
