//! The control socket of a real daemon, op by op (CONTRACT, Socket protocol and Layers of a snapshot).
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{
    io::{ErrorKind, Read},
    process::Command,
    time::{Duration, Instant},
};

use glam::{DVec2, DVec3};
use lantern_tests::{
    client::Client,
    harness::Daemon,
    lab::{self, SIZE_PX},
    stage::Stand,
};
use serde_json::{Value, json};

/// The contract's example of a status, to the letter.
const STATUS: &str = r#"{"version": "…", "uptime_s": 1.0, "device": {"name": "…", "driver": "…", "kind": "cpu"},
 "scene": {"revision": 3, "nodes": 5, "triangles": 70000, "bytes": 123},
 "bodies": {"head": {"position_m": [0,1.7,2.5], "orientation": [0,0,0,1], "source": "optitrack", "age_ms": 4.1}},
 "trackers": {"optitrack": {"protocol": "lantern", "accepted": 100, "rejected": 2, "last_reject": "…", "rate_hz": 120.0}},
 "projectors": {"left": {"resolution_px": [1280,800], "output": "headless", "frames": 10, "missed": 0,
   "queue": {"family": 0, "index": 0, "shared": true}, "frame_ms": {"p50": 1.0, "p95": 2.0, "max": 3.0},
   "stages_ms": {"primary": 0.0, "secondary": 1.0, "composite": 0.2}, "pose_to_submit_ms": 0.4}}}"#;

/// Fails where `found` lacks a key of `example`, or has a value of another type there.
#[track_caller]
fn must_hold(example: &Value, found: &Value, path: &str) {
    if let Some(example) = example.as_object() {
        for (key, value) in example {
            must_hold(value, &found[key], &format!("{path}.{key}"));
        }
    } else {
        let alike = match example {
            Value::Number(_) => found.is_number(),
            // Nothing was rejected yet.
            Value::String(_) => found.is_string() || path.ends_with("last_reject"),
            Value::Array(items) => found.as_array().is_some_and(|found| found.len() == items.len()),
            _ => found.is_boolean() == example.is_boolean(),
        };
        assert!(alike, "{path} is {found} where the contract has {example}");
    }
}

#[test]
fn hello_and_status() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let mut client = daemon.client().unwrap();
    let hello = client.ask_ok("hello", json!({})).unwrap();
    assert_eq!(hello["protocol"], 1);
    assert!(hello["version"].as_str().is_some_and(|version| !version.is_empty()));
    assert_eq!(hello["projectors"], json!(["left", "right"]));

    let status = client.status().unwrap();
    must_hold(&serde_json::from_str(STATUS).unwrap(), &status, "status");
    assert_eq!(
        (&status["scene"]["nodes"], &status["projectors"]["right"]["resolution_px"]),
        (&json!(2), &json!([96, 64]))
    );
    assert!(status["scene"]["triangles"].as_u64().unwrap() > 1000 && status["scene"]["bytes"].as_u64().unwrap() > 1000);
    assert_eq!(status["bodies"]["head"]["position_m"], json!([0.5, 1.6, 2.5]));
    assert!(status["projectors"]["left"]["frames"].as_u64().unwrap() >= 1);
    assert!(
        status["projectors"]["left"]["stages_ms"]["primary"].as_f64().unwrap() > 0.0,
        "the first frame traced: {status}"
    );
    assert_eq!(status["device"]["validation_messages"], 0);
}

