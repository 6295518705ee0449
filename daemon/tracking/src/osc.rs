//! Open Sound Control: poses in the messages of well-known programs, or in messages that the user describes.
//!
//! | preset | address | arguments |
//! |---|---|---|
//! | `vmc` | `/VMC/Ext/Hmd/Pos`, `…/Con/Pos`, `…/Tra/Pos` | name, position, quaternion |
//! | `vrchat` | `/tracking/trackers/⟨id⟩/position`, `…/rotation` | x, y, z: m, or degrees about z, then x, then y |
//! | `optitrack` | `/rigidbody/⟨id⟩/transformation` | position, quaternion |
//! | | `/rb` | id, 2, time, position, quaternion |
//! | | `/rigidbody/⟨id⟩/tracked`; `/rb` | 0 or 1; id, 0, 0 or 1 |
//!
//! The first two have Unity's axes, the third OptiTrack's, which are ours. OSC has no numbers of packets and no checksum.
//! What one datagram says of a body in several messages is one reading. A body that is said to be lost (`tracked` 0) is so until it is
//! said to be tracked: OptiTrack's bridges go on sending its last pose.

use crate::axes::Axes;
use crate::osc_packet::{Message, messages};
use crate::protocol::{BodyId, Heard, Protocol, Reading, Refusal, bad, finite, ns_of, unit};
use glam::{DQuat, DVec3, DVec4};
use lantern_config::{OscArgument, OscPattern};
use rosc::OscType;
use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::time::Instant;

/// Reads messages.
pub(crate) struct Osc {
    /// Whose messages.
    kind: lantern_config::Osc,
    /// The bodies that the configuration has; of no others anything is remembered.
    wanted: BTreeSet<BodyId>,
    /// Those of `wanted` that were said to be lost, and not since to be tracked: poses that are told of them are none.
    lost: BTreeSet<BodyId>,
}

impl Osc {
    /// `ids` are those that the configuration has.
    pub(crate) fn new<'a>(kind: lantern_config::Osc, ids: impl Iterator<Item = &'a String>) -> Self {
        Self { kind, wanted: ids.map(|id| BodyId::parse(id)).collect(), lost: BTreeSet::new() }
    }

    /// Takes what a datagram says of whether bodies are tracked, wherever in it, and voids the poses of those that are lost.
    fn tell_lost(&mut self, tracked: BTreeMap<BodyId, bool>, readings: &mut [Reading]) {
        for (body, is_tracked) in tracked {
            if is_tracked {
                self.lost.remove(&body);
            } else if self.wanted.contains(&body) {
                self.lost.insert(body);
            }
        }
        for reading in readings.iter_mut().filter(|reading| self.lost.contains(&reading.body)) {
            (reading.position_m, reading.orientation) = (None, None);
        }
    }
}

impl Protocol for Osc {
    fn read(&mut self, datagram: &[u8], _from: SocketAddr, _at: Instant, heard: &mut Heard) -> Result<(), Refusal> {
        let messages = messages(datagram)?;
        let mut tracked = BTreeMap::new();
        for message in &messages {
            let reading = match &self.kind {
                lantern_config::Osc::Vmc => vmc(message)?,
                lantern_config::Osc::Vrchat => vrchat(message)?,
                lantern_config::Osc::Optitrack => optitrack(message, &mut tracked)?,
                lantern_config::Osc::Free(pattern) => free(message, pattern)?,
            };
            let Some(mut reading) = reading else { continue };
            reading.measured_ns = reading.measured_ns.or(message.time_ns);
            merge(&mut heard.readings, reading);
        }
        self.tell_lost(tracked, &mut heard.readings);
        match (heard.readings.is_empty(), messages.first()) {
            (false, _) => Ok(()),
            (true, Some(first)) => Err(Refusal::Other(format!("message {}", first.message.addr))),
            (true, None) => Err(Refusal::Other("an empty bundle".to_owned())),
        }
    }
}

/// Adds what is said of a body to what has been said of it already; the later word counts.
fn merge(readings: &mut Vec<Reading>, later: Reading) {
    let Some(earlier) = readings.iter_mut().find(|reading| reading.body == later.body) else {
        return readings.push(later);
    };
    earlier.position_m = later.position_m.or(earlier.position_m);
    earlier.orientation = later.orientation.or(earlier.orientation);
    earlier.measured_ns = later.measured_ns.or(earlier.measured_ns);
}

