//! From bytes to text, and from text to numbers.

use super::{FileError, limits};

/// The text of a file, without a byte order mark.
pub(super) fn text<'a>(bytes: &'a [u8], format: &'static str) -> Result<&'a str, FileError> {
    limits::check("its text", bytes.len() as u64, limits::TEXT_BYTES)?;
    let text = std::str::from_utf8(bytes).map_err(|error| FileError::Malformed {
        format,
        message: error.to_string(),
        hint: "save it as UTF-8, or set `format` to what the file is".to_owned(),
    })?;
    Ok(text.strip_prefix('\u{feff}').unwrap_or(text))
}

/// A finite number.
pub(super) fn number(text: &str, format: &'static str, what: &str) -> Result<f64, FileError> {
    let number = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| {
        let shown: String = text.trim().chars().take(40).collect();
        malformed(format, format!("{what} is {shown:?}, which is no finite number"))
    })
}

/// A file that is damaged, or something else than the configuration says.
pub(super) fn malformed(format: &'static str, message: String) -> FileError {
    FileError::Malformed {
        format,
        message,
        hint: "set `format` to what the file is, or write the file anew".to_owned(),
    }
}
