//! Signals, and a configuration that is read again.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{
    fs,
    io::{BufRead, BufReader},
    process::Stdio,
    thread,
    time::{Duration, Instant},
};

use lantern_tests::{
    client::Client,
    harness::{self, Daemon},
    lab,
};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::json;

const SOON: Duration = Duration::from_secs(30);

/// Waits until the log says something.
#[track_caller]
fn said(daemon: &Daemon, what: &str, times: usize) {
    let started = Instant::now();
    while daemon.log().matches(what).count() < times {
        assert!(started.elapsed() < SOON, "`{what}` is not said:\n{}", daemon.log());
        thread::sleep(Duration::from_millis(10));
    }
}

fn write(daemon: &Daemon, config: &str) {
    fs::write(daemon.folder().path().join("lantern.toml"), config).unwrap();
}

#[test]
fn signals() {
    for signal in [Signal::TERM, Signal::INT] {
        let mut daemon = Daemon::start(&lab::room()).unwrap();
        // A client that is still there holds nobody up.
        let mut client = daemon.client().unwrap();
        client.status().unwrap();
        daemon.signal(signal).unwrap();
        let asked = Instant::now();
        assert_eq!(daemon.wait(SOON).unwrap().code(), Some(0), "{signal:?}");
        assert!(asked.elapsed() < Duration::from_secs(5), "{signal:?} took {:?}", asked.elapsed());
        assert!(!daemon.socket().exists());
    }
}

#[test]
fn a_signal_while_it_starts_ends_it_as_well() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("lab.toml");
    fs::write(&file, lab::room()).unwrap();
    let mut command = harness::command("lanternd").unwrap();
    command.args(["run", "-c", file.to_str().unwrap(), "--socket", folder.path().join("s").to_str().unwrap()]);
    let mut child = command.stderr(Stdio::piped()).spawn().unwrap();
    let log = BufReader::new(child.stderr.take().unwrap());
    let mut rest = String::new();
    for line in log.lines().map_while(Result::ok) {
        // The device is open, and the shaders of the first frame are being compiled.
        if line.contains("rendering") {
            kill_process(Pid::from_child(&child), Signal::TERM).unwrap();
        }
        rest = line;
    }
    assert_eq!(child.wait().unwrap().code(), Some(0), "{rest}");
    assert!(rest.contains("stopping"), "{rest}");
}

#[test]
fn a_hang_up_reloads_and_a_bad_file_changes_nothing() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let mut client = daemon.client().unwrap();
    client.apply(json!([lab::mirror()])).unwrap();
    let before = (client.ask_ok("scene.get", json!({})).unwrap(), lab::everything(&mut client, "left").unwrap());
    write(&daemon, &lab::room().replace("samples = 1", "samples = 3"));
    daemon.signal(Signal::HUP).unwrap();
    said(&daemon, "no square number", 1);
    assert_eq!(client.ask_ok("scene.get", json!({})).unwrap(), before.0);
    assert!(lab::everything(&mut client, "left").unwrap() == before.1, "another picture is shown");

    // Another resolution, another projector: what clients have made of an unchanged scene section stays.
    let smaller = lab::room().replacen("[96, 64]", "[48, 32]", 1).replace("name = \"right\"", "name = \"top\"");
    write(&daemon, &smaller);
    daemon.signal(Signal::HUP).unwrap();
    said(&daemon, "engine: reloaded", 1);
    assert_eq!(client.ask_ok("scene.get", json!({})).unwrap()["edits"], before.0["edits"]);
    assert_eq!(client.ask_ok("hello", json!({})).unwrap()["projectors"], json!(["left", "top"]));
    assert_eq!(client.png("left", "color").unwrap().dimensions(), (48, 32));
    assert!(client.snapshot("top", "color").is_ok());
    assert_eq!(client.ask("snapshot", json!({"projector": "right"})).unwrap().unwrap_err().code, "unknown-projector");
    let status = client.status().unwrap();
    assert_eq!(status["projectors"]["left"]["resolution_px"], json!([48, 32]));
    assert!(status["projectors"]["top"]["frames"].as_u64().unwrap() >= 1, "{status}");

    // And back: the picture is that of before.
    write(&daemon, &lab::room());
    client.ask_ok("config.reload", json!({})).unwrap();
    assert!(lab::everything(&mut client, "left").unwrap() == before.1, "there and back is another picture");
}

#[test]
fn what_a_reload_changes() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let mut client = daemon.client().unwrap();
    let mut answer = |config: &str| {
        write(&daemon, config);
        Client::ask_ok(&mut client, "config.reload", json!({})).unwrap()
    };
    // Another scene section replaces what there is, with what clients made of it.
    let first = answer(&lab::room());
    let changed = lab::room().replace("#406080", "#806040");
    let second = answer(&changed);
    assert!(second["revision"].as_u64() > first["revision"].as_u64(), "{first} {second}");

    // Trackers, bodies and asset roots are followed too.
    let roots = format!("[daemon]\nasset_roots = [{:?}]\n", daemon.folder().path().to_str().unwrap());
    let other = lab::room_with(&roots).replace("\"optitrack\"", "\"vicon\"").replace("0.5, 1.6, 2.5", "-2, 1, 2");
    answer(&(other.replace("name = \"hand\"", "name = \"foot\"").replace("\"2\" = \"hand\"", "\"2\" = \"foot\"")));
    let status = client.status().unwrap();
    assert!(status["trackers"].get("vicon").is_some() && status["trackers"].get("optitrack").is_none(), "{status}");
    assert!(status["bodies"].get("foot").is_some() && status["bodies"].get("hand").is_none(), "{status}");
    assert_eq!(status["bodies"]["head"]["position_m"], json!([-2.0, 1.0, 2.0]));
    let refused =
        client.ask("scene.apply", json!({"edits": [{"add": {"node": "x", "uri": "x.glb"}}]})).unwrap().unwrap_err();
    assert_eq!(refused.code, "bad-uri", "the root is allowed now: {refused}");
}

#[test]
fn a_reload_of_the_same_file_renders_nothing() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let mut client = daemon.client().unwrap();
    let frames = client.status().unwrap()["projectors"]["left"]["frames"].clone();
    client.ask_ok("config.reload", json!({})).unwrap();
    assert_eq!(client.status().unwrap()["projectors"]["left"]["frames"], frames);
}
