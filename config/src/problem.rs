//! What is wrong with a configuration.

use std::fmt;

/// One thing that is wrong, where it stands, and what to do about it.
///
/// Shown as `lab.toml:12:5: message; hint: remedy`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, thiserror::Error)]
pub struct Problem {
    /// The file, as the caller named it.
    pub file: String,
    /// From 1; 0 where the file as a whole is meant.
    pub line: usize,
    /// In characters, from 1; 0 where the file as a whole is meant.
    pub column: usize,
    /// What is wrong.
    pub message: String,
    /// What to do.
    pub hint: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.line == 0 {
            write!(f, "{}: {}; hint: {}", self.file, self.message, self.hint)
        } else {
            write!(f, "{}:{}:{}: {}; hint: {}", self.file, self.line, self.column, self.message, self.hint)
        }
    }
}
