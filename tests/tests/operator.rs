//! `lanternctl` on a real daemon: every command, as the operator's hand (CONTRACT, Programs).
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{
    fs,
    io::Write,
    process::{Output, Stdio},
};

use lantern_tests::{
    harness::{self, Daemon},
    image::FloatImage,
    lab,
};
use serde_json::{Value, json};

/// Exit code, standard output and standard error.
fn told(output: Output) -> (Option<i32>, Vec<u8>, String) {
    (output.status.code(), output.stdout, String::from_utf8(output.stderr).unwrap())
}

/// What a command prints that must be done.
#[track_caller]
fn done(daemon: &Daemon, arguments: &[&str]) -> String {
    let (code, stdout, stderr) = told(daemon.control(arguments).unwrap());
    assert_eq!((code, stderr.as_str()), (Some(0), ""), "{arguments:?}");
    String::from_utf8(stdout).unwrap()
}

/// What a command says that must fail with a code; it prints nothing else.
#[track_caller]
fn refused(daemon: &Daemon, arguments: &[&str], code: i32) -> String {
    let (found, stdout, stderr) = told(daemon.control(arguments).unwrap());
    assert_eq!((found, stdout.len()), (Some(code), 0), "{arguments:?}: {stderr}");
    stderr
}

fn json_of(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

#[test]
fn every_command() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let file = |name: &str| daemon.folder().path().join(name).to_str().unwrap().to_owned();

    // Looking.
    let text = done(&daemon, &["status"]);
    for words in ["2 nodes", "head", "optitrack", "left", "96 × 64", "headless"] {
        assert!(text.contains(words), "`{words}` in\n{text}");
    }
    assert_eq!(json_of(&done(&daemon, &["status", "--json"]))["scene"]["nodes"], 2);
    let watched = done(&daemon, &["--json", "watch", "--count", "2", "--interval", "0.05"]);
    assert_eq!(watched.lines().map(|line| json_of(line)["scene"]["nodes"].clone()).collect::<Vec<_>>(), [2, 2]);

    // The scene, there and back.
    let scene = done(&daemon, &["scene", "get"]);
    assert_eq!(json_of(&scene), json_of(&done(&daemon, &["scene", "get", "--json"]))["edits"]);
    fs::write(file("edits.json"), json!([{"remove": {"node": "floor"}}, {"remove": {"node": "ball"}}]).to_string())
        .unwrap();
    assert!(done(&daemon, &["scene", "apply", &file("edits.json")]).starts_with("revision 2, first shown by frame "));
    assert_eq!(json_of(&done(&daemon, &["status", "--json"]))["scene"]["nodes"], 0);
    let (nodes, rest): (Vec<Value>, Vec<Value>) =
        json_of(&scene).as_array().unwrap().iter().cloned().partition(|edit| edit.get("add").is_some());
    let mut apply = harness::command("lanternctl").unwrap();
    let mut apply = apply
        .args(["--socket", daemon.socket().to_str().unwrap(), "--json", "scene", "apply", "-"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    apply.stdin.take().unwrap().write_all(json!([nodes, rest].concat()).to_string().as_bytes()).unwrap();
    let applied = apply.wait_with_output().unwrap();
    assert_eq!(json_of(&String::from_utf8(applied.stdout).unwrap())["revision"], 3);
    assert_eq!(done(&daemon, &["scene", "get"]), scene);
    done(&daemon, &["load", "lantern:teapot", "--node", "pot", "--role", "virtual"]);
    assert!(done(&daemon, &["scene", "get"]).contains(r#""uri":"lantern:teapot","role":"virtual""#));

    // A pose, and what is seen from it.
    done(&daemon, &["pose", "head", "-1", "1.5", "-2e-1", "0", "-0.6", "0", "0.8"]);
    let head = json_of(&done(&daemon, &["status", "--json"]))["bodies"]["head"].clone();
    assert_eq!((&head["position_m"], &head["orientation"]), (&json!([-1.0, 1.5, -0.2]), &json!([0.0, -0.6, 0.0, 0.8])));
    for layer in ["color", "radiance", "distance", "depth", "node", "weight", "room"] {
        assert_eq!(done(&daemon, &["snapshot", "-p", "left", "--layer", layer, "-o", &file(layer)]), "");
        let bytes = fs::read(file(layer)).unwrap();
        let size = match layer {
            "color" | "room" => image::load_from_memory(&bytes).unwrap().into_rgb8().dimensions(),
            _ => FloatImage::from_exr(&bytes).map(|image| (image.width as u32, image.height as u32)).unwrap(),
        };
        assert_eq!(size, (96, 64), "{layer}");
    }
    assert!(done(&daemon, &["reload"]).contains("read again"));
    assert_eq!(
        json_of(&done(&daemon, &["reload", "--json"]))["revision"],
        json_of(&done(&daemon, &["status", "--json"]))["scene"]["revision"]
    );
}

#[test]
fn refusals_and_bad_usage() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let file = |name: &str| daemon.folder().path().join(name).to_str().unwrap().to_owned();
    let before = done(&daemon, &["scene", "get"]);
    fs::write(file("edits.json"), r#"[{"set": {"node": "ball", "visible": false}}, {"remove": {"node": "ghost"}}]"#)
        .unwrap();
    let said = refused(&daemon, &["scene", "apply", &file("edits.json")], 1);
    assert!(said.contains("unknown-node") && said.contains("edits[1].node") && said.contains("hint:"), "{said}");
    for (arguments, words) in [
        (&["load", "/etc/passwd", "--node", "x"][..], "asset_roots"),
        (&["load", "lantern:cub", "--node", "x"], "lantern:cube"),
        (&["pose", "hat", "0", "0", "0"], "there are hand, head"),
        (&["pose", "head", "0", "0", "0", "0", "0", "0", "2"], "norm 2"),
        (&["snapshot", "-p", "middle", "-o", "/tmp/never"], "there are left, right"),
        (&["pattern", "grid", "-p", "middle"], "there are left, right"),
    ] {
        let said = refused(&daemon, arguments, 1);
        assert!(said.contains(words), "{arguments:?}: {said}");
    }
    fs::write(file("lantern.toml"), "[scene").unwrap();
    assert!(refused(&daemon, &["reload"], 1).contains("lantern.toml:1:"));
    for arguments in [
        &[][..],
        &["dance"],
        &["pose", "head", "1", "2"],
        &["snapshot", "-p", "left"],
        &["snapshot", "-p", "left", "--layer", "smell", "-o", "x"],
        &["scene", "apply", "/nowhere/edits.json"],
        &["load", "a.glb"],
        &["pattern", "plaid"],
    ] {
        refused(&daemon, arguments, 2);
    }
    assert_eq!(done(&daemon, &["scene", "get"]), before);
}

#[test]
fn the_socket_is_looked_for_where_the_contract_says() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let folder = daemon.folder().path();
    let status = |variables: &[(&str, &str)], arguments: &[&str]| {
        let mut command = harness::command("lanternctl").unwrap();
        command.env_remove("XDG_RUNTIME_DIR").envs(variables.iter().copied()).args(arguments).arg("status");
        told(command.output().unwrap())
    };
    let socket = daemon.socket().to_str().unwrap();
    assert_eq!(status(&[("LANTERN_SOCKET", socket)], &[]).0, Some(0));
    assert_eq!(status(&[("LANTERN_SOCKET", "/nowhere/s")], &["--socket", socket]).0, Some(0));
    let (code, _, stderr) = status(&[("LANTERN_SOCKET", socket)], &["--socket", "/nowhere/s"]);
    assert!(code == Some(3) && stderr.contains("/nowhere/s") && stderr.contains("hint:"), "{stderr}");

    // Without a name, root's place is below /run, and everybody else's below the runtime folder.
    fs::create_dir(folder.join("lantern")).unwrap();
    std::os::unix::fs::symlink(socket, folder.join("lantern/lanternd.sock")).unwrap();
    let (code, _, stderr) = status(&[("XDG_RUNTIME_DIR", folder.to_str().unwrap())], &[]);
    if rustix::process::geteuid().is_root() {
        assert!(code == Some(0) || stderr.contains("/run/lantern/lanternd.sock"), "{stderr}");
    } else {
        assert_eq!(code, Some(0), "{stderr}");
    }
}
