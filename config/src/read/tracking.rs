//! `[[body]]` and `[[tracker]]`.

use super::{known_name, unique_name};
use crate::reader::{Table, Value};
use crate::types::{Body, Drives, Matrix4, Protocol, Tracker};
use std::collections::{BTreeMap, HashSet};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

/// Names of the contract's protocols that are for later.
const PROTOCOLS_TO_COME: [&str; 6] = ["osc", "natnet", "freed", "psn", "opentrack", "dtrack"];

/// Keys of a tracker that belong to one of those.
const KEYS_TO_COME: [(&str, &str); 5] =
    [("preset", "osc"), ("address", "osc"), ("arguments", "osc"), ("version", "natnet"), ("up", "dtrack")];

/// The farthest that anything is believed to be, along each axis, m: what poses are held to while the daemon runs.
const MAX_DISTANCE_M: f64 = 1e8;

/// The farthest that anything is predicted, ms; `tracking` holds predictions to the same.
const MAX_PREDICT_MS: f64 = 150.0;

const IDENTITY: Matrix4 = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

pub(crate) fn bodies(tables: Vec<Table<'_>>, nodes: &HashSet<String>) -> Option<Vec<Body>> {
    let (mut taken, mut driven) = (HashSet::new(), HashSet::new());
    let bodies: Vec<_> = tables.into_iter().map(|table| body(table, &mut taken, &mut driven, nodes)).collect();
    bodies.into_iter().collect()
}

fn body(
    table: Table<'_>,
    taken: &mut HashSet<String>,
    driven: &mut HashSet<String>,
    nodes: &HashSet<String>,
) -> Option<Body> {
    let name = unique_name(&table, "body", taken, "\"head\"");
    let drives = table.get("drives").and_then(|value| drives(&value, driven, nodes));
    let place = |key| table.get(key)?.numbers_where("from -1e8 to 1e8", |x| x.abs() <= MAX_DISTANCE_M);
    let (position_m, offset_m) = (place("position_m"), place("offset_m"));
    table.finish();
    Some(Body {
        name: name?,
        drives,
        position_m: position_m.unwrap_or_default(),
        offset_m: offset_m.unwrap_or_default(),
    })
}

fn drives(value: &Value<'_>, driven: &mut HashSet<String>, nodes: &HashSet<String>) -> Option<Drives> {
    let text = value.string()?;
    let drives = match text.split_once(':') {
        None if text == "viewer" => Drives::Viewer,
        Some(("node", node)) => known_name(value, node, nodes, "node", "add it as a [[scene.node]]")
            .then(|| Drives::Node(node.to_owned()))?,
        Some(("projector", _)) => {
            let hint = "let the body drive \"viewer\" or \"node:NAME\"";
            value.problem("a body that drives a projector is not built yet", hint);
            return None;
        }
        _ => {
            value.problem(format!("`{text}` is nothing that a body can drive"), "write \"viewer\" or \"node:NAME\"");
            return None;
        }
    };
    // Two bodies on one thing would fight over it; several viewers are a feature of their own.
    if !driven.insert(text.clone()) {
        let message = match drives {
            Drives::Viewer => "another body drives the viewer, and several viewers are not built yet".to_owned(),
            Drives::Node(_) => format!("another body drives `{text}` already"),
        };
        value.problem(message, "let one body drive it");
        return None;
    }
    Some(drives)
}

pub(crate) fn trackers(tables: Vec<Table<'_>>, bodies: &HashSet<String>) -> Option<Vec<Tracker>> {
    let (mut taken, mut listening) = (HashSet::new(), HashSet::new());
    let trackers: Vec<_> = tables.into_iter().map(|table| tracker(table, &mut taken, &mut listening, bodies)).collect();
    trackers.into_iter().collect()
}

fn tracker(
    table: Table<'_>,
    taken: &mut HashSet<String>,
    listening: &mut HashSet<SocketAddr>,
    known_bodies: &HashSet<String>,
) -> Option<Tracker> {
    let name = unique_name(&table, "tracker", taken, "\"optitrack\"");
    let protocol_value = table.required("protocol", "\"lantern\"");
    let protocol = protocol_value.as_ref().and_then(protocol);
    let listen = table.required("listen", "\"127.0.0.1:7000\"").and_then(|value| listen(&value, listening));
    let allow = match table.get("allow") {
        None => Some(vec![IpAddr::V4(Ipv4Addr::LOCALHOST), IpAddr::V6(Ipv6Addr::LOCALHOST)]),
        Some(value) => allow(&value),
    };
    let bodies = table.required("bodies", "{ \"1\" = \"head\" }").and_then(|value| bodies_by_id(&value, known_bodies));
    let world_from_tracker = match table.get("world_from_tracker") {
        None => Some(IDENTITY),
        Some(value) => similarity(&value),
    };
    let predict_lead_ms = match table.get("predict_ms") {
        None => Some(None),
        Some(value) => predict(&value),
    };

    // Keys of other protocols are known, and wrong beside this one; beside a protocol to come that one line says it all.
    for (key, owner) in KEYS_TO_COME {
        if let (Some(value), Some(Protocol::Lantern)) = (table.get(key), protocol) {
            let hint = "remove it: protocol \"lantern\" has no settings of its own";
            value.problem(format!("`{key}` belongs to protocol \"{owner}\", which is not built yet"), hint);
        }
    }
    table.finish();
    Some(Tracker {
        name: name?,
        protocol: protocol?,
        listen: listen?,
        allow: allow?,
        bodies: bodies?,
        world_from_tracker: world_from_tracker?,
        predict_lead_ms: predict_lead_ms?,
    })
}

