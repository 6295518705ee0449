//! What a `[[tracker]]` speaks: the keys of each protocol, and how it names bodies.

use crate::protocol::{Axes, Dtrack, Natnet, NatnetVersion, Opentrack, Osc, OscArgument, OscPattern, Protocol};
use crate::reader::{Table, Value};
use std::net::{IpAddr, SocketAddr};

/// Every protocol, and the keys that it has for itself.
const PROTOCOLS: [(&str, &[&str]); 7] = [
    ("lantern", &[]),
    ("osc", &["preset", "address", "arguments", "axes", "units"]),
    ("natnet", &["version", "server"]),
    ("freed", &[]),
    ("psn", &[]),
    ("opentrack", &["signs"]),
    ("dtrack", &["up"]),
];

/// The port on which NatNet servers take commands.
const NATNET_COMMAND_PORT: u16 = 1510;

const AXES: [(&str, Axes); 4] =
    [("y-up", Axes::YUp), ("y-up-left", Axes::YUpLeft), ("z-up", Axes::ZUp), ("z-up-left", Axes::ZUpLeft)];

const UNITS_M: [(&str, f64); 5] = [("m", 1.0), ("cm", 0.01), ("mm", 0.001), ("in", 0.0254), ("ft", 0.3048)];

const ARGUMENTS: [(&str, OscArgument); 13] = [
    ("id", OscArgument::Id),
    ("x", OscArgument::Position(0)),
    ("y", OscArgument::Position(1)),
    ("z", OscArgument::Position(2)),
    ("qx", OscArgument::Quaternion(0)),
    ("qy", OscArgument::Quaternion(1)),
    ("qz", OscArgument::Quaternion(2)),
    ("qw", OscArgument::Quaternion(3)),
    ("rx", OscArgument::Turn(0)),
    ("ry", OscArgument::Turn(1)),
    ("rz", OscArgument::Turn(2)),
    ("time", OscArgument::Time),
    ("_", OscArgument::Skip),
];

/// The protocol of a tracker's table with its settings; `None` where something was wrong, which has been noted.
pub(crate) fn protocol(table: &Table<'_>) -> Option<Protocol> {
    let value = table.required("protocol", "\"lantern\"");
    let name = value.as_ref().and_then(|value| value.choice(&PROTOCOLS.map(|(name, _)| (name, name))));

    // A key of another protocol is known, and wrong beside this one. Beside none, its line says it all.
    for (owner, keys) in PROTOCOLS.iter().filter(|(owner, _)| name.is_some_and(|name| name != *owner)) {
        for value in keys.iter().filter_map(|key| table.get(key)) {
            let hint = format!("remove it, or write protocol = \"{owner}\"");
            value.problem(format!("`{}` belongs to protocol \"{owner}\"", value.path), hint);
        }
    }
    match name {
        None => {
            PROTOCOLS.iter().flat_map(|(_, keys)| keys.iter()).for_each(|key| drop(table.get(key)));
            None
        }
        Some("osc") => osc(table).map(Protocol::Osc),
        Some("natnet") => natnet(table).map(Protocol::Natnet),
        Some("freed") => Some(Protocol::Freed),
        Some("psn") => Some(Protocol::Psn),
        Some("opentrack") => opentrack(table).map(Protocol::Opentrack),
        Some("dtrack") => dtrack(table).map(Protocol::Dtrack),
        Some(_) => Some(Protocol::Lantern),
    }
}

