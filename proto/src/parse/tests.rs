use super::*;
use crate::edit::{Add, Edit, Role};
use crate::request::{Layer, SceneApply};
use proptest::prelude::*;

fn refusal(line: &str) -> (Option<u64>, String, Option<String>, String) {
    let Refusal { id, error } = parse_line(line.as_bytes()).unwrap_err();
    (id.and_then(|id| id.as_u64()), error.code, error.at, error.message)
}

fn at(line: &str) -> String {
    let (id, code, at, message) = refusal(line);
    assert_eq!((id, code.as_str()), (Some(7), "bad-request"), "{line}: {message}");
    at.unwrap_or_default()
}

#[test]
fn reads_each_op() {
    for op in ["hello", "status", "scene.get", "config.reload"] {
        let request = parse_line(format!(r#"{{"id": 7, "op": "{op}"}}"#).as_bytes()).unwrap();
        assert_eq!(serde_json::to_value(&request).unwrap(), serde_json::json!({"id": 7, "op": op}));
    }
    let request = parse_line(br#"{"id": 7, "op": "snapshot", "projector": "left", "layer": "node"}"#).unwrap();
    assert!(matches!(request.op, Op::Snapshot(ref s) if s.projector == "left" && s.layer == Layer::Node));
    for line in [
        r#"{"id": 7, "op": "pose", "body": "head", "position_m": [0, 1.5, 2]}"#,
        r#"{"id": 7, "op": "pose", "body": "head", "position_m": [0, 1.5, 2], "orientation": [0, 0, 0, 1]}"#,
        r#"{"id": 7, "op": "subscribe", "events": ["frame", "pose", "scene", "tracker", "output"]}"#,
        r#"{"id": 7, "op": "pattern", "name": "grid"}"#,
        r#"{"id": 7, "op": "pattern", "name": "off", "projector": "left"}"#,
        r#"{"op": "scene.apply", "edits": [], "durable": false, "id": 7}"#,
    ] {
        parse_line(line.as_bytes()).unwrap_or_else(|e| panic!("{line}: {e}"));
    }
}

#[test]
fn durable_is_the_default_and_every_edit_is_read() {
    let line = br##"{"id": 1, "op": "scene.apply", "edits": [
        {"add": {"node": "a", "uri": "a.glb", "role": "virtual", "translation_m": [0, 1, 2]}},
        {"remove": {"node": "b"}},
        {"set": {"node": "a", "visible": false, "rotation": [0, 0, 0, 1]}},
        {"material": {"name": "m", "base_color": [1, 1, 1], "ior": 1.5, "emissive": "#ff0000"}},
        {"light": {"name": "sun", "kind": "directional", "direction": [0, -1, 0], "intensity": 3}},
        {"light": {"name": "sun", "remove": true}},
        {"environment": {"color": [0, 0, 0]}},
        {"environment": {"uri": "x.hdr"}},
        {"vertices": {"node": "a", "mesh": 0, "positions_m": [[0, 0, 0]]}}]}"##;
    let Op::SceneApply(SceneApply { edits, durable }) = parse_line(line).unwrap().op else { panic!("another op") };
    assert!(durable);
    assert_eq!(edits.len(), 9);
    let add = Add {
        node: "a".into(),
        uri: "a.glb".into(),
        role: Some(Role::Virtual),
        translation_m: Some([0.0, 1.0, 2.0]),
        ..Add::default()
    };
    assert_eq!(edits[0], Edit::Add(add));
}

#[test]
fn places_are_named() {
    let apply =
        |edits: &str| format!(r#"{{"id": 7, "op": "scene.apply", "edits": [{{"remove": {{"node": "x"}}}}, {edits}]}}"#);
    assert_eq!(at(&apply(r#"{"remove": {}}"#)), "edits[1].node");
    assert_eq!(at(&apply(r#"{"remove": {"node": 4}}"#)), "edits[1].node");
    assert_eq!(at(&apply(r#"{"remove": {"node": "x", "nod": 1}}"#)), "edits[1].nod");
    assert_eq!(at(&apply(r#"{"set": {"node": "x", "scale": [1, "2", 3]}}"#)), "edits[1].scale[1]");
    assert_eq!(at(&apply(r#"{"set": {"node": "x", "scale": [1, 2]}}"#)), "edits[1].scale");
    assert_eq!(at(&apply(r#"{"set": {"node": "x", "role": "ghost"}}"#)), "edits[1].role");
    assert_eq!(at(&apply(r#"{"move": {"node": "x"}}"#)), "edits[1]");
    assert_eq!(at(&apply("3")), "edits[1]");
    assert_eq!(at(r#"{"id": 7, "op": "scene.apply"}"#), "edits");
    assert_eq!(at(r#"{"id": 7, "op": "snapshot", "projector": "left", "layer": "colour"}"#), "layer");
    assert_eq!(at(r#"{"id": 7, "op": "pose", "body": "head"}"#), "position_m");
    assert_eq!(at(r#"{"id": 7, "op": "status", "verbose": true}"#), "verbose");
    assert_eq!(at(r#"{"id": 7}"#), "op");
    assert_eq!(at(r#"{"id": 7, "op": 3}"#), "op");
}

#[test]
fn unknown_ops_and_lines_that_are_no_requests() {
    let (id, code, at, message) = refusal(r#"{"id": 7, "op": "dance"}"#);
    assert_eq!((id, code.as_str(), at.as_deref()), (Some(7), "unknown-op", Some("op")));
    assert!(message.contains("scene.apply"), "{message}");

    for line in ["", "{", "{\"id\": 7", "nonsense", "{\"id\": 7, \"op\": \"hello\"} x", "{\"id\": 7, \"x\": 1e999}"] {
        let (id, code, ..) = refusal(line);
        assert_eq!((id, code.as_str()), (None, "bad-json"), "{line}");
    }
    for line in ["[]", "3", "null", "{}", r#"{"id": "7", "op": "hello"}"#] {
        let (id, code, ..) = refusal(line);
        assert_eq!((id, code.as_str()), (None, "bad-request"), "{line}");
    }
    assert_eq!(parse_line(b"{\"id\": 1, \"op\": \"\xff\"}").unwrap_err().error.code, "bad-json");
    // Nesting is bounded, so that no line can exhaust the stack.
    assert_eq!(refusal(&"[".repeat(100_000)).1, "bad-json");
}

#[test]
fn ids_come_back_as_they_came() {
    for id in ["0", "18446744073709551615", "-3", "1.5"] {
        let request = parse_line(format!(r#"{{"id": {id}, "op": "hello"}}"#).as_bytes()).unwrap();
        let reply = Reply { id: Some(request.id), outcome: Outcome::Ok(Value::Object(Map::new())) };
        assert_eq!(serde_json::to_string(&reply).unwrap(), format!(r#"{{"id":{id},"ok":{{}}}}"#));
    }
    let refused = Reply::from(parse_line(b"{").unwrap_err());
    assert!(serde_json::to_string(&refused).unwrap().starts_with(r#"{"id":null,"error":{"code":"bad-json""#));
}

proptest! {
    /// No bytes can make it panic, and what it refuses it refuses with a code.
    #[test]
    fn any_bytes_are_answered(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        if let Err(refusal) = parse_line(&bytes) {
            prop_assert!(!refusal.error.code.is_empty());
        }
    }
}