#[test]
fn a_scene_told_and_rebuilt_is_the_same() {
    let first = Daemon::start(&lab::room()).unwrap();
    let mut client = first.client().unwrap();
    let edits = json!([
        lab::mirror(),
        {"add": {"node": "box", "uri": "lantern:cube", "role": "raster", "translation_m": [0.7, 0.2, 0.3],
                 "rotation": [0, 0.6, 0, 0.8], "scale": [0.3, 0.4, 0.2]}},
        {"add": {"node": "ghost", "uri": "lantern:teapot", "role": "virtual", "translation_m": [-0.4, 0.2, 0.9]}},
        {"add": {"node": "cover", "uri": "lantern:quad", "role": "mask", "translation_m": [0.9, 0.01, -0.9]}},
        {"add": {"node": "hidden", "uri": "lantern:sphere"}},
        {"set": {"node": "hidden", "visible": false}},
        {"set": {"node": "floor", "translation_m": [0.1, 0, 0], "role": "prop"}},
        {"material": {"name": "quad", "base_color": "#80a0ff", "clearcoat": 0.5, "clearcoat_roughness": 0.2}},
        {"light": {"name": "lamp", "color": [1, 0.5, 0.25]}},
        {"light": {"name": "spot", "kind": "spot", "position_m": [-1, 2, 0], "direction": [1, -2, 0], "intensity": 30}},
        {"environment": {"color": [0.2, 0.1, 0.3]}},
    ]);
    let applied = client.apply(edits).unwrap();
    assert!(applied["revision"].as_u64().unwrap() >= 2 && applied["frame"].as_u64().unwrap() >= 2, "{applied}");
    let told = client.ask_ok("scene.get", json!({})).unwrap();
    assert_eq!(told["revision"], applied["revision"]);

    // A daemon that shows nothing yet, with the same projectors and the same eye.
    let empty = [lab::RENDER, lab::TRACKED, &lab::projectors()].join("\n");
    let second = Daemon::start(&empty).unwrap();
    let mut other = second.client().unwrap();
    assert_eq!(other.status().unwrap()["scene"]["nodes"], 0);
    let (_, black) = other.snapshot("left", "color").unwrap();
    other.apply(told["edits"].clone()).unwrap();
    assert_eq!(other.ask_ok("scene.get", json!({})).unwrap()["edits"], told["edits"]);
    for projector in ["left", "right"] {
        let shown = client.snapshot(projector, "color").unwrap();
        assert!(other.snapshot(projector, "color").unwrap() == shown, "{projector} shows another picture");
        assert_ne!(shown.1, black);
    }
}

/// What the layers hold of a floor seen from straight above, half of it beyond its edge.
#[test]
fn every_layer_of_a_known_scene() {
    let stand = Stand::new(DVec3::new(0.0, 2.0, 0.0), DVec3::ZERO, SIZE_PX);
    let config = [
        lab::RENDER,
        "[scene]\nenvironment = \"#808080\"\n[[scene.node]]\nname = \"other\"\nuri = \"lantern:cube\"\ntranslation_m = [5, -1, 0]\n\
         [[scene.node]]\nname = \"floor\"\nuri = \"lantern:quad\"\nscale = [10, 1, 10]\ntranslation_m = [5, 0, 0]\n",
        lab::TRACKED,
        &stand.toml("left"),
    ];
    let daemon = Daemon::start(&config.join("\n")).unwrap();
    let mut client = daemon.client().unwrap();
    let frustum = stand.frustum();
    let [width, height] = SIZE_PX.to_array().map(|side| side as usize);
    let (distance, depth) = (client.layer("left", "distance").unwrap(), client.layer("left", "depth").unwrap());
    let (node, weight) = (client.layer("left", "node").unwrap(), client.layer("left", "weight").unwrap());
    let radiance = client.layer("left", "radiance").unwrap();
    let color = client.png("left", "color").unwrap();
    for (layer, channels) in [(&distance, 1), (&depth, 1), (&node, 1), (&weight, 1), (&radiance, 3)] {
        assert_eq!((layer.width, layer.height, layer.channels), (width, height, channels));
    }
    assert_eq!(color.dimensions(), SIZE_PX.into());

    // Linear light of #808080, which a white matte thing under that sky gives back whole.
    let grey = 0.215_860_5;
    let (mut hits, mut misses) = (0, 0);
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let ray = frustum.ray(DVec2::new(x as f64 + 0.5, y as f64 + 0.5)).unwrap();
        let t_m = -ray.origin_m.y / ray.direction.y;
        let hit_m = ray.origin_m + ray.direction * t_m;
        let found = (distance.at(x, y)[0], depth.at(x, y)[0], node.at(x, y)[0]);
        let shown = color.get_pixel(x as u32, y as u32).0;
        if hit_m.x > 0.0 {
            hits += 1;
            let window_z = frustum.project(hit_m).unwrap().window_z;
            assert!((f64::from(found.0) - t_m).abs() < 1e-4 * t_m, "{x}, {y}: {found:?} beside {t_m} m");
            assert!((f64::from(found.1) - window_z).abs() < 2.0 / f64::from(1 << 24), "{x}, {y}: {found:?} {window_z}");
            assert_eq!(found.2, 1.0);
            assert!(radiance.at(x, y).iter().all(|c| (c - grey).abs() < 0.01), "{:?}", radiance.at(x, y));
            assert!((weight.at(x, y)[0] - 1.0).abs() < 1e-5, "one projector alone gives all the light");
            assert!(shown.iter().all(|c| c.abs_diff(0x80) <= 3), "{shown:?}");
        } else {
            misses += 1;
            assert_eq!(found, (f32::INFINITY, 1.0, -1.0), "{x}, {y}");
            assert_eq!(
                (radiance.at(x, y), shown),
                ([0.0; 3].as_slice(), [0; 3]),
                "{x}, {y}: nothing is there to light"
            );
        }
    }
    assert!(hits > 2000 && misses > 2000, "{hits} hits, {misses} misses");
    let room = client.png("left", "room").unwrap();
    assert!(room.pixels().any(|pixel| pixel.0 != [0; 3]), "the eye sees nothing");
    assert_eq!(client.ask_ok("snapshot", json!({"projector": "left"})).unwrap()["format"], "png");
}

