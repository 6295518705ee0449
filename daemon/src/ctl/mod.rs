//! `lanternctl`: one command, one request, one answer; it knows the socket protocol and nothing of what is behind it.
//!
//! - `args`: what can be asked, and the help that teaches it;
//! - `client`: the socket's other end;
//! - `command`: from arguments to requests, and from answers to text;
//! - `watch`: the status live, and events;
//! - `csv`: frames as lines of a file;
//! - `table`: `status` for people.

mod args;
mod client;
mod command;
mod csv;
mod table;
mod watch;

use clap::{CommandFactory, Parser};
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::io::Write;
use std::process::ExitCode;

/// What it takes, for whoever writes pages of it.
pub fn command() -> clap::Command {
    args::Arguments::command()
}

/// Parses the command line, does what it says, and tells by the exit code how it went: 0 done, 1 the daemon refused,
/// 2 bad usage, 3 no daemon there. Messages go to standard error.
pub fn main() -> ExitCode {
    let arguments = args::Arguments::parse_from(std::env::args_os().map(args::without_exponent));
    match command::run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        // Whoever reads our output has seen enough, as `head` does.
        Err(Failure::Output(error)) if error.kind() == std::io::ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("lanternctl: {failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}

/// Why nothing, or not everything, was done.
#[derive(Debug, thiserror::Error)]
enum Failure {
    /// The daemon's own words.
    #[error("{}: {}{}", .0.code, .0.message, .0.at.as_ref().map(|at| format!(" (at {at})")).unwrap_or_default())]
    Refused(lantern_proto::ErrorBody),
    /// What was asked cannot be asked.
    #[error("{0}")]
    Usage(String),
    /// Nobody is there.
    #[error("no lanternd at {}: {source}; hint: start one with `lanternd run -c FILE`, or name its --socket", path.display())]
    NoDaemon {
        /// Where it was looked for.
        path: std::path::PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Somebody was there, and is not any more, or is somebody else.
    #[error("lost lanternd: {0}; hint: see its log")]
    Lost(String),
    /// Standard output.
    #[error("cannot write: {0}")]
    Output(#[from] std::io::Error),
}

/// An answer's value.
fn read<T: DeserializeOwned>(answer: Value) -> Result<T, Failure> {
    serde_json::from_value(answer).map_err(|error| Failure::Lost(format!("its answer is of another version: {error}")))
}

fn print(text: &str) -> Result<(), Failure> {
    let mut stdout = std::io::stdout().lock();
    stdout.write_all(text.as_bytes())?;
    stdout.flush()?;
    Ok(())
}

impl Failure {
    fn exit_code(&self) -> u8 {
        match self {
            Self::Refused(_) => 1,
            Self::Usage(_) | Self::Output(_) => 2,
            Self::NoDaemon { .. } | Self::Lost(_) => 3,
        }
    }
}
