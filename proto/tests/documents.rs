//! `docs/protocol.md` against the types: what it shows is what travels.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]

use lantern_proto::request::SceneApply;
use lantern_proto::{
    Applied, Edit, Event, EventKind, ExportOpened, Hello, Op, Outcome, PosePacket, Reloaded, Reply, SceneGet,
    SnapshotHead, Status, Subscribed, parse_line_with,
};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

const DOCUMENT: &str = include_str!("../../docs/protocol.md");

/// Fenced blocks: what stands after the three ticks, and the text.
fn blocks() -> Vec<(&'static str, &'static str)> {
    // Every second part between fences is a block.
    DOCUMENT.split("\n```").skip(1).step_by(2).map(|block| block.split_once('\n').unwrap()).collect()
}

/// Nothing is lost or added when a value is read as a `T`: every field that is shown is one that there is. Numbers are
/// compared as numbers, since 1 is written back as 1.0.
#[track_caller]
fn is_exactly<T: DeserializeOwned + Serialize>(shown: &Value) {
    fn same(a: &Value, b: &Value) -> bool {
        match (a, b) {
            (Value::Number(a), Value::Number(b)) => a.as_f64() == b.as_f64(),
            (Value::Array(a), Value::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b)),
            (Value::Object(a), Value::Object(b)) => {
                a.len() == b.len() && a.iter().all(|(key, a)| b.get(key).is_some_and(|b| same(a, b)))
            }
            _ => a == b,
        }
    }
    let read: T = serde_json::from_value(shown.clone()).unwrap_or_else(|error| panic!("{error}: {shown}"));
    let written = serde_json::to_value(&read).unwrap();
    assert!(same(shown, &written), "shown:\n{shown}\nbut it is:\n{written}");
}

#[test]
fn requests_are_requests_and_replies_are_theirs() {
    let (mut asked, mut pairs) = (None, 0);
    for (fence, text) in blocks() {
        if fence == "json request" {
            // One has its edits elsewhere.
            let request = parse_line_with(text.trim().as_bytes(), Ok(b"[]".to_vec()));
            asked = Some(request.unwrap_or_else(|error| panic!("{error}: {text}")));
        } else if fence == "json reply" {
            let request = asked.take().expect("a reply without its request");
            let reply: Reply = serde_json::from_str(text).unwrap();
            assert_eq!(reply.id, Some(request.id));
            pairs += 1;
            let Outcome::Ok(ok) = &reply.outcome else { continue };
            match request.op {
                Op::Hello => is_exactly::<Hello>(ok),
                Op::Status => is_exactly::<Status>(ok),
                Op::SceneGet => is_exactly::<SceneGet>(ok),
                Op::SceneApply(SceneApply { .. }) => is_exactly::<Applied>(ok),
                Op::Snapshot(_) => is_exactly::<SnapshotHead>(ok),
                Op::ConfigReload => is_exactly::<Reloaded>(ok),
                Op::Subscribe(_) => is_exactly::<Subscribed>(ok),
                Op::ExportOpen(_) => is_exactly::<ExportOpened>(ok),
                Op::Pose(_) | Op::Pattern(_) | Op::ExportRelease(_) => assert_eq!(ok, &serde_json::json!({})),
            }
        }
    }
    assert!(asked.is_none() && pairs >= 5);
}

#[test]
fn edits_and_status_are_what_they_say() {
    let count = |wanted| blocks().iter().filter(|(fence, _)| *fence == wanted).count();
    assert_eq!((count("json edits"), count("json status"), count("json event")), (2, 1, 7));
    for (fence, text) in blocks() {
        match fence {
            "json edits" => drop(serde_json::from_str::<Vec<Edit>>(text).unwrap()),
            "json event" => is_exactly::<Event>(&serde_json::from_str(text).unwrap()),
            "json status" => is_exactly::<Status>(&serde_json::from_str(text).unwrap()),
            _ => {}
        }
    }
}

/// The first cells of a table's rows, up to the next heading.
fn first_cells(heading: &str) -> Vec<&'static str> {
    let section = DOCUMENT.split_once(heading).unwrap().1.split("\n#").next().unwrap();
    let row = |line: &'static str| line.strip_prefix("| `")?.split_once('`').map(|(cell, _)| cell);
    section.lines().filter_map(row).collect()
}

#[test]
fn every_op_layer_and_event_has_its_row() {
    let mut ops = first_cells("## The control socket\n");
    ops.sort_unstable();
    let mut names = Op::NAMES;
    names.sort_unstable();
    assert_eq!(ops, names);
    assert_eq!(first_cells("### Events\n")[..EventKind::ALL.len()], EventKind::ALL.map(EventKind::as_str));
    assert_eq!(first_cells("### Snapshots\n"), lantern_proto::Layer::ALL.map(lantern_proto::Layer::as_str));
}

#[test]
fn the_pose_is_the_one_that_is_described() {
    let shown = blocks().into_iter().find(|(fence, _)| *fence == "text pose").unwrap().1;
    let bytes: Vec<u8> = shown.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect();
    let described = PosePacket {
        body_id: 1,
        sequence: 7,
        measured_ns: None,
        position_m: Some([0.5, 1.7, 2.5]),
        orientation: Some([0.0, 0.0, 0.0, 1.0]),
        velocity_m_s: None,
    };
    assert_eq!(PosePacket::decode(&bytes), Ok(described));
    assert_eq!(bytes, described.encode());
}