fn vmc(message: &Message) -> Result<Option<Reading>, Refusal> {
    let arguments = &message.message.args;
    match message.message.addr.as_str() {
        "/VMC/Ext/Hmd/Pos" | "/VMC/Ext/Con/Pos" | "/VMC/Ext/Tra/Pos" => {}
        _ => return Ok(None),
    }
    let [OscType::String(name), rest @ ..] = arguments.as_slice() else {
        return bad(format!("{} without a name", message.message.addr));
    };
    let [px, py, pz, qx, qy, qz, qw] = numbers(rest, &message.message.addr)?;
    pose(BodyId::parse(name), &Axes::Y_UP_LEFT, [px, py, pz], [qx, qy, qz, qw]).map(Some)
}

fn vrchat(message: &Message) -> Result<Option<Reading>, Refusal> {
    let address = &message.message.addr;
    let Some(path) = address.strip_prefix("/tracking/trackers/") else { return Ok(None) };
    let Some((id, what)) = path.split_once('/') else { return Ok(None) };
    let reading = Reading::of(BodyId::parse(id));
    match what {
        "position" => {
            let p = position(&Axes::Y_UP_LEFT, numbers(&message.message.args, address)?)?;
            Ok(Some(Reading { position_m: Some(p), ..reading }))
        }
        "rotation" => {
            let q = turned(&Axes::Y_UP_LEFT, numbers(&message.message.args, address)?)?;
            Ok(Some(Reading { orientation: Some(q), ..reading }))
        }
        _ => Ok(None),
    }
}

/// What is said of whether a body is tracked goes into `tracked`.
fn optitrack(message: &Message, tracked: &mut BTreeMap<BodyId, bool>) -> Result<Option<Reading>, Refusal> {
    let (address, arguments) = (&message.message.addr, message.message.args.as_slice());
    // Of a body that is not tracked the bridges say so, and its last pose as well, which is none then.
    let mut said_lost = |flag: f64, body: BodyId| {
        tracked.insert(body.clone(), flag != 0.0);
        (flag == 0.0).then(|| Reading::of(body))
    };
    if let Some(path) = address.strip_prefix("/rigidbody/") {
        let Some((id, what)) = path.split_once('/') else { return Ok(None) };
        let body = BodyId::parse(id);
        return match what {
            "transformation" => {
                let [px, py, pz, qx, qy, qz, qw] = numbers(arguments, address)?;
                pose(body, &Axes::Y_UP, [px, py, pz], [qx, qy, qz, qw]).map(Some)
            }
            "tracked" => numbers(arguments, address).map(|[flag]| said_lost(flag, body)),
            _ => Ok(None),
        };
    }
    if address != "/rb" {
        return Ok(None);
    }
    let [id, kind, rest @ ..] = arguments else { return bad("/rb without an id and a kind") };
    let body = id_of(id).map_or_else(|| bad("/rb without an id"), Ok)?;
    match number(kind) {
        Some(0.0) => numbers(rest, address).map(|[flag]| said_lost(flag, body)),
        Some(2.0) => {
            let [time_s, px, py, pz, qx, qy, qz, qw] = numbers(rest, address)?;
            let reading = pose(body, &Axes::Y_UP, [px, py, pz], [qx, qy, qz, qw])?;
            Ok(Some(Reading { measured_ns: ns_of(time_s), ..reading }))
        }
        _ => Ok(None),
    }
}

