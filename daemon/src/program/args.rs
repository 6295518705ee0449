//! What `lanternd` takes, and the help that teaches it.

use std::path::PathBuf;

use clap::{Parser, Subcommand};

/// Lights physical props with ray-traced images from many projectors, for a tracked viewer.
///
/// Start with `lanternd demo`: it needs no projector, no tracker and no GPU.
#[derive(Debug, Parser)]
#[command(name = "lanternd", version, after_help = ENVIRONMENT)]
pub struct Arguments {
    /// Which of them.
    #[command(subcommand)]
    pub command: Command,
}

const ENVIRONMENT: &str = "Environment:
  LANTERN_SOCKET      the control socket, where --socket does not name it
  LANTERN_LOG         what to log, as `info`, `debug` or `lantern=debug,warn` [default: info]
  LANTERN_VALIDATION  1: check every Vulkan call (package vulkan-validationlayers)";

/// What `lanternd` can be asked to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run the service until SIGTERM or SIGINT; SIGHUP reloads the configuration
    #[command(after_help = "Example:\n  lanternd run -c /etc/lantern/lanternd.toml\n\nOperate it with lanternctl.")]
    Run {
        /// The configuration (TOML); `lanternd check` tells what is wrong with it
        #[arg(short, long, value_name = "FILE")]
        config: PathBuf,
        /// The control socket, before $LANTERN_SOCKET and the configuration's
        #[arg(long, value_name = "PATH")]
        socket: Option<PathBuf>,
        /// Stop when every projector has shown so many frames
        #[arg(long, value_name = "N")]
        frames: Option<u64>,
    },
    /// Render the embedded scene on two projectors for three eyes, and write PNGs
    #[command(after_help = "Example:\n  lanternd demo --out /tmp/lantern\n\nLook at contact-sheet.png first.")]
    Demo {
        /// The folder for the PNGs
        #[arg(long, value_name = "DIR", default_value = "lantern-demo")]
        out: PathBuf,
        /// Frames with a moving eye to time
        #[arg(long, value_name = "N", default_value_t = 6)]
        frames: u32,
    },
    /// Load everything, render nothing, and say what each projector sees
    Check {
        /// The configuration (TOML)
        #[arg(short, long, value_name = "FILE")]
        config: PathBuf,
        /// For programs
        #[arg(long)]
        json: bool,
    },
    /// Write a projector's calibration for others: as matrices for a configuration, or as MPCDI
    #[command(after_help = "Example:\n  lanternd export -c lab.toml -p left --format mpcdi -o left.mpcdi")]
    Export {
        /// The configuration (TOML)
        #[arg(short, long, value_name = "FILE")]
        config: PathBuf,
        /// The projector's name
        #[arg(short, long)]
        projector: String,
        /// What to write
        #[arg(long, value_name = "FORMAT")]
        format: super::export::Format,
        /// The file to write
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
    },
    /// List Vulkan devices, their queues and displays, and what each can do
    Devices {
        /// For programs
        #[arg(long)]
        json: bool,
    },
    /// Time the stages of a frame: nothing changes, the eye moves, a prop moves, everything is traced anew
    Bench {
        /// The configuration (TOML); without it, the demo's
        #[arg(short, long, value_name = "FILE")]
        config: Option<PathBuf>,
        /// Frames of each case
        #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
        frames: u32,
        /// One case alone, or several
        #[arg(long = "case", value_name = "CASE")]
        cases: Vec<super::bench::Case>,
        /// Also write the rays of a frame and what they hit, for another tracer to be measured on
        #[arg(long, value_name = "DIR")]
        dump: Option<PathBuf>,
        /// For programs
        #[arg(long)]
        json: bool,
    },
}
