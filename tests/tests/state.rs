//! One daemon a socket, and what is there again after `kill -9`.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{
    fs,
    os::unix::fs::{PermissionsExt, symlink},
    sync::Arc,
    time::Duration,
};

use lantern_config::Config;
use lantern_proto::Edit;

use lantern_tests::{
    harness::{self, Daemon},
    lab,
};
use rustix::process::Signal;
use serde_json::{Value, json};
use tempfile::TempDir;

/// What the first release has kept, and the configuration that it ran on.
const VERSION_1: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../daemon/tests/state/version-1");

const SOON: Duration = Duration::from_secs(30);

fn folder() -> (Arc<TempDir>, String) {
    let folder = Arc::new(tempfile::tempdir().unwrap());
    let state = folder.path().join("state");
    (folder, lab::room_with(&format!("[daemon]\nstate_dir = {:?}\n", state.to_str().unwrap())))
}

fn kill(daemon: &mut Daemon) {
    daemon.signal(Signal::KILL).unwrap();
    assert!(!daemon.wait(SOON).unwrap().success());
    assert!(daemon.socket().exists(), "a killed daemon leaves its socket file");
}

#[test]
fn a_second_daemon_is_refused_and_a_dead_one_replaced() {
    let folder = Arc::new(tempfile::tempdir().unwrap());
    let mut first = Daemon::start_in(&folder, &lab::room()).unwrap();
    assert_eq!(fs::metadata(first.socket()).unwrap().permissions().mode() & 0o777, 0o660);
    let (config, socket) = (folder.path().join("lantern.toml"), first.socket().to_str().unwrap());
    let second = harness::run("lanternd", &["run", "-c", config.to_str().unwrap(), "--socket", socket]).unwrap();
    let said = String::from_utf8(second.stderr).unwrap();
    assert_eq!(second.status.code(), Some(1), "{said}");
    assert!(said.contains("another lanternd") && said.contains(socket) && said.contains("hint:"), "{said}");
    first.client().unwrap().apply(json!([lab::mirror()])).unwrap();

    kill(&mut first);
    let mut third = Daemon::start_in(&folder, &lab::room()).unwrap();
    // Without a state_dir nothing was kept.
    let applied = third.client().unwrap().ask_ok("scene.get", json!({})).unwrap();
    assert!(!applied.to_string().contains("metallic"), "{applied}");
    assert!(third.stop().unwrap().success());
    assert!(!third.socket().exists(), "a daemon takes its socket file with it");
}

#[test]
fn what_was_acknowledged_survives_a_kill() {
    let (folder, config) = folder();
    let mut daemon = Daemon::start_in(&folder, &config).unwrap();
    let mut client = daemon.client().unwrap();
    for x in [0.1, 0.2] {
        client.apply(json!([{"set": {"node": "ball", "translation_m": [x, 0.4, 0]}}])).unwrap();
    }
    let kept = client
        .ask_ok("scene.apply", json!({"edits": [lab::mirror(), {"add": {"node": "box", "uri": "lantern:cube"}}]}));
    let kept = kept.unwrap();
    assert_eq!(kept["durable"], true);
    let before = (client.ask_ok("scene.get", json!({})).unwrap(), client.snapshot("left", "color").unwrap());
    kill(&mut daemon);

    let mut daemon = Daemon::start_in(&folder, &config).unwrap();
    let mut client = daemon.client().unwrap();
    assert_eq!(client.ask_ok("scene.get", json!({})).unwrap(), before.0, "another scene is back");
    assert!(client.snapshot("left", "color").unwrap() == before.1, "another picture is back");
    assert_eq!(client.status().unwrap()["scene"]["revision"], kept["revision"]);

    // Numbers go on from there, and what was not asked to last does not.
    let next = client.apply(json!([{"remove": {"node": "box"}}])).unwrap();
    assert!(next["revision"].as_u64() > kept["revision"].as_u64(), "{next} after {kept}");
    assert_eq!(next["durable"], false);
    kill(&mut daemon);
    let daemon = Daemon::start_in(&folder, &config).unwrap();
    assert_eq!(daemon.client().unwrap().ask_ok("scene.get", json!({})).unwrap(), before.0);
}

#[test]
fn a_state_of_another_scene_or_a_broken_one_is_set_aside() {
    let (folder, config) = folder();
    let state = folder.path().join("state");
    let mut daemon = Daemon::start_in(&folder, &config).unwrap();
    let mut client = daemon.client().unwrap();
    let fresh = client.ask_ok("scene.get", json!({})).unwrap()["edits"].clone();
    let applied = client.ask_ok("scene.apply", json!({"edits": [lab::mirror()]})).unwrap();
    kill(&mut daemon);
    let kept = fs::read(state.join("scene.json")).unwrap();

    // The configuration's scene is another now: it is what the operator wants to see. Numbers go on all the same.
    let changed = config.replace("\"#406080\"", "\"#102030\"");
    let mut daemon = Daemon::start_in(&folder, &changed).unwrap();
    let told = daemon.client().unwrap().ask_ok("scene.get", json!({})).unwrap();
    assert!(!told.to_string().contains("metallic"), "{told}");
    assert!(told["revision"].as_u64() > applied["revision"].as_u64(), "{told} after {applied}");
    assert!(daemon.log().contains("set aside"), "{}", daemon.log());
    let aside = |name: &str| fs::read(state.join("aside").join(name)).unwrap();
    assert_eq!(aside("0001-scene-of-another-scene.json"), kept, "set aside is not lost");
    kill(&mut daemon);

    // Cut short; of a release to come; and one that was written well, by an earlier release, of a file that has gone since.
    let text = String::from_utf8(kept.clone()).unwrap();
    let later = text.replacen("\"version\":2", "\"version\":3", 1);
    assert_ne!(later, text);
    let mut gone: Value = serde_json::from_str(text.split_once('\n').unwrap().1).unwrap();
    gone["version"] = json!(1);
    gone["scene_fingerprint"] =
        json!(Config::load(&folder.path().join("lantern.toml")).unwrap().scene.fingerprint_with_nulls());
    gone["edits"] = json!([{"add": {"node": "gone", "uri": "/nowhere/gone.glb"}}]);
    for (name, broken) in [
        ("0002-scene-damaged.json", kept[..kept.len() / 2].to_vec()),
        ("0003-scene-of-a-later-release.json", later.into_bytes()),
        ("0004-scene-cannot-be-shown.json", gone.to_string().into_bytes()),
    ] {
        fs::write(state.join("scene.json"), &broken).unwrap();
        let mut daemon = Daemon::start_in(&folder, &changed).unwrap();
        let shown = daemon.client().unwrap().ask_ok("scene.get", json!({})).unwrap()["edits"].clone();
        assert_eq!(shown.as_array().unwrap().len(), fresh.as_array().unwrap().len(), "{name}: {shown}");
        assert!(daemon.log().contains("set aside"), "{}", daemon.log());
        assert_eq!(aside(name), broken);
        kill(&mut daemon);
    }
}

