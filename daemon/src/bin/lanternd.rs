//! `lanternd`: lights physical props with ray-traced images from many projectors, for a tracked viewer.

use std::process::ExitCode;

use clap::Parser;
use lantern::log::Log;
use lantern::program::args::{Arguments, Command};
use lantern::program::{bench, check, demo, devices, export};
use lantern::service::lifecycle::{self, Options};

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let log = Log::start();
    let done = match arguments.command {
        Command::Run { config, socket, frames } => lifecycle::run(&Options { config, socket, frames }).map(|()| true),
        Command::Demo { out, frames } => demo::demo(&out, frames).map(|()| true),
        Command::Check { config, json } => check::check(&config, json),
        Command::Export { config, projector, format, output } => {
            export::export(&config, &projector, format, &output).map(|()| true)
        }
        Command::Devices { json } => devices::devices(json).map(|()| true),
        Command::Bench { config, frames, cases, dump, json } => {
            bench::bench(&bench::Options { config, frames, cases, dump, json }).map(|()| true)
        }
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            log.fatal(&causes(&error));
            ExitCode::FAILURE
        }
    }
}

/// An error with its causes, but for those that the words so far have told already.
fn causes(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |told, cause| match told.as_str() {
        "" => cause,
        so_far if so_far.contains(&cause) => told,
        so_far => format!("{so_far}: {cause}"),
    })
}
