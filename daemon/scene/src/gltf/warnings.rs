//! What a file holds and Lantern ignores, said once each.

use std::path::Path;

#[derive(Debug, Default)]
pub(super) struct Warnings {
    said: Vec<String>,
}

impl Warnings {
    pub(super) fn add(&mut self, words: impl Into<String>) {
        let words = words.into();
        if !self.said.contains(&words) {
            self.said.push(words);
        }
    }

    /// Logs them all and hands them over.
    pub(super) fn finish(self, file: &Path) -> Vec<String> {
        for words in &self.said {
            tracing::warn!(file = %file.display(), "{words}");
        }
        self.said
    }
}
