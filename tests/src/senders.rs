//! Programs of others that send poses, and whether what they send arrives.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use glam::{DMat3, DQuat, DVec3};
use serde_json::{Value, json};

use crate::client::Client;

/// How far a pose that arrives may be from the one that was sent.
const TOLERANCE_M: f64 = 1e-4;
const TOLERANCE_DEG: f64 = 0.05;
/// No datagram on this machine takes longer, even beside other tests.
const ARRIVAL_LIMIT: Duration = Duration::from_secs(20);

/// Where `packaging/senders` puts what it installs.
///
/// # Errors
/// Where it is not there, with the way to get it.
pub fn installed(path: &str) -> Result<PathBuf> {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../target/senders")).join(path);
    ensure!(path.exists(), "no {}; hint: packaging/senders installs what sends to trackers in tests", path.display());
    Ok(path)
}

/// A script of `tests/senders`.
pub fn script(name: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/senders")).join(name)
}

/// Runs a sender to its end and gives what it printed.
///
/// # Errors
/// Where it is not there, or fails.
pub fn send(command: &mut Command) -> Result<String> {
    let run = command.output();
    let output = run.with_context(|| format!("running {command:?}; hint: packaging/senders installs what it needs"))?;
    let said = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{command:?} ended with {}:\n{said}", output.status);
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// A pose that no mirror and no swap of axes leaves as it is.
#[derive(Clone, Copy, Debug)]
pub struct Pose {
    /// In the world, m.
    pub position_m: DVec3,
    /// World from body.
    pub rotation: DMat3,
}

impl Pose {
    /// One of many, by number.
    pub fn number(number: u32) -> Self {
        let n = f64::from(number);
        let [x, y, z] = [0.31 + 0.17 * n, -0.47 + 0.11 * n, 0.83 - 0.13 * n];
        // Elementary turns by different angles about all axes.
        let rotation =
            DMat3::from_rotation_y(0.7 + 0.1 * n) * DMat3::from_rotation_x(-0.4) * DMat3::from_rotation_z(0.25);
        Self { position_m: DVec3::new(x, 1.0 + y, z), rotation }
    }

    /// The same in a tracker's axes, `theirs_from_ours`, right-handed or left-handed: its position, and its rotation as a
    /// matrix, C·R·Cᵀ, which is a rotation by either hand.
    pub fn seen(&self, theirs_from_ours: DMat3) -> (DVec3, DMat3) {
        (theirs_from_ours * self.position_m, theirs_from_ours * self.rotation * theirs_from_ours.transpose())
    }
}

/// Unity's axes in ours, and PosiStageNet's: x right, y up, z ahead.
pub fn unity() -> DMat3 {
    DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0))
}

/// Sends a frame of PosiStageNet with trackers of these numbers, each with the pose of its number and called "Singer" with it, by npm's
/// encoder. Gives in how many packets it went.
///
/// # Errors
/// Where the encoder or node is not there.
pub fn psn(to: &str, numbers: std::ops::RangeInclusive<u32>) -> Result<u32> {
    let tracker = |number: u32| {
        let (p, r) = Pose::number(number).seen(unity());
        let turn = DQuat::from_mat3(&r).to_scaled_axis();
        json!({"id": number, "name": format!("Singer {number}"), "position": p.to_array(), "rotation": turn.to_array()})
    };
    let trackers: Value = numbers.map(tracker).collect();
    let mut node = Command::new("node");
    node.env("NODE_PATH", installed("node/node_modules")?);
    let packets = send(node.arg(script("psn.cjs")).args([to, &trackers.to_string()]))?;
    Ok(packets.trim().parse()?)
}

/// Waits until a body has a pose.
///
/// # Errors
/// Where it does not get there in time, with what `status` says instead.
pub fn arrives(client: &mut Client, body: &str, pose: &Pose) -> Result<Value> {
    let started = Instant::now();
    loop {
        let status = client.status()?;
        let numbers = |key: &str| -> Vec<f64> {
            status["bodies"][body][key].as_array().into_iter().flatten().filter_map(Value::as_f64).collect()
        };
        let (Ok(position), Ok(orientation)) =
            (<[f64; 3]>::try_from(numbers("position_m")), <[f64; 4]>::try_from(numbers("orientation")))
        else {
            bail!("no body `{body}` in {status}");
        };
        let error_m = (DVec3::from_array(position) - pose.position_m).length();
        let turn = DQuat::from_mat3(&pose.rotation).inverse() * DQuat::from_array(orientation);
        let error_deg = 2.0 * turn.xyz().length().atan2(turn.w.abs()).to_degrees();
        if error_m <= TOLERANCE_M && error_deg <= TOLERANCE_DEG {
            return Ok(status);
        }
        ensure!(
            started.elapsed() < ARRIVAL_LIMIT,
            "`{body}` is {error_m} m and {error_deg}° from {pose:?}:\n{:#}\n{:#}",
            status["bodies"][body],
            status["trackers"]
        );
        thread::sleep(Duration::from_millis(10));
    }
}

/// A tracker's port.
///
/// # Errors
/// Where `status` has no such tracker.
pub fn port(client: &mut Client, tracker: &str) -> Result<u16> {
    let status = client.status()?;
    let listen = status["trackers"][tracker]["listen"].as_str().with_context(|| format!("no tracker `{tracker}`"))?;
    let (_, port) = listen.rsplit_once(':').context("an address without a port")?;
    Ok(port.parse()?)
}
