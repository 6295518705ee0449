//! Where the log goes: to the journal with its fields, where standard error is the journal's; else to standard error as lines.

mod journal;

use std::io::{IsTerminal, stderr};

use tracing_subscriber::EnvFilter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

use journal::Journal;

/// The log, once it has been started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Log {
    /// Entries with fields, for `journalctl`.
    Journal,
    /// Lines.
    StandardError,
}

impl Log {
    /// Starts it for the process, as much of it as `$LANTERN_LOG` says; to be called once.
    pub fn start() -> Self {
        let filter = EnvFilter::try_from_env("LANTERN_LOG").unwrap_or_else(|_| EnvFilter::new("info"));
        if let Some(journal) = Journal::of_standard_error() {
            tracing_subscriber::registry().with(filter).with(journal).init();
            return Self::Journal;
        }
        let colours = stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
        tracing_subscriber::fmt().with_env_filter(filter).with_writer(stderr).with_ansi(colours).init();
        Self::StandardError
    }

    /// Says why a program ends: to people as it is, in the journal as an error.
    pub fn fatal(self, words: &str) {
        match self {
            Self::Journal => tracing::error!("{words}"),
            Self::StandardError => eprintln!("lanternd: {words}"),
        }
    }
}
