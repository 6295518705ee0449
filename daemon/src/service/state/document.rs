//! A kept text with a head that says what it is, in which version of its form, and whether it is whole.
//!
//! The head is a line of JSON, the body what follows: `{"format":"lantern scene","version":2,"sha256":"…"}`. So the version is known
//! before the body is looked at, however much its form has changed since, and a number that rots on the disk is not shown.

use std::fmt::Write;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// No head is longer.
const HEAD_BYTES: usize = 256;

#[derive(Serialize, Deserialize)]
struct Head {
    format: String,
    version: u32,
    sha256: String,
}

/// What a file that starts with a head holds.
#[derive(Debug, PartialEq, Eq)]
pub struct Document<'a> {
    /// Of the body's form.
    pub version: u32,
    /// Whole, by its checksum.
    pub body: &'a [u8],
}

/// Why a file with a head is none of ours.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum DocumentError {
    /// It does not begin with a head.
    #[error("it does not say what it is")]
    NoHead,
    /// It is of another kind.
    #[error("it is a {0:?}")]
    Foreign(String),
    /// Something of it has changed, or is missing.
    #[error("it is damaged: its checksum does not match")]
    Damaged,
}

/// SHA-256 in hexadecimal digits.
pub fn checksum(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().fold(String::with_capacity(64), |mut hex, byte| {
        // Writing to a String cannot fail.
        let _ = write!(hex, "{byte:02x}");
        hex
    })
}

/// A body with its head.
pub fn seal(format: &str, version: u32, body: &[u8]) -> Vec<u8> {
    let head = serde_json::json!({"format": format, "version": version, "sha256": checksum(body)});
    [head.to_string().as_bytes(), b"\n", body].concat()
}

/// The body of a file of a format, in whatever version.
///
/// # Errors
/// [`DocumentError`].
pub fn open<'a>(format: &str, file: &'a [u8]) -> Result<Document<'a>, DocumentError> {
    let end = file.iter().take(HEAD_BYTES).position(|&byte| byte == b'\n').ok_or(DocumentError::NoHead)?;
    let head: Head = serde_json::from_slice(&file[..end]).map_err(|_| DocumentError::NoHead)?;
    if head.format != format {
        return Err(DocumentError::Foreign(head.format));
    }
    let body = &file[end + 1..];
    if checksum(body) != head.sha256 {
        return Err(DocumentError::Damaged);
    }
    Ok(Document { version: head.version, body })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_sealed_is_opened_whole_or_not_at_all() {
        let sealed = seal("lantern scene", 7, b"{\"a\":1}\n");
        assert_eq!(open("lantern scene", &sealed), Ok(Document { version: 7, body: b"{\"a\":1}\n" }));
        assert_eq!(open("lantern other", &sealed), Err(DocumentError::Foreign("lantern scene".into())));
        for length in 0..sealed.len() {
            assert!(open("lantern scene", &sealed[..length]).is_err(), "{length} bytes of it");
        }
        for at in 0..sealed.len() {
            let mut rotten = sealed.clone();
            rotten[at] ^= 1;
            match open("lantern scene", &rotten) {
                Err(_) => {}
                // Nothing vouches for the version but the body, which a reader of that version will not understand.
                Ok(document) => assert!(document.version != 7 && document.body == b"{\"a\":1}\n", "byte {at}"),
            }
        }
    }
}