/// 0: nothing is predicted here. Else from when on.
fn predict(value: &Value<'_>) -> Option<Option<f64>> {
    if value.is_string() {
        return value.choice(&[("auto", Some(0.0))]);
    }
    let allowed = "from 0 to 150, or write \"auto\"; farther ahead, a straight line says nothing of a head";
    let lead_ms = value.number_where(allowed, |ms| (0.0..=MAX_PREDICT_MS).contains(&ms))?;
    Some((lead_ms > 0.0).then_some(lead_ms))
}

fn protocol(value: &Value<'_>) -> Option<Protocol> {
    let name = value.string()?;
    if name == Protocol::Lantern.as_str() {
        return Some(Protocol::Lantern);
    }
    let hint = "write protocol = \"lantern\" and send its 64-byte packets";
    if PROTOCOLS_TO_COME.contains(&name.as_str()) {
        value.problem(format!("protocol \"{name}\" is not built yet"), hint);
    } else {
        value.problem(format!("there is no protocol \"{name}\""), hint);
    }
    None
}

fn listen(value: &Value<'_>, listening: &mut HashSet<SocketAddr>) -> Option<SocketAddr> {
    let text = value.string()?;
    let Ok(address) = text.parse::<SocketAddr>() else {
        let hint = "write an IP address and a port: \"127.0.0.1:7000\", \"0.0.0.0:7000\" or \"[::1]:7000\"";
        value.problem(format!("`{text}` is no address to listen at"), hint);
        return None;
    };
    // Port 0 is whatever the system has free, so it never clashes.
    if address.port() != 0 && !listening.insert(address) {
        value.problem(format!("another tracker listens at {address} already"), "give each tracker its own port");
        return None;
    }
    Some(address)
}

fn allow(value: &Value<'_>) -> Option<Vec<IpAddr>> {
    let items = value.array("IP addresses")?;
    let address = |item: &Value<'_>| {
        let text = item.string()?;
        let parsed = text.parse().ok();
        if parsed.is_none() {
            item.problem(
                format!("`{text}` is no IP address"),
                "write addresses such as \"192.168.1.20\", without ports",
            );
        }
        parsed
    };
    let addresses: Vec<_> = items.iter().map(address).collect();
    addresses.into_iter().collect()
}

fn bodies_by_id(value: &Value<'_>, known: &HashSet<String>) -> Option<BTreeMap<u16, String>> {
    let mut bodies = BTreeMap::new();
    let mut good = true;
    for (key, span, name_value) in value.table()?.entries() {
        let id = key.parse::<u16>().ok();
        if id.is_none() {
            let message = format!("`{key}` is no id of a body");
            name_value.problem_at(&span, message, "protocol \"lantern\" numbers bodies from 0 to 65535");
        }
        let name = name_value.name().filter(|n| known_name(&name_value, n, known, "body", "add it as a [[body]]"));
        match (id, name) {
            (Some(id), Some(name)) => drop(bodies.insert(id, name)),
            _ => good = false,
        }
    }
    good.then_some(bodies)
}

/// A matrix that keeps shapes and hands: a rotation, a uniform scale and a translation.
fn similarity(value: &Value<'_>) -> Option<Matrix4> {
    let matrix = value.matrix()?;
    let [x, y, z] = [0, 1, 2].map(|column| glam::DVec3::from_array([0, 1, 2].map(|row: usize| matrix[row][column])));
    let scale = x.length();
    let even = |length: f64| (length / scale - 1.0).abs() < 1e-3;
    let square = |dot: f64| (dot / (scale * scale)).abs() < 1e-3;
    let keeps_shape = even(y.length()) && even(z.length()) && square(x.dot(y)) && square(y.dot(z)) && square(z.dot(x));
    if matrix[3] != [0.0, 0.0, 0.0, 1.0] || !keeps_shape || x.cross(y).dot(z) <= 0.0 {
        let hint = "take a rotation, at most with a translation and one scale for all axes; a mirrored tracker is to \
                    be set right at its own end";
        value.problem(format!("`{}` bends, stretches or mirrors space", value.path), hint);
        return None;
    }
    Some(matrix)
}
