//! The control socket from outside: the protocol to the letter, and clients that mean no good.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]

mod support;

use lantern::control::{ControlError, Listener};
use lantern_proto::event::SceneEvent;
use lantern_proto::{Event, EventKind, Layer};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::time::{Duration, Instant};
use support::{FakeDaemon, picture};

const MIB: usize = 1 << 20;

/// A client that never waits forever.
struct Client {
    stream: UnixStream,
    reader: BufReader<UnixStream>,
}

impl Client {
    fn connect(path: &Path) -> Self {
        let stream = UnixStream::connect(path).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        stream.set_write_timeout(Some(Duration::from_secs(20))).unwrap();
        Self { reader: BufReader::new(stream.try_clone().unwrap()), stream }
    }

    fn send(&mut self, text: &str) {
        self.stream.write_all(text.as_bytes()).unwrap();
    }

    /// The next line; `None` where the daemon has hung up.
    fn receive(&mut self) -> Option<Value> {
        let mut line = String::new();
        match self.reader.read_line(&mut line).unwrap() {
            0 => None,
            _ => Some(serde_json::from_str(&line).unwrap()),
        }
    }

    fn ask(&mut self, request: &Value) -> Value {
        self.send(&format!("{request}\n"));
        self.receive().unwrap()
    }
}

#[test]
fn each_op_is_answered() {
    let daemon = FakeDaemon::start();
    let mut client = Client::connect(daemon.socket());
    assert_eq!(
        client.ask(&json!({"id": 1, "op": "hello"})),
        json!({"id": 1, "ok": {"protocol": 1, "version": "9.9.9", "projectors": ["left", "right"]}})
    );
    assert_eq!(client.ask(&json!({"id": 2, "op": "status"}))["ok"]["scene"]["triangles"], 1_234_567);
    let edit = json!({"add": {"node": "ball", "uri": "lantern:sphere"}});
    assert_eq!(
        client.ask(&json!({"id": 3, "op": "scene.apply", "edits": [edit]})),
        json!({"id": 3, "ok": {"revision": 1, "frame": 42, "durable": true}})
    );
    assert_eq!(
        client.ask(&json!({"id": 4, "op": "scene.get"})),
        json!({"id": 4, "ok": {"revision": 1, "edits": [edit]}})
    );
    assert_eq!(
        client.ask(&json!({"id": 5, "op": "pose", "body": "head", "position_m": [1, 2, 3]})),
        json!({"id": 5, "ok": {}})
    );
    assert_eq!(daemon.engine.poses.lock().unwrap()[0].position_m, [1.0, 2.0, 3.0]);
    assert_eq!(client.ask(&json!({"id": 6, "op": "config.reload"})), json!({"id": 6, "ok": {"revision": 7}}));

    // The picture comes right after its line, and the next line right after the picture.
    let reply = client.ask(&json!({"id": 7, "op": "snapshot", "projector": "left", "layer": "node"}));
    let expected = picture(Layer::Node);
    assert_eq!(reply, json!({"id": 7, "ok": {"bytes": expected.len(), "format": "png"}}));
    let mut bytes = vec![0; expected.len()];
    client.reader.read_exact(&mut bytes).unwrap();
    assert!(bytes == expected);
    assert_eq!(client.ask(&json!({"id": 8, "op": "hello"}))["id"], 8);
}

#[test]
fn refusals_say_what_and_where() {
    let daemon = FakeDaemon::start();
    let mut client = Client::connect(daemon.socket());
    let remove = |node: &str| json!({"remove": {"node": node}});
    let request = json!({"id": 1, "op": "scene.apply", "edits": [remove("a"), remove("ghost")]});
    assert_eq!(
        client.ask(&request),
        json!({"id": 1, "error": {"code": "unknown-node", "message": "there is no node `ghost`", "at": "edits[1].node"}})
    );
    assert!(daemon.engine.edits.lock().unwrap().is_empty());
    let reply = client.ask(&json!({"id": 2, "op": "scene.apply", "edits": [remove("a"), {"remove": {"nod": "b"}}]}));
    assert_eq!((&reply["id"], &reply["error"]["code"]), (&json!(2), &json!("bad-request")));
    assert_eq!(reply["error"]["at"], "edits[1].nod");
    let reply = client.ask(&json!({"id": 3, "op": "dance"}));
    assert_eq!((&reply["id"], &reply["error"]["code"]), (&json!(3), &json!("unknown-op")));
    let reply = client.ask(&json!({"id": 4, "op": "snapshot", "projector": "nowhere", "layer": "color"}));
    assert_eq!(reply["error"]["at"], "projector");
}