#[test]
fn a_state_of_the_first_release_is_shown() {
    let folder = Arc::new(tempfile::tempdir().unwrap());
    let (config, state) =
        (fs::read_to_string(VERSION_1.to_owned() + "/lantern.toml").unwrap(), folder.path().join("state"));
    let of_version_1 = fs::read(VERSION_1.to_owned() + "/scene.json").unwrap();
    fs::create_dir(&state).unwrap();
    fs::write(state.join("scene.json"), &of_version_1).unwrap();
    let kept: Value = serde_json::from_slice(&of_version_1).unwrap();
    let daemon = Daemon::start_in(&folder, &config).unwrap();
    let mut client = daemon.client().unwrap();
    let shown = client.ask_ok("scene.get", json!({})).unwrap();
    let edits = |value: &Value| serde_json::from_value::<Vec<Edit>>(value["edits"].clone()).unwrap();
    assert_eq!((edits(&shown), &shown["revision"]), (edits(&kept), &kept["revision"]));
    // The next is kept in today's form; nothing was set aside.
    client.ask_ok("scene.apply", json!({"edits": [{"remove": {"node": "box"}}]})).unwrap();
    assert!(
        fs::read_to_string(state.join("scene.json"))
            .unwrap()
            .starts_with("{\"format\":\"lantern scene\",\"version\":2,")
    );
    assert!(!state.join("aside").exists());
}

#[test]
fn a_reload_of_another_scene_ends_what_was_kept() {
    let (folder, config) = folder();
    let file = folder.path().join("lantern.toml");
    let mut daemon = Daemon::start_in(&folder, &config).unwrap();
    let mut client = daemon.client().unwrap();
    client.ask_ok("scene.apply", json!({"edits": [lab::mirror()]})).unwrap();
    for text in [config.replace("\"#406080\"", "\"#102030\""), config.clone()] {
        fs::write(&file, text).unwrap();
        client.ask_ok("config.reload", json!({})).unwrap();
    }
    let before = client.ask_ok("scene.get", json!({})).unwrap();
    assert!(!before.to_string().contains("metallic"), "{before}");
    kill(&mut daemon);
    let daemon = Daemon::start_in(&folder, &config).unwrap();
    assert_eq!(daemon.client().unwrap().ask_ok("scene.get", json!({})).unwrap(), before, "an older scene is back");
}

#[test]
fn what_cannot_be_kept_is_not_applied() {
    let (folder, config) = folder();
    let daemon = Daemon::start_in(&folder, &config).unwrap();
    let mut client = daemon.client().unwrap();
    let before =
        (client.ask_ok("scene.get", json!({})).unwrap()["edits"].clone(), client.snapshot("left", "color").unwrap());
    // A disk that has no room left, and a folder where the file should be: even root cannot write that.
    let fresh = folder.path().join("state/scene.json.new");
    for (obstacle, words) in [(true, "No space left"), (false, "scene.json.new")] {
        if obstacle {
            symlink("/dev/full", &fresh).unwrap();
        } else {
            fs::create_dir_all(&fresh).unwrap();
        }
        let refused = client.ask("scene.apply", json!({"edits": [lab::mirror()]})).unwrap().unwrap_err();
        assert_eq!(refused.code, "not-durable");
        assert!(refused.message.contains(words) && refused.message.contains("hint:"), "{refused}");
        assert_eq!(client.ask_ok("scene.get", json!({})).unwrap()["edits"], before.0);
        assert!(client.snapshot("left", "color").unwrap() == before.1, "another picture is shown");
    }
    client.apply(json!([lab::mirror()])).unwrap();
    // Room again: what is durable is kept again.
    fs::remove_dir(&fresh).unwrap();
    let applied =
        client.ask_ok("scene.apply", json!({"edits": [{"set": {"node": "ball", "visible": false}}]})).unwrap();
    assert_eq!(applied["durable"], true);
}

#[test]
fn a_state_dir_that_cannot_be_is_said_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("lab.toml");
    fs::write(folder.path().join("plain"), "").unwrap();
    fs::write(&file, lab::room_with("[daemon]\nstate_dir = \"plain/state\"\n")).unwrap();
    let socket = folder.path().join("s");
    let arguments = ["run", "-c", file.to_str().unwrap(), "--socket", socket.to_str().unwrap()];
    let output = harness::run("lanternd", &arguments).unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(1) && said.contains("plain/state") && said.contains("hint:"), "{said}");
}
