//! The bytes behind the URIs of a document: relative files, data URIs, and the GLB's own chunk.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use gltf::json::Root;

use super::error::{Located, Problem, here};
use crate::file::{self, Access};
use crate::limits::Limits;

/// Reads what a document names, within one bound for all of it.
pub(super) struct Sources<'a> {
    folder: PathBuf,
    access: Access<'a>,
    /// Bytes that may still be read.
    left: u64,
    limit: u64,
}

impl<'a> Sources<'a> {
    /// `used` bytes were the document's own.
    pub(super) fn new(path: &Path, access: Access<'a>, limits: &Limits, used: u64) -> Self {
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        Self { folder, access, left: limits.max_file_bytes.saturating_sub(used), limit: limits.max_file_bytes }
    }

    /// The bytes of a URI.
    pub(super) fn read(&mut self, uri: &str, object: &str) -> Result<Vec<u8>, Located> {
        let refused = |cause: &str| {
            let shown: String = uri.chars().take(60).collect();
            here(object, Problem::Uri { uri: shown, cause: cause.into() })
        };
        if let Some(data) = uri.strip_prefix("data:") {
            let (_, encoded) = data.split_once(";base64,").ok_or_else(|| refused("is a data uri without base64"))?;
            self.spend(encoded.len() as u64 / 4 * 3, object)?;
            return STANDARD.decode(encoded).map_err(|error| refused(&format!("is not base64: {error}")));
        }
        let relative = percent_decoded(uri).ok_or_else(|| refused("is not UTF-8 behind its percent signs"))?;
        if uri.is_empty() || uri.contains("://") || Path::new(&relative).is_absolute() || relative.contains('\0') {
            return Err(refused("is no relative path"));
        }
        let path = self.folder.join(&relative);
        let canonical = path.canonicalize();
        let Ok(canonical) = canonical else {
            return Err(refused(&format!("is not at {}", path.display())));
        };
        if !self.access.allows(&canonical) {
            return Err(here(object, Problem::Outside(relative)));
        }
        let bytes =
            file::read(&canonical, self.access, self.left).map_err(|error| here(object, Problem::Read(error)))?;
        self.spend(bytes.len() as u64, object)?;
        Ok(bytes)
    }

    fn spend(&mut self, bytes: u64, object: &str) -> Result<(), Located> {
        let limit = self.limit;
        let count = limit - self.left + bytes;
        self.left = self.left.checked_sub(bytes).ok_or_else(|| {
            let (what, key) = ("bytes with all that the file names", "limits.max_file_mib");
            here(object, Problem::TooMany { what, count, limit, key })
        })?;
        Ok(())
    }

    /// The bytes of every buffer, each exactly as long as declared.
    pub(super) fn buffers<'b>(&mut self, root: &Root, bin: Option<&'b [u8]>) -> Result<Vec<Cow<'b, [u8]>>, Located> {
        let mut buffers = Vec::with_capacity(root.buffers.len().min(1024));
        for (index, buffer) in root.buffers.iter().enumerate() {
            let object = format!("buffer {index}");
            let mut data = match (&buffer.uri, bin) {
                (Some(uri), _) => Cow::Owned(self.read(uri, &object)?),
                (None, Some(bin)) if index == 0 => Cow::Borrowed(bin),
                _ => {
                    let cause = "has no uri, and the file has no binary chunk for it";
                    return Err(here(object, Problem::Container(cause.into())));
                }
            };
            let (needed, available) = (buffer.byte_length.0, data.len() as u64);
            if needed > available {
                return Err(here(object, Problem::Truncated { of: "its data".into(), needed, available }));
            }
            match &mut data {
                Cow::Borrowed(bytes) => *bytes = &bytes[..needed as usize],
                Cow::Owned(bytes) => bytes.truncate(needed as usize),
            }
            buffers.push(data);
        }
        Ok(buffers)
    }
}

/// RFC 3986, section 2.1; a percent sign without two digits stays as it is.
fn percent_decoded(uri: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&first, tail)) = rest.split_first() {
        let digits = tail.get(..2).and_then(|digits| std::str::from_utf8(digits).ok());
        let escaped =
            digits.filter(|d| d.bytes().all(|b| b.is_ascii_hexdigit())).and_then(|d| u8::from_str_radix(d, 16).ok());
        match (first, escaped) {
            (b'%', Some(byte)) => {
                bytes.push(byte);
                rest = &tail[2..];
            }
            _ => {
                bytes.push(first);
                rest = tail;
            }
        }
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percent_signs_are_decoded() {
        assert_eq!(percent_decoded("a%20b%C3%A9.bin").as_deref(), Some("a bé.bin"));
        assert_eq!(percent_decoded("100%.bin%2").as_deref(), Some("100%.bin%2"));
        assert_eq!(percent_decoded("%ff"), None);
    }
}