fn free(message: &Message, pattern: &OscPattern) -> Result<Option<Reading>, Refusal> {
    let (address, arguments) = (&message.message.addr, message.message.args.as_slice());
    let Some(id) = matched(&pattern.address, address) else { return Ok(None) };
    if arguments.len() != pattern.arguments.len() {
        let (got, wanted) = (arguments.len(), pattern.arguments.len());
        return bad(format!("{address} has {got} arguments, and `arguments` describes {wanted}"));
    }
    let mut body = if !pattern.tells_bodies_apart() { BodyId::Only } else { BodyId::parse(id.unwrap_or(address)) };
    let (mut p, mut q, mut turn, mut time_s) = (None, None, None, None);
    for (argument, kind) in arguments.iter().zip(&pattern.arguments) {
        let wrong = || Refusal::Bad(format!("{address} has an argument that is no number, where one should be"));
        let number = || number(argument).ok_or_else(wrong);
        match *kind {
            OscArgument::Skip => {}
            OscArgument::Id => body = id_of(argument).map_or_else(|| bad(format!("{address} without an id")), Ok)?,
            OscArgument::Time => time_s = Some(number()?),
            OscArgument::Position(axis) => p.get_or_insert([0.0; 3])[axis] = number()?,
            OscArgument::Quaternion(at) => q.get_or_insert([0.0; 4])[at] = number()?,
            OscArgument::Turn(axis) => turn.get_or_insert([0.0; 3])[axis] = number()?,
        }
    }
    let axes = Axes::configured(pattern.axes);
    let position_m = p.map(|p| position(&axes, p.map(|x| x * pattern.unit_m))).transpose()?;
    let quaternion = q.map(|q| rotation(&axes, q)).transpose()?;
    let turns = turn.map(|turn| turned(&axes, turn)).transpose()?;
    let measured_ns = time_s.and_then(ns_of);
    Ok(Some(Reading { position_m, orientation: quaternion.or(turns), measured_ns, ..Reading::of(body) }))
}

/// Whether an address is one of a pattern's: `None` if not, else the part that stands at `{id}`, if there is one.
fn matched<'a>(pattern: &str, address: &'a str) -> Option<Option<&'a str>> {
    let (mut patterns, mut parts) = (pattern.split('/'), address.split('/'));
    let mut id = None;
    loop {
        match (patterns.next(), parts.next()) {
            (None, None) => return Some(id),
            (Some(OscPattern::ID), Some(part)) if !part.is_empty() => id = Some(part),
            (Some("*"), Some(part)) if !part.is_empty() => {}
            (Some(pattern), Some(part)) if pattern == part => {}
            _ => return None,
        }
    }
}

fn pose(body: BodyId, axes: &Axes, p: [f64; 3], q: [f64; 4]) -> Result<Reading, Refusal> {
    Ok(Reading { position_m: Some(position(axes, p)?), orientation: Some(rotation(axes, q)?), ..Reading::of(body) })
}

fn position(axes: &Axes, p: [f64; 3]) -> Result<DVec3, Refusal> {
    finite(DVec3::from_array(p), "position").map(|p| axes.vector(p))
}

fn rotation(axes: &Axes, q: [f64; 4]) -> Result<DQuat, Refusal> {
    unit(DQuat::from_vec4(DVec4::from_array(q))).map(|q| axes.rotation(q))
}

/// Turns about x, y and z, degrees: about z first, then x, then y, each as the axes have it.
fn turned(axes: &Axes, degrees: [f64; 3]) -> Result<DQuat, Refusal> {
    // Beyond a few turns they are no angles.
    if !degrees.iter().all(|angle| angle.abs() <= 1080.0) {
        return bad("angles that are not finite, or more than three turns");
    }
    let [x, y, z] = degrees.map(f64::to_radians);
    let q = DQuat::from_rotation_y(y) * DQuat::from_rotation_x(x) * DQuat::from_rotation_z(z);
    Ok(axes.rotation(q.normalize()))
}

/// The first `N` arguments, which must be numbers; programs add others behind them.
fn numbers<const N: usize>(arguments: &[OscType], address: &str) -> Result<[f64; N], Refusal> {
    let first = arguments.get(..N).map(|first| first.iter().map_while(number).collect::<Vec<_>>());
    let numbers = first.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
    numbers.map_or_else(|| bad(format!("{address} without its {N} numbers")), Ok)
}

fn number(argument: &OscType) -> Option<f64> {
    match argument {
        OscType::Float(number) => Some(f64::from(*number)),
        OscType::Double(number) => Some(*number),
        OscType::Int(number) => Some(f64::from(*number)),
        OscType::Long(number) => Some(*number as f64),
        OscType::Bool(flag) => Some(f64::from(u8::from(*flag))),
        _ => None,
    }
}

fn id_of(argument: &OscType) -> Option<BodyId> {
    match argument {
        OscType::String(name) => Some(BodyId::parse(name)),
        _ => number(argument).filter(|id| id.fract() == 0.0).map(|id| BodyId::parse(&id.to_string())),
    }
}