fn scene(revision: u64) -> Event {
    Event::Scene(SceneEvent { revision, frame: 5, nodes: 2 })
}

#[test]
fn subscribers_hear_what_they_asked_for() {
    let daemon = FakeDaemon::start();
    let events = &daemon.engine.events;
    let (mut client, mut other) = (Client::connect(daemon.socket()), Client::connect(daemon.socket()));
    let reply = client.ask(&json!({"id": 1, "op": "subscribe", "events": ["scene", "frame"]}));
    assert_eq!(reply, json!({"id": 1, "ok": {"events": ["scene", "frame"]}}));
    assert!(other.ask(&json!({"id": 1, "op": "subscribe", "events": []})).get("ok").is_some());
    assert!(events.are_wanted(EventKind::Scene) && !events.are_wanted(EventKind::Pose));

    // Events stand between replies, in their own order, and never in a picture.
    events.tell(EventKind::Scene, scene(7));
    assert_eq!(client.receive().unwrap(), json!({"event": "scene", "revision": 7, "frame": 5, "nodes": 2}));
    for round in 0..20 {
        events.tell(EventKind::Scene, scene(2 * round));
        client.send("{\"id\": 2, \"op\": \"snapshot\", \"projector\": \"left\", \"layer\": \"color\"}\n");
        events.tell(EventKind::Scene, scene(2 * round + 1));
        let (mut heard, mut pictures) = (vec![], 0);
        while heard.len() < 2 || pictures < 1 {
            let line = client.receive().unwrap();
            if line.get("event").is_some() {
                heard.push(line["revision"].as_u64().unwrap());
            } else {
                let mut picture = vec![0; usize::try_from(line["ok"]["bytes"].as_u64().unwrap()).unwrap()];
                client.reader.read_exact(&mut picture).unwrap();
                assert_eq!(picture, support::picture(Layer::Color));
                pictures += 1;
            }
        }
        assert_eq!(heard, [2 * round, 2 * round + 1]);
    }

    // Another subscription takes the place of the first, and who has asked for nothing has heard nothing.
    assert!(client.ask(&json!({"id": 3, "op": "subscribe", "events": ["tracker"]})).get("ok").is_some());
    events.tell(EventKind::Scene, scene(99));
    assert_eq!(client.ask(&json!({"id": 4, "op": "hello"}))["id"], 4);
    assert_eq!(other.ask(&json!({"id": 5, "op": "hello"}))["id"], 5);

    // Who goes is forgotten.
    drop((client, other));
    let deadline = Instant::now() + Duration::from_secs(10);
    while events.are_wanted(EventKind::Tracker) {
        assert!(Instant::now() < deadline, "still subscribed");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_slow_subscriber_is_told_what_it_lost_and_a_deaf_one_is_dropped() {
    let daemon = FakeDaemon::start();
    let events = &daemon.engine.events;
    let (mut slow, mut deaf) = (Client::connect(daemon.socket()), Client::connect(daemon.socket()));
    for client in [&mut slow, &mut deaf] {
        assert!(client.ask(&json!({"id": 1, "op": "subscribe", "events": ["scene"]})).get("ok").is_some());
    }
    // More than sockets and queues hold, and nobody who tells waits for either of them.
    const TOLD: u64 = 40_000;
    (0..TOLD).for_each(|revision| events.tell(EventKind::Scene, scene(revision)));

    let (mut heard, mut lost, mut last) = (0, 0, None);
    while heard + lost < TOLD {
        let line = slow.receive().unwrap();
        if line["event"] == "lost" {
            lost += line["count"].as_u64().unwrap();
        } else {
            let revision = line["revision"].as_u64().unwrap();
            assert_eq!(revision, heard + lost, "the gap is where it is said to be");
            assert!(last.replace(revision).is_none_or(|last| last < revision));
            heard += 1;
        }
    }
    assert!(lost > 0 && heard > 2000, "{heard} heard, {lost} lost");

    let deadline = Instant::now() + Duration::from_secs(15);
    while deaf.stream.write_all(b" ").is_ok() {
        assert!(Instant::now() < deadline, "still connected");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn replies_come_in_the_order_of_requests() {
    let daemon = FakeDaemon::start();
    let mut client = Client::connect(daemon.socket());
    let ops = ["hello", "status", "scene.get", "nonsense", "config.reload"];
    let lines: String = (0..200).map(|id| format!("{}\n", json!({"id": id, "op": ops[id % ops.len()]}))).collect();
    client.send(&lines);
    for id in 0..200 {
        assert_eq!(client.receive().unwrap()["id"], id);
    }
}

#[test]
fn lines_that_cannot_be_read_do_not_end_the_connection() {
    let daemon = FakeDaemon::start();
    let mut client = Client::connect(daemon.socket());
    for garbage in [&b""[..], b"{", b"\xff\xfe", b"[]", b"\0\0\0", b"{\"op\": \"hello\"}", b"GET / HTTP/1.1\r"] {
        client.stream.write_all(garbage).unwrap();
        client.send("\n");
        let reply = client.receive().unwrap();
        assert_eq!(reply["id"], Value::Null);
        assert!(reply["error"]["code"].is_string());
    }
    assert_eq!(client.ask(&json!({"id": 1, "op": "hello"}))["ok"]["protocol"], 1);
    // In pieces, with a carriage return, and without a last newline.
    for piece in ["{\"id\"", ": 2, \"op", "\": \"hello\"}\r\n{\"id\": 3, \"op\": \"hello\"}"] {
        client.send(piece);
        std::thread::sleep(Duration::from_millis(10));
    }
    client.stream.shutdown(std::net::Shutdown::Write).unwrap();
    assert_eq!(client.receive().unwrap()["id"], 2);
    assert_eq!(client.receive().unwrap()["id"], 3);
    assert_eq!(client.receive(), None);
}

#[test]
fn an_oversized_line_ends_the_connection_after_its_error() {
    let daemon = FakeDaemon::start();
    // The longest line is read: it is a `hello` with very much space in it.
    let mut client = Client::connect(daemon.socket());
    let request = "{\"id\": 1, \"op\": \"hello\"}";
    client.send(&format!("{}{request}\n", " ".repeat(MIB - request.len())));
    assert_eq!(client.receive().unwrap()["id"], 1);

    // One byte more, with its newline, without one, and far more than that: the error can be read each time.
    for (length, newline) in [(MIB + 1, "\n"), (MIB + 1, ""), (5 * MIB, "\n")] {
        let mut client = Client::connect(daemon.socket());
        client.send(&"x".repeat(length));
        client.send(newline);
        let reply = client.receive().unwrap();
        assert_eq!((&reply["id"], &reply["error"]["code"]), (&Value::Null, &json!("line-too-long")));
        assert_eq!(client.receive(), None);
    }
}

#[test]
fn a_client_that_does_not_read_is_dropped_and_holds_nobody_up() {
    let daemon = FakeDaemon::start();
    let mut stuck = Client::connect(daemon.socket());
    let request = "{\"id\": 1, \"op\": \"snapshot\", \"projector\": \"left\", \"layer\": \"color\"}\n";
    stuck.send(&request.repeat(50));

    // Others are answered while it is stuck.
    let start = Instant::now();
    let mut other = Client::connect(daemon.socket());
    for id in 0..50 {
        assert_eq!(other.ask(&json!({"id": id, "op": "status"}))["id"], id);
    }
    assert!(start.elapsed() < Duration::from_secs(2), "held up for {:?}", start.elapsed());

    // It is dropped while it still does not read: writing to it fails in the end.
    let deadline = Instant::now() + Duration::from_secs(15);
    while stuck.stream.write_all(b" ").is_ok() {
        assert!(Instant::now() < deadline, "still connected");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn who_asks_for_a_picture_waits_until_others_have_read_theirs() {
    let daemon = FakeDaemon::start();
    let request = json!({"id": 1, "op": "snapshot", "projector": "left", "layer": "color"});
    // Each has read the line before its picture, and goes no further.
    let mut stuck: Vec<_> = (0..4).map(|_| Client::connect(daemon.socket())).collect();
    for client in &mut stuck {
        assert!(client.ask(&request)["ok"]["bytes"].is_u64());
    }
    let mut other = Client::connect(daemon.socket());
    assert_eq!(other.ask(&json!({"id": 2, "op": "status"}))["id"], 2);
    assert!(stuck.iter_mut().all(|client| client.stream.write_all(b" ").is_ok()), "they are still served");

    // Its picture comes when one of theirs was given up.
    let length = other.ask(&request)["ok"]["bytes"].as_u64().unwrap();
    let mut bytes = vec![0; length as usize];
    other.reader.read_exact(&mut bytes).unwrap();
    assert_eq!(bytes, picture(Layer::Color));
    assert!(stuck.iter_mut().any(|client| client.stream.write_all(b" ").is_err()), "there was room for five");
}

/// A client that has been answered, once there is a place for it.
fn client_in_time(daemon: &FakeDaemon) -> Client {
    let deadline = Instant::now() + Duration::from_secs(10);
    loop {
        let mut client = Client::connect(daemon.socket());
        // Where there is no place yet, the daemon may hang up before the line has come.
        let _ = client.stream.write_all(b"{\"id\": 9, \"op\": \"hello\"}\n");
        if client.receive().is_some_and(|reply| reply["id"] == 9) {
            return client;
        }
        assert!(Instant::now() < deadline, "no place for another client");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn no_more_clients_than_the_limit() {
    let daemon = FakeDaemon::with_clients(2);
    let mut first = Client::connect(daemon.socket());
    let mut second = Client::connect(daemon.socket());
    first.ask(&json!({"id": 1, "op": "hello"}));
    second.ask(&json!({"id": 1, "op": "hello"}));
    let mut third = Client::connect(daemon.socket());
    let reply = third.receive().unwrap();
    assert_eq!((&reply["id"], &reply["error"]["code"]), (&Value::Null, &json!("too-many-clients")));
    assert_eq!(third.receive(), None);

    // A place that is given up is free for another.
    drop(second);
    drop(client_in_time(&daemon));
    assert_eq!(first.ask(&json!({"id": 2, "op": "hello"}))["id"], 2);
}

#[test]
fn clients_that_come_and_go_leave_their_places() {
    let daemon = FakeDaemon::with_clients(4);
    for round in 0..300 {
        let mut stream = UnixStream::connect(daemon.socket()).unwrap();
        // Gone in the middle of a line, of an answer, or at once. Turned away they may not get that far.
        let _ = match round % 3 {
            0 => stream.write_all(b"{\"id\": 1"),
            1 => stream.write_all(b"{\"id\": 1, \"op\": \"snapshot\", \"projector\": \"left\"}\n"),
            _ => Ok(()),
        };
    }
    let all: Vec<_> = (0..4).map(|_| client_in_time(&daemon)).collect();
    assert_eq!(all.len(), 4);
}

#[test]
fn the_socket_file() {
    let mut daemon = FakeDaemon::start();
    let path = daemon.path.clone();
    let mode = std::fs::metadata(&path).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o660);

    // A second daemon is refused, and the first one goes on.
    let error = Listener::bind(&path, None).unwrap_err();
    assert!(matches!(error, ControlError::Taken { .. }), "{error}");
    assert!(error.to_string().contains("another lanternd") && error.to_string().contains("hint:"), "{error}");
    assert_eq!(Client::connect(&path).ask(&json!({"id": 1, "op": "hello"}))["id"], 1);

    // It goes with its daemon, and the next one can take its place.
    daemon.stop();
    assert!(!path.exists());
    drop(Listener::bind(&path, None).unwrap());
}

#[test]
fn a_stale_socket_file_is_replaced_and_a_live_one_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lanternd.sock");
    drop(UnixListener::bind(&path).unwrap());
    assert!(path.exists(), "a socket file outlives its socket");
    let listener = Listener::bind(&path, None).unwrap();
    UnixStream::connect(&path).unwrap();
    drop(listener);

    // One that holds no lock, but listens.
    let other = UnixListener::bind(&path).unwrap();
    assert!(matches!(Listener::bind(&path, None), Err(ControlError::Taken { .. })));
    drop(other);

    // What is no socket is left alone.
    let file = folder.path().join("notes.txt");
    std::fs::write(&file, "dear diary").unwrap();
    assert!(matches!(Listener::bind(&file, None), Err(ControlError::NoSocket { .. })));
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "dear diary");
}

#[test]
fn paths_that_cannot_be_sockets() {
    let folder = tempfile::tempdir().unwrap();
    let long = folder.path().join("x".repeat(120));
    assert!(matches!(Listener::bind(&long, None), Err(ControlError::TooLong { .. })));
    std::fs::write(folder.path().join("file"), "").unwrap();
    let below = Listener::bind(&folder.path().join("file/lanternd.sock"), None).unwrap_err();
    assert!(matches!(below, ControlError::System { .. }) && below.to_string().contains("hint:"), "{below}");
}