fn osc(table: &Table<'_>) -> Option<Osc> {
    const PRESETS: [(&str, Osc); 3] = [("vmc", Osc::Vmc), ("vrchat", Osc::Vrchat), ("optitrack", Osc::Optitrack)];
    let [preset, address, arguments, axes, units] =
        ["preset", "address", "arguments", "axes", "units"].map(|key| table.get(key));
    let Some(preset) = preset else {
        let Some(address) = address else {
            let hint = "add preset = \"vmc\", \"vrchat\" or \"optitrack\", or address = \"/tracker/{id}\" and arguments = \
                        [\"x\", \"y\", \"z\", \"qx\", \"qy\", \"qz\", \"qw\"]";
            let value = table.get("protocol")?;
            value.problem("protocol \"osc\" has neither `preset` nor `address`: which messages hold poses?", hint);
            return None;
        };
        let arguments = match arguments {
            Some(arguments) => osc_arguments(&arguments),
            None => {
                let hint = "add arguments = [\"x\", \"y\", \"z\", \"qx\", \"qy\", \"qz\", \"qw\"], in the order of the messages";
                address.problem("there is an `address` and no `arguments`", hint);
                None
            }
        };
        let axes = axes.map_or(Some(Axes::default()), |value| value.choice(&AXES));
        let unit_m = units.map_or(Some(1.0), |value| value.choice(&UNITS_M));
        let pattern =
            OscPattern { address: osc_address(&address)?, arguments: arguments?, axes: axes?, unit_m: unit_m? };
        let ids = pattern.address.matches(OscPattern::ID).count();
        if ids + pattern.arguments.iter().filter(|argument| **argument == OscArgument::Id).count() > 1 {
            address.problem(
                "the body's id stands in two places",
                "leave one `{id}` in `address`, or \"id\" in `arguments`",
            );
            return None;
        }
        return Some(Osc::Free(pattern));
    };
    for value in [address, arguments, axes, units].into_iter().flatten() {
        let hint = "leave `preset` out to describe messages of your own";
        value.problem(format!("`{}` and a `preset` say the same thing twice", value.path), hint);
    }
    let names = PRESETS.map(|(name, _)| (name, name));
    let name = preset.choice(&names)?;
    PRESETS.into_iter().find(|(preset, _)| *preset == name).map(|(_, osc)| osc)
}

fn osc_address(value: &Value<'_>) -> Option<String> {
    let address = value.string()?;
    let is_part = |part: &str| {
        part == "*"
            || part == OscPattern::ID
            || (!part.is_empty() && part.chars().all(|c| c.is_ascii_graphic() && !"#*,/?[]{}".contains(c)))
    };
    let good = address.strip_prefix('/').is_some_and(|path| path.split('/').all(is_part)) && address.len() <= 200;
    if !good || address.matches(OscPattern::ID).count() > 1 {
        let hint =
            "write words between slashes; a part may be * for any word, and one may be {id}: \"/tracker/{id}/pose\"";
        value.problem(format!("`{}` is \"{address}\", which is no address", value.path), hint);
        return None;
    }
    Some(address)
}

fn osc_arguments(value: &Value<'_>) -> Option<Vec<OscArgument>> {
    let items = value.array("words")?;
    let words: Vec<_> = items.iter().map(|item| item.choice(&ARGUMENTS)).collect();
    let words = words.into_iter().collect::<Option<Vec<_>>>()?;
    let repeated = words.iter().enumerate().any(|(at, word)| *word != OscArgument::Skip && words[..at].contains(word));
    let all = |of: fn(usize) -> OscArgument, axes: std::ops::Range<usize>| {
        let there = axes.clone().filter(|axis| words.contains(&of(*axis))).count();
        (there == axes.len()).then_some(true).or((there == 0).then_some(false))
    };
    let whole = (all(OscArgument::Position, 0..3), all(OscArgument::Quaternion, 0..4), all(OscArgument::Turn, 0..3));
    match whole {
        (Some(position), Some(quaternion), Some(turns))
            if !repeated && words.len() <= 64 && (position || quaternion || turns) && !(quaternion && turns) =>
        {
            Some(words)
        }
        _ => {
            let hint =
                "take x, y and z, or one of qx, qy, qz, qw and rx, ry, rz, or both; each word once but for \"_\"";
            value.problem(format!("`{}` describes no pose", value.path), hint);
            None
        }
    }
}

fn natnet(table: &Table<'_>) -> Option<Natnet> {
    let version = match table.get("version") {
        None => Some(None),
        Some(value) => natnet_version(&value).map(Some),
    };
    let server = match table.get("server") {
        None => Some(None),
        Some(value) => server(&value).map(Some),
    };
    Some(Natnet { version: version?, server: server? })
}

