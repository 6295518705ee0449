//! `[[body]]` and `[[tracker]]`.

use super::protocol::{body_id, has_one_body, protocol};
use super::{IDENTITY, known_name, similarity, unique_name};
use crate::protocol::{Natnet, Protocol};
use crate::reader::{Table, Value};
use crate::types::{Body, Drives, Tracker};
use std::collections::{BTreeMap, HashSet};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

/// The farthest that anything is believed to be, along each axis, m: what poses are held to while the daemon runs.
const MAX_DISTANCE_M: f64 = 1e8;

/// The farthest that anything is predicted, ms; `tracking` holds predictions to the same.
const MAX_PREDICT_MS: f64 = 150.0;

pub(crate) fn bodies(
    tables: Vec<Table<'_>>,
    nodes: &HashSet<String>,
    projectors: &HashSet<String>,
) -> Option<Vec<Body>> {
    let (mut taken, mut driven) = (HashSet::new(), HashSet::new());
    let known = Known { nodes, projectors };
    let bodies: Vec<_> = tables.into_iter().map(|table| body(table, &mut taken, &mut driven, &known)).collect();
    bodies.into_iter().collect()
}

/// What there is to be driven.
struct Known<'a> {
    nodes: &'a HashSet<String>,
    projectors: &'a HashSet<String>,
}

fn body(
    table: Table<'_>,
    taken: &mut HashSet<String>,
    driven: &mut HashSet<String>,
    known: &Known<'_>,
) -> Option<Body> {
    let name = unique_name(&table, "body", taken, "\"head\"");
    let drives = table.get("drives").and_then(|value| drives(&value, driven, known));
    let place = |key| table.get(key)?.numbers_where("from -1e8 to 1e8", |x| x.abs() <= MAX_DISTANCE_M);
    let (position_m, offset_m) = (place("position_m"), place("offset_m"));
    if let (Some(Drives::Projector(_)), Some(value)) = (&drives, table.get("offset_m")) {
        // Its calibration says already how the projector stands to the tracked point.
        value.problem(
            "a body that carries a projector has no offset",
            "remove `offset_m`; `position_m` says where the \
            body stood when the projector was calibrated",
        );
    }
    table.finish();
    Some(Body {
        name: name?,
        drives,
        position_m: position_m.unwrap_or_default(),
        offset_m: offset_m.unwrap_or_default(),
    })
}