#[test]
fn refusals_change_nothing_and_say_where() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let mut client = daemon.client().unwrap();
    let before = (client.ask_ok("scene.get", json!({})).unwrap(), lab::everything(&mut client, "left").unwrap());
    for (edits, code, at) in [
        (
            json!([{"set": {"node": "ball", "visible": false}}, {"remove": {"node": "bal"}}]),
            "unknown-node",
            "edits[1].node",
        ),
        (json!([{"add": {"node": "ball", "uri": "lantern:cube"}}]), "duplicate-node", "edits[0].node"),
        (json!([{"add": {"node": "x", "uri": "lantern:cub"}}]), "bad-uri", "edits[0].uri"),
        (json!([{"add": {"node": "x", "uri": "/etc/passwd"}}]), "outside-asset-roots", "edits[0].uri"),
        (json!([{"material": {"name": "bronze"}}]), "unknown-material", "edits[0].name"),
        (json!([{"material": {"name": "ball/sphere", "roughness": 7}}]), "bad-value", "edits[0].roughness"),
        (json!([{"light": {"name": "sun"}}]), "bad-value", "edits[0].kind"),
        (json!([{"light": {"name": "sun", "remove": true}}]), "unknown-light", "edits[0].name"),
        (json!([{"environment": {}}]), "bad-value", "edits[0].environment"),
        (json!([{"set": {"node": "ball", "scale": [1, 0, 1]}}]), "bad-transform", "edits[0].scale"),
        (json!([{"set": {"node": "ball", "rotation": [0, 0, 0, 2]}}]), "bad-transform", "edits[0].rotation"),
        (json!([{"set": {"node": "ball", "translation_m": [1e9, 0, 0]}}]), "bad-transform", "edits[0].translation_m"),
        (json!([{"set": {"node": "ball", "rôle": "prop"}}]), "bad-request", "edits[0].rôle"),
        (json!([{"set": {"node": "ball", "role": "ghost"}}]), "bad-request", "edits[0].role"),
        (
            json!([{"vertices": {"node": "ball", "mesh": 0, "positions_m": [[0, 0, 0]]}}]),
            "bad-value",
            "edits[0].positions_m",
        ),
        (json!([{"vertices": {"node": "ball", "mesh": "b", "positions_m": []}}]), "unknown-mesh", "edits[0].mesh"),
        (json!({}), "bad-request", "edits"),
    ] {
        let refused = client.ask("scene.apply", json!({"edits": edits})).unwrap().unwrap_err();
        assert_eq!((refused.code.as_str(), refused.at.as_str()), (code, at), "{edits}: {refused}");
    }
    for (op, parameters, code, at) in [
        ("pose", json!({"body": "hat", "position_m": [0, 0, 0]}), "unknown-body", "body"),
        ("pose", json!({"body": "head", "position_m": [0, 0]}), "bad-request", "position_m"),
        (
            "pose",
            json!({"body": "head", "position_m": [0, 0, 0], "orientation": [0, 0, 0, 2]}),
            "bad-value",
            "orientation",
        ),
        ("snapshot", json!({"projector": "middle"}), "unknown-projector", "projector"),
        ("snapshot", json!({"projector": "middle", "layer": "room"}), "unknown-projector", "projector"),
        ("snapshot", json!({"projector": "left", "layer": "smell"}), "bad-request", "layer"),
        ("status", json!({"verbose": true}), "bad-request", "verbose"),
        ("scene.burn", json!({}), "unknown-op", "op"),
        ("subscribe", json!({"events": ["smell"]}), "bad-request", "events[0]"),
        ("pattern", json!({"name": "grid", "projector": "middle"}), "unknown-projector", "projector"),
        ("pattern", json!({"name": "plaid"}), "bad-request", "name"),
    ] {
        let refused = client.ask(op, parameters.clone()).unwrap().unwrap_err();
        assert_eq!((refused.code.as_str(), refused.at.as_str()), (code, at), "{op} {parameters}: {refused}");
    }
    assert_eq!(client.ask_ok("scene.get", json!({})).unwrap(), before.0);
    assert!(lab::everything(&mut client, "left").unwrap() == before.1, "another picture is shown");
}

