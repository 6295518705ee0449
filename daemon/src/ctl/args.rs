//! What can be asked, and the help that teaches it.

use clap::{Args, Parser, Subcommand};
use lantern_proto::EventKind;
use std::ffi::OsString;
use std::path::PathBuf;

const EXIT_CODES: &str = "Exit codes:
  0  done
  1  the daemon refused; its message is on standard error
  2  bad usage
  3  no daemon there

Examples:
  lanternctl status
  lanternctl load bunny.glb --node bunny --role prop
  lanternctl pose head 0 1.7 2.5
  lanternctl snapshot -p left -o left.png

World frame: right-handed, metres, +Y up. Quaternions are x y z w.";

/// The operator's hand on a running lanternd.
#[derive(Debug, Parser)]
#[command(name = "lanternctl", version, after_help = EXIT_CODES)]
pub(super) struct Arguments {
    /// The daemon's socket [default: $LANTERN_SOCKET, else /run/lantern/lanternd.sock for root, else
    /// $XDG_RUNTIME_DIR/lantern/lanternd.sock]
    #[arg(long, global = true, value_name = "PATH")]
    pub(super) socket: Option<PathBuf>,

    /// Print what the daemon answers as one line of JSON
    #[arg(long, global = true)]
    pub(super) json: bool,

    #[command(subcommand)]
    pub(super) command: Command,
}

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Show how the daemon does: device, scene, bodies, trackers, projectors
    #[command(after_help = "Examples:
  lanternctl status
  lanternctl status --json | jq .projectors.left.frame_ms.p95")]
    Status,

    /// Show the status live, or what happens as it does, until Ctrl-C
    #[command(after_help = "Goes on when the daemon is started again.

Columns of --csv, a line for each frame, projector and body: how old the body's pose was when it was measured,
received, submitted, complete and presented, ms, since its measurement where the tracker says when that was,
else since its receipt; predicted_ms, how far ahead of its measurement it is shown; lost, how many frames are
missing before the line because this program was too slow.

Examples:
  lanternctl watch
  lanternctl watch --interval 0.2
  lanternctl watch --json --count 60 > minute.jsonl
  lanternctl watch --events frame,tracker
  lanternctl watch --csv latency.csv")]
    Watch(Watch),

    /// Read or change the scene
    #[command(subcommand)]
    Scene(Scene),

    /// Add a node from a file or a built-in shape
    #[command(
        after_help = "A relative path is taken from here, if such a file exists, and sent in full: the daemon may
run elsewhere. It reads files only below its `daemon.asset_roots`. Built-in shapes start with
`lantern:`, such as lantern:sphere, lantern:teapot and lantern:checker.

Examples:
  lanternctl load bunny.glb --node bunny
  lanternctl load lantern:sphere --node lamp --role virtual"
    )]
    Load(Load),

    /// Place a body, as if a tracker had said it
    #[command(after_help = "Examples:
  lanternctl pose head 0 1.7 2.5
  lanternctl pose head -0.5 1.7 2.5 0 0.38 0 0.92")]
    Pose(Pose),

    /// Save what a projector shows
    #[command(after_help = "Layers:
  color     PNG: exactly what the projector shows
  radiance  EXR, 3 x f32: linear colour before blending
  distance  EXR: along the primary ray to the closest hit, m; +inf is a miss
  depth     EXR: the depth attachment; 1 is a miss
  node      EXR: index of the node, as `scene get` orders them; -1 is a miss
  weight    EXR: the blend weight
  room      PNG: what the viewer's eye sees of the lit props

Examples:
  lanternctl snapshot -p left -o left.png
  lanternctl snapshot -p left --layer distance -o left.exr
  lanternctl snapshot -p left -o - | display")]
    Snapshot(Snapshot),

    /// Show a test pattern instead of the scene; `off` ends it
    #[command(after_help = "Examples:
  lanternctl pattern grid -p left
  lanternctl pattern off")]
    Pattern(Pattern),

    /// Have the daemon read its configuration again, as SIGHUP does
    #[command(
        after_help = "A configuration that is wrong is refused with everything that is wrong with it, and changes nothing.

Example:
  lanternctl reload"
    )]
    Reload,
}

#[derive(Debug, Args)]
pub(super) struct Watch {
    /// Seconds between two looks
    #[arg(long, value_name = "SECONDS", default_value_t = 1.0, value_parser = interval)]
    pub(super) interval: f64,

    /// Stop after so many looks, events or frames
    #[arg(long, value_name = "N")]
    pub(super) count: Option<u64>,

    /// Print events instead, a line of JSON each: frame, pose, scene, tracker
    #[arg(long, value_name = "EVENTS", value_delimiter = ',', value_parser = EventKind::ALL.map(EventKind::as_str))]
    pub(super) events: Vec<String>,

    /// Write a line for each frame into a file instead: how old its poses were; `-` is standard output
    #[arg(long, value_name = "FILE", conflicts_with = "events")]
    pub(super) csv: Option<PathBuf>,

    /// How long to wait for a daemon that has gone to come back, seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0, value_parser = patience)]
    pub(super) patience: f64,
}

