//! Progress where one waits: a bar on a terminal, a line a step elsewhere. On standard error, since it is no result.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressStyle};

/// A known number of steps.
pub(super) struct Progress {
    /// `None` where nobody watches.
    bar: Option<ProgressBar>,
}

impl Progress {
    pub(super) fn new(steps: u64) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| ProgressBar::new(steps));
        // A template that cannot be read leaves the plain bar.
        if let (Some(bar), Ok(style)) = (&bar, ProgressStyle::with_template("{bar:30} {pos:>3}/{len} {msg}")) {
            bar.set_style(style);
        }
        Self { bar }
    }

    /// The next step begins.
    pub(super) fn step(&self, what: &str) {
        match &self.bar {
            Some(bar) => {
                bar.set_message(what.to_owned());
                bar.inc(1);
            }
            None => eprintln!("{what}"),
        }
    }

    /// Nothing is waited for any more; what was shown goes.
    pub(super) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