#[test]
fn lines_that_cannot_be_read_and_lines_too_long() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let mut client = daemon.client().unwrap();
    for line in [
        &b"{"[..],
        b"",
        b"[]",
        b"\xff\xfe",
        b"{\"op\": \"hello\"}",
        b"{\"id\": \"x\", \"op\": \"hello\"}",
        &[b'['; 9999],
    ] {
        client.send(&[line, b"\n"].concat()).unwrap();
        let reply = client.line().unwrap().unwrap();
        assert!(reply["id"].is_null() && reply["error"]["message"].is_string(), "{reply}");
    }

    // Replies keep the order of requests, slow ones before fast ones.
    let requests: String =
        ["snapshot\", \"projector\": \"left\", \"layer\": \"room", "status", "scene.get", "no.op", "hello"]
            .iter()
            .enumerate()
            .map(|(id, op)| format!("{{\"id\": {id}, \"op\": \"{op}\"}}\n"))
            .collect();
    let mut raw = std::os::unix::net::UnixStream::connect(daemon.socket()).unwrap();
    std::io::Write::write_all(&mut raw, requests.as_bytes()).unwrap();
    raw.shutdown(std::net::Shutdown::Write).unwrap();
    let mut all = Vec::new();
    raw.read_to_end(&mut all).unwrap();
    let text = String::from_utf8_lossy(&all);
    let places: Vec<_> = (0..5).map(|id| text.find(&format!("{{\"id\":{id},")).unwrap()).collect();
    assert!(places.is_sorted(), "{places:?}");

    // An oversized line gets its error, and then the end.
    let long = vec![b'x'; (1 << 20) + 1];
    // It may be cut off while it is still being sent.
    let _ = client.send(&long).and_then(|()| client.send(b"\n"));
    let reply = client.line().unwrap().unwrap();
    assert_eq!((&reply["id"], &reply["error"]["code"]), (&Value::Null, &json!("line-too-long")));
    assert_eq!(client.line().unwrap(), None);

    // The longest line that is allowed is read.
    let mut client = daemon.client().unwrap();
    let mut longest = br#"{"id": 7, "op": "hello""#.to_vec();
    longest.resize((1 << 20) - 1, b' ');
    client.send(&[&longest, &b"}\n"[..]].concat()).unwrap();
    assert_eq!(client.line().unwrap().unwrap()["id"], 7);
}

