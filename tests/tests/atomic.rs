//! All of an edit list or nothing, whoever looks and whenever.

use std::{
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::{Duration, Instant},
};

use lantern_tests::{harness::Daemon, lab};
use serde_json::json;

/// How long the readers look on.
const HAMMERED: Duration = Duration::from_secs(3);

#[test]
fn a_list_whose_last_edit_is_wrong_changes_nothing() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let mut client = daemon.client().unwrap();
    let before = (client.ask_ok("scene.get", json!({})).unwrap(), lab::everything(&mut client, "right").unwrap());
    let good = json!([
        {"add": {"node": "box", "uri": "lantern:cube"}},
        {"remove": {"node": "floor"}},
        {"set": {"node": "ball", "translation_m": [0.3, 0.4, 0]}},
        lab::mirror(),
        {"light": {"name": "lamp", "remove": true}},
        {"light": {"name": "sun", "kind": "directional", "direction": [0, -1, 0]}},
        {"environment": {"color": [1, 0, 0]}},
    ]);
    for bad in [
        json!({"remove": {"node": "ghost"}}),
        json!({"add": {"node": "box", "uri": "lantern:cube"}}),
        json!({"set": {"node": "box", "scale": [0, 0, 0]}}),
        json!({"material": {"name": "ghost"}}),
        json!({"light": {"name": "lamp", "remove": true}}),
        json!({"environment": {"uri": "lantern:nowhere"}}),
        json!({"add": {"node": "far", "uri": "nowhere.glb"}}),
    ] {
        let mut edits = good.as_array().unwrap().clone();
        edits.push(bad.clone());
        let refused = client.ask("scene.apply", json!({"edits": edits})).unwrap().unwrap_err();
        assert!(refused.at.starts_with("edits[7]"), "{bad}: {refused}");
        assert_eq!(client.ask_ok("scene.get", json!({})).unwrap(), before.0, "{bad}");
    }
    assert!(lab::everything(&mut client, "right").unwrap() == before.1, "another picture is shown");
    // The others alone are good.
    client.apply(good).unwrap();
    assert_ne!(client.ask_ok("scene.get", json!({})).unwrap(), before.0);
}

#[test]
fn readers_never_see_half_of_a_list() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let done = AtomicBool::new(false);
    let pair = |x: f64| json!({"translation_m": [x, 0.2, 0.9], "scale": [0.3, 0.3, 0.3], "uri": "lantern:cube"});
    thread::scope(|scope| {
        // Two boxes come and go together.
        let writer = scope.spawn(|| {
            let mut client = daemon.client().unwrap();
            let mut rounds = 0;
            while !done.load(Ordering::Relaxed) {
                let [mut a, mut b] = [pair(-0.5), pair(0.5)];
                (a["node"], b["node"]) = (json!("a"), json!("b"));
                client.apply(json!([{"add": a}, {"add": b}])).unwrap();
                client.apply(json!([{"remove": {"node": "a"}}, {"remove": {"node": "b"}}])).unwrap();
                rounds += 1;
            }
            rounds
        });
        let readers = [
            scope.spawn(|| {
                let mut client = daemon.client().unwrap();
                let (mut with, mut without) = (0, 0);
                while !done.load(Ordering::Relaxed) {
                    match client.status().unwrap()["scene"]["nodes"].as_u64().unwrap() {
                        2 => without += 1,
                        4 => with += 1,
                        nodes => panic!("status saw {nodes} nodes"),
                    }
                    // Other tests share the machine.
                    thread::sleep(Duration::from_millis(1));
                }
                (with, without)
            }),
            scope.spawn(|| {
                let mut client = daemon.client().unwrap();
                let (mut with, mut without) = (0, 0);
                while !done.load(Ordering::Relaxed) {
                    let nodes = client.layer("left", "node").unwrap();
                    let sees = |node: f32| nodes.values.contains(&node);
                    match (sees(2.0), sees(3.0)) {
                        (true, true) => with += 1,
                        (false, false) => without += 1,
                        half => panic!("a snapshot saw {half:?} of the two boxes"),
                    }
                }
                (with, without)
            }),
        ];
        let started = Instant::now();
        while started.elapsed() < HAMMERED && readers.iter().all(|reader| !reader.is_finished()) {
            thread::sleep(Duration::from_millis(20));
        }
        done.store(true, Ordering::Relaxed);
        let rounds = writer.join().unwrap();
        let seen = readers.map(|reader| reader.join().unwrap());
        assert!(rounds > 3, "{rounds} rounds");
        assert!(seen.iter().all(|(with, without)| *with > 0 && *without > 0), "the readers saw no change: {seen:?}");
    });
}
