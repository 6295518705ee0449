//! `lanternctl` from outside, against the real socket over an engine without a device.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]

mod support;

use lantern_proto::event::{FrameEvent, SceneEvent, ShownPose};
use lantern_proto::{Edit, Event, EventKind, Layer, Pattern, PatternRequest, Role};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Lines, Write};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Output, Stdio};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use support::FakeDaemon;

fn command(socket: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lanternctl"));
    command.env_remove("LANTERN_SOCKET").env_remove("XDG_RUNTIME_DIR").arg("--socket").arg(socket).args(arguments);
    command
}

fn ctl(socket: &Path, arguments: &[&str]) -> Output {
    command(socket, arguments).output().unwrap()
}

/// Its standard output, after exit code 0.
#[track_caller]
fn good(socket: &Path, arguments: &[&str]) -> String {
    let output = ctl(socket, arguments);
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!((output.status.code(), stderr.as_str()), (Some(0), ""), "{arguments:?}");
    String::from_utf8(output.stdout).unwrap()
}

/// Its standard error, after an exit code, with nothing on standard output.
#[track_caller]
fn bad(socket: &Path, arguments: &[&str], code: i32) -> String {
    let output = ctl(socket, arguments);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), output.stdout.len()), (Some(code), 0), "{arguments:?}: {stderr}");
    assert!(!stderr.is_empty());
    stderr
}

fn json_of(text: &str) -> Value {
    assert_eq!(text.matches('\n').count(), 1, "one line: {text}");
    serde_json::from_str(text).unwrap()
}

#[test]
fn status_is_a_table_or_json() {
    let daemon = FakeDaemon::start();
    let text = good(daemon.socket(), &["status"]);
    for part in ["lanternd 9.9.9, up 1 h 02 min", "llvmpipe", "1 234 567 triangles", "head", "63 bytes", "1280 × 800"]
    {
        assert!(text.contains(part), "{part} in\n{text}");
    }
    let status = json_of(&good(daemon.socket(), &["--json", "status"]));
    assert_eq!(status["trackers"]["optitrack"]["rejected"], 1);
    // Options may stand after the command as well.
    assert_eq!(json_of(&good(daemon.socket(), &["status", "--json"]))["version"], "9.9.9");
}

#[test]
fn watch_looks_again_and_again() {
    let daemon = FakeDaemon::start();
    let text = good(daemon.socket(), &["watch", "--json", "--interval", "0.01", "--count", "3"]);
    let looks: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(looks.len() == 3 && looks.iter().all(|status| status["version"] == "9.9.9"), "{text}");
    let text = good(daemon.socket(), &["watch", "--interval", "0.01", "--count", "2"]);
    assert_eq!(text.matches("lanternd 9.9.9").count(), 2);
    assert!(!text.contains('\x1b'), "what is no terminal is not cleared");
}

/// A `lanternctl` that runs on, and its lines as they come.
struct Running {
    child: Child,
    lines: Lines<BufReader<ChildStdout>>,
}

impl Running {
    fn start(socket: &Path, arguments: &[&str]) -> Self {
        let mut child = command(socket, arguments).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        Self { child, lines }
    }

    fn line(&mut self) -> String {
        self.lines.next().unwrap().unwrap()
    }
}