#[derive(Debug, Subcommand)]
pub(super) enum Scene {
    /// Print the whole scene as edits that would rebuild it
    #[command(after_help = "Example:
  lanternctl scene get > scene.json      # and later: lanternctl scene apply scene.json")]
    Get,

    /// Apply edits, all or none
    #[command(after_help = "FILE holds a JSON array of edits, or what `scene get --json` printed:
  [{\"add\": {\"node\": \"ball\", \"uri\": \"lantern:sphere\", \"translation_m\": [0, 0.5, 0]}},
   {\"set\": {\"node\": \"ball\", \"scale\": [0.5, 0.5, 0.5]}},
   {\"material\": {\"name\": \"ball/sphere\", \"metallic\": 1, \"roughness\": 0}},
   {\"light\": {\"name\": \"sun\", \"kind\": \"directional\", \"direction\": [0, -1, 0]}},
   {\"environment\": {\"color\": [0.1, 0.1, 0.12]}},
   {\"remove\": {\"node\": \"teapot\"}}]

Examples:
  lanternctl scene apply edits.json
  echo '[{\"remove\": {\"node\": \"ball\"}}]' | lanternctl scene apply -")]
    Apply(Apply),
}

#[derive(Debug, Args)]
pub(super) struct Apply {
    /// The edits; `-` reads standard input
    #[arg(value_name = "FILE")]
    pub(super) file: PathBuf,

    /// Return when the edits are shown, whether or not they would survive a crash of the daemon
    #[arg(long)]
    pub(super) not_durable: bool,
}

#[derive(Debug, Args)]
pub(super) struct Load {
    /// A .gltf or .glb file, or a built-in shape such as lantern:sphere
    #[arg(value_name = "URI")]
    pub(super) uri: String,

    /// The new node's name
    #[arg(long, value_name = "NAME")]
    pub(super) node: String,

    /// What it is in the room [default: as the file says, else prop]
    #[arg(long, value_name = "ROLE", value_parser = ["prop", "virtual", "raster", "mask"])]
    pub(super) role: Option<String>,
}

#[derive(Debug, Args)]
#[command(override_usage = "lanternctl pose [OPTIONS] <BODY> <X> <Y> <Z> [<QX> <QY> <QZ> <QW>]")]
pub(super) struct Pose {
    /// The body's name, as the configuration has it
    #[arg(value_name = "BODY")]
    pub(super) body: String,

    /// The position in metres, and the orientation as a unit quaternion; without one it stays as it was
    #[arg(value_name = "NUMBER", required = true, num_args = 3..=7, allow_negative_numbers = true, value_parser = finite)]
    pub(super) numbers: Vec<f64>,
}

#[derive(Debug, Args)]
pub(super) struct Snapshot {
    /// The projector's name
    #[arg(short, long, value_name = "PROJECTOR")]
    pub(super) projector: String,

    /// What of it
    #[arg(long, value_name = "LAYER", default_value = "color", value_parser = lantern_proto::Layer::ALL.map(lantern_proto::Layer::as_str))]
    pub(super) layer: String,

    /// Where to; `-` writes to standard output
    #[arg(short, long, value_name = "FILE")]
    pub(super) output: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct Pattern {
    /// Which one
    #[arg(value_name = "NAME", value_parser = ["grid", "white", "black", "checker", "identify", "off"])]
    pub(super) name: String,

    /// On this projector alone
    #[arg(short, long, value_name = "PROJECTOR")]
    pub(super) projector: Option<String>,
}

/// A negative number with a negative exponent as a plain one: the parser takes `-2e-3`, which programs print, for options.
pub(super) fn without_exponent(argument: OsString) -> OsString {
    let number = argument.to_str().filter(|text| text.starts_with('-')).and_then(|text| text.parse::<f64>().ok());
    // Displayed without an exponent, and as the very same number.
    number.filter(|x| x.is_finite()).map_or(argument, |x| x.to_string().into())
}

fn finite(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|x: &f64| x.is_finite()).ok_or_else(|| "not a finite number".to_owned())
}

fn interval(text: &str) -> Result<f64, String> {
    finite(text).ok().filter(|s| (0.01..=3600.0).contains(s)).ok_or_else(|| "not from 0.01 to 3600 seconds".to_owned())
}

fn patience(text: &str) -> Result<f64, String> {
    finite(text).ok().filter(|s| (0.0..=1e6).contains(s)).ok_or_else(|| "not from 0 to 1000000 seconds".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_definition_is_sound() {
        use clap::CommandFactory;
        Arguments::command().debug_assert();
    }

    #[test]
    fn negative_numbers_are_no_options() {
        let words =
            ["lanternctl", "pose", "head", "-0.5", "1", "-2e-3", "--json"].map(|word| without_exponent(word.into()));
        let arguments = Arguments::try_parse_from(words).unwrap();
        assert!(arguments.json);
        let Command::Pose(pose) = arguments.command else { panic!("another command") };
        assert_eq!(pose.numbers, [-0.5, 1.0, -2e-3]);
    }
}