fn natnet_version(value: &Value<'_>) -> Option<NatnetVersion> {
    let text = value.string_or_number()?;
    let version = text.split_once('.').and_then(|(major, minor)| {
        Some(NatnetVersion { major: major.parse().ok()?, minor: minor.split('.').next()?.parse().ok()? })
    });
    let version = version.filter(|version| version.is_known());
    if version.is_none() {
        let hint = "write the version of the stream: \"3.0\", \"3.1\", \"4.0\", \"4.1\"; or leave it out, and the server is asked";
        value.problem(format!("`{}` is {text}, which is no known version of NatNet", value.path), hint);
    }
    version
}

/// An address of a command port, with the usual port if it has none.
fn server(value: &Value<'_>) -> Option<SocketAddr> {
    let text = value.string()?;
    let bare = text.parse::<IpAddr>().map(|ip| SocketAddr::new(ip, NATNET_COMMAND_PORT));
    let address = text.parse::<SocketAddr>().or(bare).ok();
    let good =
        address.filter(|address| !address.ip().is_unspecified() && !address.ip().is_multicast() && address.port() != 0);
    if good.is_none() {
        let hint =
            "write the address of the computer that runs Motive, such as \"192.168.1.10\"; its command port is 1510";
        value.problem(format!("`{}` is \"{text}\", which is no server's address", value.path), hint);
    }
    good
}

fn opentrack(table: &Table<'_>) -> Option<Opentrack> {
    let Some(value) = table.get("signs") else { return Some(Opentrack::default()) };
    let signs = value.numbers_where("that is 1 or -1, for x, y, z, yaw, pitch and roll", |sign| sign.abs() == 1.0)?;
    Some(Opentrack { signs })
}

fn dtrack(table: &Table<'_>) -> Option<Dtrack> {
    let up = [("y", Axes::YUp), ("z", Axes::ZUp)];
    let axes = table.get("up").map_or(Some(Axes::ZUp), |value| value.choice(&up));
    Some(Dtrack { axes: axes? })
}

/// The id of a body as `protocol` says it, in the one way that it can be written; else why it is none.
pub(crate) fn body_id(protocol: &Protocol, text: &str) -> Result<String, &'static str> {
    let number = |largest: u64, hint: &'static str| {
        let number = text.parse::<u64>().ok().filter(|number| *number <= largest);
        number.map(|number| number.to_string()).ok_or(hint)
    };
    // What is written in digits is a number everywhere, so that 07 and 7 cannot be two bodies.
    let named = || number(u64::MAX, "").unwrap_or_else(|_| text.to_owned());
    match protocol {
        Protocol::Lantern => number(65_535, "protocol \"lantern\" numbers bodies from 0 to 65535"),
        Protocol::Freed => number(255, "protocol \"freed\" numbers cameras from 0 to 255"),
        Protocol::Natnet(_) => {
            number(0x7fff_ffff, "protocol \"natnet\" numbers bodies: take the streaming ID that Motive shows")
        }
        Protocol::Osc(Osc::Optitrack) => {
            number(0x7fff_ffff, "OptiTrack's bridges number bodies: take the streaming ID that Motive shows")
        }
        Protocol::Osc(Osc::Vrchat) => {
            let known = text == "head" || matches!(text.parse::<u8>(), Ok(1..=8));
            known.then(named).ok_or("VRChat's trackers are \"1\" to \"8\" and \"head\"")
        }
        Protocol::Dtrack(_) => match text.strip_prefix("flystick ") {
            Some(flystick) if flystick.parse::<u16>().is_ok() => {
                Ok(format!("flystick {}", flystick.trim_start_matches('0').max("0")))
            }
            _ => number(65_535, "protocol \"dtrack\" numbers bodies from 0, and Flysticks too: \"0\", \"flystick 0\""),
        },
        Protocol::Osc(_) | Protocol::Psn | Protocol::Opentrack(_) => Ok(named()),
    }
}

/// Whether the messages of `protocol` mean one body without saying which.
pub(crate) fn has_one_body(protocol: &Protocol) -> bool {
    match protocol {
        Protocol::Opentrack(_) => true,
        Protocol::Osc(Osc::Free(pattern)) => !pattern.tells_bodies_apart(),
        _ => false,
    }
}