/// Waits until somebody has subscribed.
fn subscribed(daemon: &FakeDaemon, kind: EventKind, wanted: bool) {
    let deadline = Instant::now() + Duration::from_secs(10);
    while daemon.engine.events.are_wanted(kind) != wanted {
        assert!(Instant::now() < deadline, "subscribed: {}", !wanted);
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn frame(number: u64) -> Event {
    let pose = ShownPose { source: "optitrack".into(), sequence: Some(3), ..ShownPose::default() };
    let poses = [("head".to_owned(), pose)].into();
    Event::Frame(FrameEvent { projector: "left".into(), frame: number, poses, ..FrameEvent::default() })
}

#[test]
fn watch_goes_on_with_a_daemon_that_is_started_again() {
    let mut daemon = FakeDaemon::start();
    let events = daemon.engine.events.clone();
    let mut csv = Running::start(daemon.socket(), &["watch", "--csv", "-", "--count", "2"]);
    assert!(csv.line().starts_with("frame,projector,revision,body,source,"));
    subscribed(&daemon, EventKind::Frame, true);
    events.tell(EventKind::Frame, frame(41));
    assert!(csv.line().starts_with("41,left,0,head,optitrack,3,"));
    let mut status = Running::start(daemon.socket(), &["watch", "--json", "--interval", "0.01"]);
    assert!(status.line().contains("9.9.9"));

    daemon.stop();
    subscribed(&daemon, EventKind::Frame, false);
    daemon.start_again();
    subscribed(&daemon, EventKind::Frame, true);
    events.tell(EventKind::Frame, frame(1));
    assert!(csv.line().starts_with("1,left,"));
    assert_eq!(csv.child.wait().unwrap().code(), Some(0));
    for _ in 0..50 {
        assert!(status.line().contains("9.9.9"));
    }
    status.child.kill().unwrap();
    status.child.wait().unwrap();
}

#[test]
fn watch_gives_up_a_daemon_that_does_not_come_back() {
    let mut daemon = FakeDaemon::start();
    let mut watch = Running::start(daemon.socket(), &["watch", "--events", "scene", "--patience", "0.1"]);
    subscribed(&daemon, EventKind::Scene, true);
    daemon.engine.events.tell(EventKind::Scene, Event::Scene(SceneEvent { revision: 9, frame: 1, nodes: 3 }));
    assert_eq!(watch.line(), r#"{"event":"scene","revision":9,"frame":1,"nodes":3}"#);
    daemon.stop();
    assert_eq!(watch.child.wait().unwrap().code(), Some(3));
    bad(daemon.socket(), &["watch"], 3);
    assert!(bad(daemon.socket(), &["watch", "--events", "smell"], 2).contains("tracker"));
}

#[test]
fn what_scene_get_prints_scene_apply_takes() {
    let daemon = FakeDaemon::start();
    let file = daemon.file("edits.json");
    std::fs::write(&file, r#"[{"add": {"node": "a", "uri": "lantern:sphere"}}, {"remove": {"node": "b"}}]"#).unwrap();
    let text = good(daemon.socket(), &["scene", "apply", file.to_str().unwrap()]);
    assert_eq!(text, "revision 2, first shown by frame 42\n");

    for json in [false, true] {
        let before = daemon.engine.edits.lock().unwrap().clone();
        let get: &[&str] = if json { &["scene", "get", "--json"] } else { &["scene", "get"] };
        let mut child = command(daemon.socket(), &["scene", "apply", "-", "--json", "--not-durable"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        child.stdin.take().unwrap().write_all(good(daemon.socket(), get).as_bytes()).unwrap();
        let output = child.wait_with_output().unwrap();
        let count = before.len() * 2;
        assert_eq!(
            json_of(&String::from_utf8(output.stdout).unwrap()),
            json!({"revision": count, "frame": 42, "durable": false})
        );
        assert_eq!(*daemon.engine.edits.lock().unwrap(), [before.clone(), before].concat());
    }
}

#[test]
fn load_sends_the_full_path_of_a_file_that_is_here() {
    let daemon = FakeDaemon::start();
    let file = daemon.file("bunny.glb");
    std::fs::write(&file, "").unwrap();
    let mut here = command(daemon.socket(), &["load", "bunny.glb", "--node", "bunny", "--role", "mask"]);
    assert!(here.current_dir(file.parent().unwrap()).output().unwrap().status.success());
    good(daemon.socket(), &["load", "lantern:sphere", "--node", "ball"]);
    good(daemon.socket(), &["load", "elsewhere/x.glb", "--node", "x"]);
    let edits = daemon.engine.edits.lock().unwrap();
    let [Edit::Add(bunny), Edit::Add(ball), Edit::Add(x)] = edits.as_slice() else { panic!("{edits:?}") };
    assert_eq!(Path::new(&bunny.uri), file.canonicalize().unwrap());
    assert_eq!((bunny.node.as_str(), bunny.role), ("bunny", Some(Role::Mask)));
    assert_eq!((ball.uri.as_str(), ball.role, x.uri.as_str()), ("lantern:sphere", None, "elsewhere/x.glb"));
}

#[test]
fn pose_takes_three_or_seven_numbers() {
    let daemon = FakeDaemon::start();
    assert_eq!(good(daemon.socket(), &["pose", "head", "-0.5", "1.7", "-2e-3"]), "");
    good(daemon.socket(), &["pose", "head", "0", "1", "2", "0", "-0.6", "0", "0.8"]);
    let poses = daemon.engine.poses.lock().unwrap().clone();
    assert_eq!((poses[0].position_m, poses[0].orientation), ([-0.5, 1.7, -2e-3], None));
    assert_eq!(poses[1].orientation, Some([0.0, -0.6, 0.0, 0.8]));
    for numbers in [&["1", "2"][..], &["1", "2", "3", "4"], &["1", "2", "nan"], &["1", "2", "x"], &["1"; 8]] {
        bad(daemon.socket(), &[&["pose", "head"], numbers].concat(), 2);
    }
    assert_eq!(daemon.engine.poses.lock().unwrap().len(), 2);
}

#[test]
fn snapshot_saves_every_byte() {
    let daemon = FakeDaemon::start();
    let file = daemon.file("left.exr");
    let path = file.to_str().unwrap();
    assert_eq!(good(daemon.socket(), &["snapshot", "-p", "left", "--layer", "depth", "-o", path]), "");
    assert!(std::fs::read(&file).unwrap() == support::picture(Layer::Depth));
    let output = ctl(daemon.socket(), &["snapshot", "-p", "left", "-o", "-"]);
    assert!(output.stdout == support::picture(Layer::Color));
    bad(daemon.socket(), &["snapshot", "-p", "left", "--layer", "colour", "-o", path], 2);
    bad(daemon.socket(), &["snapshot", "-p", "left"], 2);
    bad(daemon.socket(), &["snapshot", "-p", "left", "-o", "/nowhere/left.png"], 2);

    // A refusal leaves what is there.
    assert!(bad(daemon.socket(), &["snapshot", "-p", "nowhere", "-o", path], 1).contains("unknown-projector"));
    assert!(std::fs::read(&file).unwrap() == support::picture(Layer::Depth));
}

#[test]
fn patterns_go_to_one_projector_or_to_all() {
    let daemon = FakeDaemon::start();
    good(daemon.socket(), &["pattern", "identify", "-p", "left"]);
    good(daemon.socket(), &["pattern", "off"]);
    let asked = daemon.engine.patterns.lock().unwrap().clone();
    let one = PatternRequest { projector: Some("left".into()), name: Pattern::Identify };
    assert_eq!(asked, [one, PatternRequest { projector: None, name: Pattern::Off }]);
}

#[test]
fn refusals_are_the_daemons_words() {
    let daemon = FakeDaemon::start();
    assert!(bad(daemon.socket(), &["pose", "hat", "0", "0", "0"], 1).contains("there is no body `hat` (at body)"));
    assert!(bad(daemon.socket(), &["pattern", "grid", "-p", "middle"], 1).contains("unknown-projector"));
    let file = daemon.file("edits.json");
    std::fs::write(&file, r#"[{"remove": {"node": "ghost"}}]"#).unwrap();
    let path = file.to_str().unwrap();
    assert!(bad(daemon.socket(), &["scene", "apply", path], 1).contains("at edits[0].node"));

    assert_eq!(good(daemon.socket(), &["reload"]), "the configuration was read again\n");
    daemon.engine.reload_fails.store(true, Ordering::SeqCst);
    assert!(bad(daemon.socket(), &["reload"], 1).contains("lab.toml:3:1"));

    // A line that is too long is refused by the daemon, while it is still being sent.
    std::fs::write(&file, format!(r#"[{{"remove": {{"node": "{}"}}}}]"#, "x".repeat(3 << 20))).unwrap();
    assert!(bad(daemon.socket(), &["scene", "apply", path], 1).contains("line-too-long"));
    drop(daemon);
    let full = FakeDaemon::with_clients(0);
    assert!(bad(full.socket(), &["status"], 1).contains("too-many-clients"));
}

#[test]
fn bad_usage_asks_nobody() {
    let nobody = Path::new("/nonexistent/lanternd.sock");
    for arguments in [
        &[][..],
        &["dance"],
        &["scene"],
        &["scene", "apply"],
        &["scene", "apply", "/nonexistent/edits.json"],
        &["load", "a.glb"],
        &["load", "a.glb", "--node", "a", "--role", "ghost"],
        &["pattern", "plaid"],
        &["watch", "--interval", "0"],
    ] {
        bad(nobody, arguments, 2);
    }
    let daemon = FakeDaemon::start();
    let file = daemon.file("edits.json");
    for text in ["", "[", "3", "{}", r#"{"edits": 3}"#] {
        std::fs::write(&file, text).unwrap();
        assert!(bad(daemon.socket(), &["scene", "apply", file.to_str().unwrap()], 2).contains("hint:"), "{text}");
    }
}

#[test]
fn nobody_there_is_code_3() {
    let mut daemon = FakeDaemon::start();
    let message = bad(&daemon.file("other.sock"), &["status"], 3);
    assert!(message.contains("other.sock") && message.contains("lanternd run"), "{message}");
    daemon.stop();
    bad(daemon.socket(), &["status"], 3);
    // A socket file that nobody listens at any more.
    let stale = daemon.file("stale.sock");
    drop(std::os::unix::net::UnixListener::bind(&stale).unwrap());
    bad(&stale, &["status"], 3);
}

#[test]
fn the_environment_names_the_socket() {
    let daemon = FakeDaemon::start();
    let mut command = Command::new(env!("CARGO_BIN_EXE_lanternctl"));
    command.env("LANTERN_SOCKET", daemon.socket()).args(["status", "--json"]);
    assert!(command.output().unwrap().status.success());
    // The argument goes before it.
    command.args(["--socket", "/nonexistent/lanternd.sock"]);
    assert_eq!(command.output().unwrap().status.code(), Some(3));
}

#[test]
fn help_teaches() {
    let nobody = Path::new("/nonexistent/lanternd.sock");
    let help = good(nobody, &["--help"]);
    for part in ["Exit codes:", "status", "watch", "scene", "load", "pose", "snapshot", "pattern", "reload"] {
        assert!(help.contains(part), "{part} in\n{help}");
    }
    for command in ["status", "watch", "scene get", "scene apply", "load", "pose", "snapshot", "pattern", "reload"] {
        let arguments: Vec<_> = command.split(' ').chain(["--help"]).collect();
        let help = good(nobody, &arguments);
        assert!(help.contains("Example") && help.contains("lanternctl "), "{command}:\n{help}");
    }
}