fn drives(value: &Value<'_>, driven: &mut HashSet<String>, known: &Known<'_>) -> Option<Drives> {
    let text = value.string()?;
    let drives = match text.split_once(':') {
        None if text == "viewer" => Drives::Viewer,
        Some(("node", node)) => known_name(value, node, known.nodes, "node", "add it as a [[scene.node]]")
            .then(|| Drives::Node(node.to_owned()))?,
        Some(("projector", projector)) => {
            known_name(value, projector, known.projectors, "projector", "add it as a [[projector]]")
                .then(|| Drives::Projector(projector.to_owned()))?
        }
        _ => {
            let hint = "write \"viewer\", \"node:NAME\" or \"projector:NAME\"";
            value.problem(format!("`{text}` is nothing that a body can drive"), hint);
            return None;
        }
    };
    // Two bodies on one thing would fight over it; several viewers are a feature of their own.
    if !driven.insert(text.clone()) {
        let message = match drives {
            Drives::Viewer => "another body drives the viewer, and several viewers are not built yet".to_owned(),
            Drives::Node(_) | Drives::Projector(_) => format!("another body drives `{text}` already"),
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
    let protocol = protocol(&table);
    let listen_value = table.required("listen", "\"127.0.0.1:7000\"");
    let listen = listen_value.as_ref().and_then(|value| listen(value, listening));
    let interface = match (table.get("interface"), listen_value, listen) {
        (interface, Some(value), Some(listen)) => interface_of(interface.as_ref(), &value, listen),
        _ => None,
    };
    let allow = match table.get("allow") {
        None => Some(default_allow(protocol.as_ref())),
        Some(value) => allow(&value).filter(|allow| allows_server(&value, allow, protocol.as_ref())),
    };
    let bodies = table
        .required("bodies", "{ \"1\" = \"head\" }")
        .and_then(|value| bodies_by_id(&value, protocol.as_ref(), known_bodies));
    let world_from_tracker = match table.get("world_from_tracker") {
        None => Some(IDENTITY),
        Some(value) => {
            let hint = "take a rotation, at most with a translation and one scale for all axes; a mirrored tracker is \
                        to be set right at its own end";
            similarity(&value, false, hint)
        }
    };
    let predict_lead_ms = match table.get("predict_ms") {
        None => Some(None),
        Some(value) => predict(&value),
    };

    table.finish();
    Some(Tracker {
        name: name?,
        protocol: protocol?,
        listen: listen?,
        interface: interface?,
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

fn listen(value: &Value<'_>, listening: &mut HashSet<SocketAddr>) -> Option<SocketAddr> {
    let text = value.string()?;
    let Ok(address) = text.parse::<SocketAddr>() else {
        let hint = "write an IP address and a port: \"127.0.0.1:7000\", \"0.0.0.0:7000\" or \"[::1]:7000\"";
        value.problem(format!("`{text}` is no address to listen at"), hint);
        return None;
    };
    // Port 0 is whatever the system has free, so it never clashes; and what listens at every address, listens at each.
    let clashes = |other: &&SocketAddr| {
        let [ip, other_ip] = [address.ip(), other.ip()];
        address.port() == other.port() && (ip == other_ip || ip.is_unspecified() || other_ip.is_unspecified())
    };
    if address.port() != 0 {
        if let Some(other) = listening.iter().find(clashes) {
            let message = if *other == address {
                format!("another tracker listens at {address} already")
            } else {
                format!("another tracker listens at {other}, which {address} includes or is part of")
            };
            value.problem(message, "give each tracker its own port");
            return None;
        }
        listening.insert(address);
    }
    Some(address)
}

/// The interface of a multicast group; an address of this machine has none.
fn interface_of(interface: Option<&Value<'_>>, listen_value: &Value<'_>, listen: SocketAddr) -> Option<Option<String>> {
    match (interface, listen.ip().is_multicast()) {
        (None, false) => Some(None),
        (None, true) => {
            let hint = "add interface = \"eth0\", or the address of that network card; `ip address` lists them";
            listen_value.problem(
                format!("{} is a multicast group, and no `interface` says where to join it", listen.ip()),
                hint,
            );
            None
        }
        (Some(value), false) => {
            let hint = "remove it, or listen at a group such as \"239.255.42.99:1511\"";
            value.problem(format!("`interface` is for multicast groups, which {} is not", listen.ip()), hint);
            None
        }
        (Some(value), true) if listen.port() == 0 => {
            value.problem("a multicast group has a port, and it is not 0", "write the port that the tracker sends to");
            None
        }
        (Some(value), true) => value.name().map(Some),
    }
}

/// This machine itself, and the server that is spoken to.
fn default_allow(protocol: Option<&Protocol>) -> Vec<IpAddr> {
    let server = protocol.and_then(server_of);
    [IpAddr::V4(Ipv4Addr::LOCALHOST), IpAddr::V6(Ipv6Addr::LOCALHOST)].into_iter().chain(server).collect()
}

fn server_of(protocol: &Protocol) -> Option<IpAddr> {
    match protocol {
        Protocol::Natnet(Natnet { server, .. }) => server.map(|server| server.ip()),
        _ => None,
    }
}

fn allows_server(value: &Value<'_>, allow: &[IpAddr], protocol: Option<&Protocol>) -> bool {
    let stranger = protocol.and_then(server_of).filter(|server| !allow.contains(server));
    if let Some(server) = stranger {
        value.problem(format!("`allow` does not have {server}, which is the `server`"), format!("add \"{server}\""));
    }
    stranger.is_none()
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

fn bodies_by_id(
    value: &Value<'_>,
    protocol: Option<&Protocol>,
    known: &HashSet<String>,
) -> Option<BTreeMap<String, String>> {
    let mut bodies = BTreeMap::new();
    let mut good = true;
    let entries = value.table()?.entries();
    for (key, span, name_value) in &entries {
        // Of which protocol nobody knows, any id will do.
        let id = protocol.map_or(Ok((*key).to_owned()), |protocol| body_id(protocol, key));
        if let Err(hint) = id {
            name_value.problem_at(span, format!("`{key}` is no id of a body"), hint);
        }
        let name = name_value.name().filter(|n| known_name(name_value, n, known, "body", "add it as a [[body]]"));
        good &= id.is_ok() && name.is_some();
        if let (Ok(id), Some(name)) = (id, name)
            && bodies.insert(id.clone(), name).is_some()
        {
            name_value.problem_at(span, format!("`{id}` is there twice"), "name each of the tracker's bodies once");
            good = false;
        }
    }
    if entries.len() > 1 && protocol.is_some_and(has_one_body) {
        let hint = "leave one entry, whatever its key; for `osc`, {id} in `address` or \"id\" in `arguments` tells bodies apart";
        value.problem("the messages of this tracker mean one body, and `bodies` has several", hint);
        good = false;
    }
    good.then_some(bodies)
}
