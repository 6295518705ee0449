//! Why a calibration file cannot be used.

use glam::UVec2;

use crate::CalibrationError;

/// What is wrong with a calibration file, or with what the configuration says of it.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// It cannot be opened or read.
    #[error("cannot be read: {source}; hint: name a file that the daemon may read")]
    Unreadable {
        /// Why.
        source: std::io::Error,
    },
    /// It, or a part of it, is longer than anything of its kind.
    #[error(
        "{what} is larger than {} KiB, which nothing of its kind is; hint: name the calibration's own file",
        limit_bytes >> 10
    )]
    TooLarge {
        /// Which part.
        what: String,
        /// How large it may be.
        limit_bytes: u64,
    },
    /// It is not of the format that the configuration says, or is damaged.
    #[error("is not readable as {format}: {message}; hint: {hint}")]
    Malformed {
        /// The format, or the part of it.
        format: &'static str,
        /// What is wrong, and where.
        message: String,
        /// What to do.
        hint: String,
    },
    /// Something is in it that cannot be right.
    #[error("{message}; hint: {hint}")]
    Wrong {
        /// The key of the configuration that has to do with it.
        key: &'static str,
        /// What is wrong.
        message: String,
        /// What to do.
        hint: String,
    },
    /// Neither the file nor the configuration says it.
    #[error("does not say {what}; hint: add {key} = {example} to [projector.calibration]")]
    Unsaid {
        /// What is to be known.
        what: String,
        /// The key that would say it.
        key: &'static str,
        /// How it could.
        example: String,
    },
    /// The file and the configuration say different things.
    #[error("says {file}, and `{key}` says {config}; hint: remove `{key}`, or correct it")]
    Contradicted {
        /// The key.
        key: &'static str,
        /// What the file says.
        file: String,
        /// What the configuration says.
        config: String,
    },
    /// Its image has another shape than the projector's.
    #[error(
        "wrong resolution: it was made for {} × {} pixels, and the projector has {} × {}; hint: set the projector's \
         resolution_px to that of its signal, or have the file made at that resolution",
        file_px.x, file_px.y, projector_px.x, projector_px.y
    )]
    Resolution {
        /// What the file or the configuration says of the file.
        file_px: UVec2,
        /// The projector's.
        projector_px: UVec2,
    },
    /// No projector of that name is in it, or there are several and none is named.
    #[error("{message}; hint: there are {there}", there = names(there))]
    Entry {
        /// What was looked for.
        message: String,
        /// What there is.
        there: Vec<String>,
    },
    /// It makes no calibration.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
}

/// Names in quotes, the first few of them.
fn names(names: &[String]) -> String {
    const SHOWN: usize = 12;
    let shown: Vec<_> = names.iter().take(SHOWN).map(|name| format!("{name:?}")).collect();
    let more = if names.len() > SHOWN { ", …" } else { "" };
    if shown.is_empty() { "none".to_owned() } else { format!("{}{more}", shown.join(", ")) }
}

impl FileError {
    /// The key of `[projector.calibration]` at which it is to be shown.
    pub fn key(&self) -> &'static str {
        match self {
            Self::Wrong { key, .. } | Self::Contradicted { key, .. } => key,
            Self::Entry { .. } => "entry",
            Self::Unreadable { .. }
            | Self::TooLarge { .. }
            | Self::Malformed { .. }
            | Self::Unsaid { .. }
            | Self::Resolution { .. }
            | Self::Calibration(_) => "file",
        }
    }
}
