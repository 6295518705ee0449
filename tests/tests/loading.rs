//! Loading while the show goes on.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{fs, sync::Arc, thread};

use lantern_tests::{harness::Daemon, lab, models};
use serde_json::json;

/// Rounds of looking that must fit into the loading of a few hundred thousand triangles: it takes long enough for several.
const ROUNDS: usize = 1;

#[test]
fn frames_bodies_and_small_edits_go_on_while_a_large_file_is_loaded() {
    let folder = Arc::new(tempfile::tempdir().unwrap());
    fs::write(folder.path().join("hills.glb"), models::hills(400, false)).unwrap();
    let tables = format!("[daemon]\nasset_roots = [{:?}]\n", folder.path().to_str().unwrap());
    let config = lab::room_with(&tables).replace("name = \"hand\"", "name = \"hand\"\ndrives = \"node:ball\"");
    let daemon = Daemon::start_in(&folder, &config).unwrap();
    let mut client = daemon.client().unwrap();
    client.apply(json!([lab::mirror()])).unwrap();
    let frames = |client: &mut lantern_tests::client::Client| {
        client.status().unwrap()["projectors"]["left"]["frames"].as_u64().unwrap()
    };

    let (mut rounds, mut pictures) = (0, vec![client.snapshot("left", "color").unwrap().1]);
    let (mut nodes, mut shown) = (client.layer("left", "node").unwrap(), frames(&mut client));
    thread::scope(|scope| {
        let loading = scope.spawn(|| {
            let hills = json!({"node": "hills", "uri": "hills.glb", "translation_m": [0, 0.1, 1]});
            daemon.client().unwrap().apply(json!([{"add": hills}])).unwrap()
        });
        for step in 1.. {
            // The eye moves, and the mirror shows it; the hand moves, and its ball follows.
            client.pose("head", [0.5 - 0.01 * f64::from(step), 1.6, 2.5]).unwrap();
            let picture = client.snapshot("left", "color").unwrap().1;
            client.pose("hand", [0.5 * f64::from(step % 2), 0.4, 0.0]).unwrap();
            let after = client.layer("left", "node").unwrap();
            // Another client's edit is answered meanwhile.
            let roughness = 0.01 * f64::from(step % 4);
            let edit = json!({"material": {"name": "floor/quad", "roughness": 0.9 + roughness}});
            client.apply(json!([edit])).unwrap();
            let count = frames(&mut client);
            if loading.is_finished() {
                break;
            }
            assert!(count >= shown + 3, "{} frames for two poses and an edit", count - shown);
            assert!(pictures.last() != Some(&picture), "the eye moved, and the mirror shows the same");
            assert_ne!(after, nodes, "the hand moved, and its ball did not");
            pictures.push(picture);
            (nodes, shown, rounds) = (after, count, rounds + 1);
        }
        loading.join().unwrap();
    });
    assert!(rounds >= ROUNDS, "{rounds} rounds while the file was loaded");
    let status = client.status().unwrap();
    assert_eq!((&status["scene"]["nodes"], &status["scene"]["triangles"]), (&json!(3), &json!(320_000 + 2 + 20_448)));
}
