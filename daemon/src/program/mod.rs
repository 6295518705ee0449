//! What `lanternd` can be asked to do, one file a subcommand.

/// Writes a line to standard output, as `println!` does, but for a reader who has heard enough (`lanternd devices | head`).
macro_rules! say {
    ($($line:tt)*) => { $crate::program::write_line(format_args!($($line)*)) };
}

pub mod args;
pub mod bench;
pub mod check;
pub mod demo;
pub mod devices;
mod dump;
pub mod export;
mod progress;

use std::fmt::Arguments;
use std::io::{ErrorKind, Write, stdout};

fn write_line(line: Arguments<'_>) {
    match writeln!(stdout(), "{line}") {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            tracing::warn!(%error, "standard output cannot be written")
        }
        _ => {}
    }
}