#[test]
fn more_clients_than_there_are_places_are_told() {
    let daemon = Daemon::start(&lab::room_with("[limits]\nmax_clients = 2\n")).unwrap();
    // Places are free again a moment after their clients have gone.
    let in_time = || {
        let started = Instant::now();
        loop {
            let mut client = daemon.client().unwrap();
            if client.status().is_ok() {
                return client;
            }
            assert!(started.elapsed() < Duration::from_secs(10), "no place is free");
        }
    };
    let (mut first, second) = (in_time(), in_time());
    let mut third = daemon.client().unwrap();
    let told = third.line().unwrap().unwrap();
    assert_eq!((&told["id"], &told["error"]["code"]), (&Value::Null, &json!("too-many-clients")));
    assert_eq!(third.line().unwrap(), None);
    assert!(first.status().is_ok());

    // Who goes leaves a place.
    drop(second);
    in_time();
}

#[test]
fn nobody_sees_a_room_without_a_viewer() {
    let daemon = Daemon::start(&lab::room().replace("drives = \"viewer\"", "")).unwrap();
    let mut client = daemon.client().unwrap();
    assert!(client.snapshot("left", "color").is_ok(), "a projector needs no viewer");
    let refused = client.ask("snapshot", json!({"projector": "left", "layer": "room"})).unwrap().unwrap_err();
    assert!(refused.code == "no-viewer" && refused.message.contains("hint:"), "{refused}");
}

#[test]
fn a_client_that_never_reads_is_dropped_while_others_go_on() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let mut deaf = daemon.client().unwrap();
    let request = b"{\"id\": 1, \"op\": \"snapshot\", \"projector\": \"left\", \"layer\": \"radiance\"}\n";
    for _ in 0..400 {
        // It may be dropped before it has asked for everything.
        if deaf.send(request).is_err() {
            break;
        }
    }
    let mut client = daemon.client().unwrap();
    let started = Instant::now();
    while !daemon.log().contains("does not read") {
        assert!(started.elapsed() < Duration::from_secs(20), "it is not dropped");
        let asked = Instant::now();
        client.status().unwrap();
        assert!(asked.elapsed() < Duration::from_secs(2), "another client waits for it");
    }
    // What it finds, when it looks at last, is what it was sent and then the end.
    let mut left = Vec::new();
    let mut stream = std::os::unix::net::UnixStream::connect(daemon.socket()).unwrap();
    stream.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
    let quiet = stream.read_to_end(&mut left).unwrap_err();
    assert!(matches!(quiet.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut), "new clients are served: {quiet}");
    assert!(loop_until_end(&mut deaf) < 400, "it was served to the end all the same");
}

/// Lines until the connection ends; snapshots' bytes are passed over.
fn loop_until_end(client: &mut Client) -> usize {
    let mut lines = 0;
    while let Ok(Some(head)) = client.line() {
        lines += 1;
        let bytes = head["ok"]["bytes"].as_u64().unwrap();
        if client.skip(bytes).is_err() {
            break;
        }
    }
    lines
}

#[test]
fn edits_that_no_line_could_hold_come_in_a_memfd() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/clients/large.py");
    let output = Command::new("python3").arg(script).arg(daemon.socket()).arg("30000").output().unwrap();
    let said = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap()).concat();
    let reply: Value = serde_json::from_str(&said).unwrap_or_else(|error| panic!("{error}: {said}"));
    assert_eq!(reply["ok"]["durable"], false, "{said}");
    let scene = daemon.client().unwrap().ask_ok("scene.get", json!({})).unwrap();
    let ball = scene["edits"].as_array().unwrap().iter().find(|edit| edit["add"]["node"] == "ball").unwrap();
    assert_eq!(ball["add"]["translation_m"], json!([1.0, 0.4, 0.0]), "not the last of them");
}
