//! Loading while the show goes on, structures that were built before, and meshes that change their shape.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{
    fs,
    path::{Path, PathBuf},
    sync::Arc,
    thread,
    time::Duration,
};

use lantern_tests::{
    client::Client,
    harness::{self, Daemon},
    lab, models,
};
use rustix::process::Signal;
use serde_json::{Value, json};

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
    let frames = |client: &mut Client| client.status().unwrap()["projectors"]["left"]["frames"].as_u64().unwrap();

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

/// A configuration whose scene has two structures worth keeping, one of a file and one of a shape.
fn with_hills(folder: &Path, tables: &str) -> String {
    fs::write(folder.join("hills.glb"), models::hills(20, true)).unwrap();
    let node = "[[scene.node]]\nname = \"hills\"\nuri = \"hills.glb\"\ntranslation_m = [0, 0.1, 1]\n";
    lab::room_with(&format!("[daemon]\nasset_roots = [{:?}]\n{tables}", folder.to_str().unwrap())) + node
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

#[test]
fn a_second_start_builds_nothing_and_trusts_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let config = folder.path().join("lantern.toml");
    fs::write(&config, with_hills(folder.path(), &format!("state_dir = {:?}\n", state.to_str().unwrap()))).unwrap();
    let check = |place: &str, at: Option<&Path>| {
        let mut command = harness::command("lanternd").unwrap();
        for place in ["CACHE_DIRECTORY", "XDG_CACHE_HOME", "HOME"] {
            command.env_remove(place);
        }
        command.args(["check", "--json", "-c"]).arg(&config).envs(at.map(|at| (place, at)));
        let output = command.output().unwrap();
        assert!(output.status.success(), "{output:?}");
        let said: Value = serde_json::from_slice(&output.stdout).unwrap();
        [&said["structures"]["built"], &said["structures"]["cached"]].map(|count| count.as_u64().unwrap())
    };
    let cache = folder.path().join("cache");
    for (place, at, kept) in [
        ("CACHE_DIRECTORY", Some(&*cache), cache.join("structures")),
        ("XDG_CACHE_HOME", Some(&*cache), cache.join("lantern/structures")),
        ("", None, state.join("cache/structures")),
    ] {
        assert_eq!(check(place, at), [2, 0], "{place}");
        assert_eq!(check(place, at), [0, 2], "{place}");
        // One of them is torn, the other rotten.
        let kept = files(&kept);
        let whole = kept.iter().map(|path| fs::read(path).unwrap()).collect::<Vec<_>>();
        fs::write(&kept[0], &whole[0][..whole[0].len() / 2]).unwrap();
        let mut rotten = whole[1].clone();
        rotten[200] ^= 1;
        fs::write(&kept[1], rotten).unwrap();
        assert_eq!(check(place, at), [2, 0], "{place}: what is not whole was taken");
        assert_eq!(check(place, at), [0, 2], "{place}");
        assert!(kept.iter().zip(&whole).all(|(path, whole)| fs::read(path).unwrap() == *whole));
    }
}

#[test]
fn a_daemon_says_what_it_has_built() {
    let folder = Arc::new(tempfile::tempdir().unwrap());
    let config = with_hills(folder.path(), "");
    for said in ["structures built=2 cached=0", "structures built=0 cached=2"] {
        let mut daemon = Daemon::start_in(&folder, &config).unwrap();
        assert!(daemon.log().contains(said), "not {said}: {}", daemon.log());
        assert!(daemon.stop().unwrap().success());
    }
}

#[test]
fn vertices_move_as_their_node_would_and_survive_a_kill() {
    let folder = Arc::new(tempfile::tempdir().unwrap());
    let state = folder.path().join("state");
    let config = with_hills(folder.path(), &format!("state_dir = {:?}\n", state.to_str().unwrap()));
    let mut daemon = Daemon::start_in(&folder, &config).unwrap();
    let mut client = daemon.client().unwrap();
    let before = client.layer("left", "distance").unwrap();
    let set = |y: f64| json!([{"set": {"node": "hills", "translation_m": [0, y, 1]}}]);
    client.apply(set(0.35)).unwrap();
    let moved = client.layer("left", "distance").unwrap();
    client.apply(set(0.1)).unwrap();
    assert_eq!(client.layer("left", "distance").unwrap(), before);

    // Every vertex a quarter of a metre up, which no binary fraction rounds.
    let place = |i: u32| models::hill_m(i % 21, i / 21, 20);
    let up: Vec<[f32; 3]> = (0..21 * 21).map(place).map(|[x, y, z]| [x, y + 0.25, z]).collect();
    let edit = json!([{"vertices": {"node": "hills", "mesh": "hills", "positions_m": up}}]);
    client.ask_ok("scene.apply", json!({"edits": edit})).unwrap();
    let lifted = client.layer("left", "distance").unwrap();
    let alike = |a: &[f32], b: &[f32]| a.iter().zip(b).filter(|(a, b)| (**a - **b).abs() < 1e-4 || a == b).count();
    let (as_moved, all) = (alike(&lifted.values, &moved.values), lifted.values.len());
    assert!(
        as_moved > all - all / 200 && alike(&lifted.values, &before.values) < all - all / 20,
        "{as_moved} of {all}"
    );

    let shown = (client.ask_ok("scene.get", json!({})).unwrap(), lab::everything(&mut client, "left").unwrap());
    assert_eq!(shown.0["edits"].as_array().unwrap().iter().filter(|edit| edit.get("vertices").is_some()).count(), 1);
    daemon.signal(Signal::KILL).unwrap();
    daemon.wait(Duration::from_secs(30)).unwrap();
    let daemon = Daemon::start_in(&folder, &config).unwrap();
    let mut client = daemon.client().unwrap();
    assert_eq!(client.ask_ok("scene.get", json!({})).unwrap(), shown.0);
    assert!(lab::everything(&mut client, "left").unwrap() == shown.1, "another picture is shown");

    // The file's own vertices are its own mesh again.
    let own: Vec<[f32; 3]> = (0..21 * 21).map(place).collect();
    client.apply(json!([{"vertices": {"node": "hills", "mesh": 0, "positions_m": own}}])).unwrap();
    assert_eq!(client.layer("left", "distance").unwrap(), before);
    assert!(!client.ask_ok("scene.get", json!({})).unwrap().to_string().contains("vertices"));
}
