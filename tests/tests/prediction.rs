//! Prediction, the ledger of latency and events on a real daemon: a head that walks about, told by packets that come late, out of
//! order, or not at all.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{
    collections::BTreeMap,
    fs,
    net::UdpSocket,
    thread,
    time::{Duration, Instant},
};

use glam::{DVec3, UVec2};
use lantern_proto::{
    PosePacket,
    event::{Event, FrameEvent, TrackerState},
};
use lantern_tests::{client::Client, harness::Daemon, lab, random::SplitMix64, stage::Stand};
use rustix::time::{ClockId, clock_gettime};
use serde_json::json;

/// The tracker: 120 Hz, 30 ms from the measurement to the packet.
const RATE_HZ: f64 = 120.0;
const LATENCY_S: f64 = 0.03;
const LOSS: f64 = 0.05;
/// How much its positions shake, each axis, m.
const NOISE_M: f64 = 0.2e-3;

/// Seconds of the clock that events tell.
fn now_s() -> f64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
}

/// Where the head is, m, so many seconds after the start: it walks about at up to 1 m/s, and stands from `REST_S` on.
fn head(t: f64) -> DVec3 {
    let t = t.min(REST_S);
    DVec3::new(0.4 * (2.3 * t).sin(), 1.6 + 0.05 * (4.1 * t).sin(), 2.5 + 0.2 * (1.7 * t).sin())
}

const REST_S: f64 = 6.0;
const END_S: f64 = 9.0;

/// A measurement under way.
#[derive(Clone, Copy)]
struct Sent {
    /// When it is sent, s after the start.
    at_s: f64,
    measured_s: f64,
    said: DVec3,
    packet: PosePacket,
}

/// What the tracker sends, in the order in which it arrives; by its number.
fn sent() -> Vec<Sent> {
    let mut random = SplitMix64(11);
    let mut sent = Vec::new();
    for sequence in 0..(END_S * RATE_HZ) as u32 {
        let measured_s = f64::from(sequence) / RATE_HZ;
        // Exponentially spread, so that about one in fifteen is overtaken by the next.
        let jitter_s = -0.003 * (1.0 - random.unit()).ln();
        // The sum of twelve is as good as normal.
        let mut noise = || ((0..12).map(|_| random.unit()).sum::<f64>() - 6.0) * NOISE_M;
        let said = (head(measured_s) + DVec3::new(noise(), noise(), noise())).as_vec3();
        let packet = PosePacket {
            body_id: 1,
            sequence,
            // A clock of its own, which began long ago.
            measured_ns: Some(777_000_000_000_000 + (measured_s * 1e9) as u64),
            position_m: Some(said.to_array()),
            ..PosePacket::default()
        };
        if random.unit() > LOSS {
            sent.push(Sent { at_s: measured_s + LATENCY_S + jitter_s, measured_s, said: said.as_dvec3(), packet });
        }
    }
    sent.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    sent
}

/// Sends it all when it is due; gives the start.
fn send(socket: &UdpSocket, sent: &[Sent]) -> f64 {
    let (start, start_s) = (Instant::now(), now_s());
    for of in sent {
        thread::sleep(Duration::from_secs_f64(of.at_s).saturating_sub(start.elapsed()));
        socket.send(&of.packet.encode()).unwrap();
    }
    start_s
}

/// Hears events until it is told to end, on a connection of its own.
fn hear(mut client: Client, until: impl Fn(&Event) -> bool) -> Vec<Event> {
    let mut events = Vec::new();
    loop {
        let event: Event = serde_json::from_value(client.line().unwrap().unwrap()).unwrap();
        let is_last = until(&event);
        events.push(event);
        if is_last {
            return events;
        }
    }
}

/// A daemon whose picture depends on the eye, as small as can be, and a socket to its tracker.
fn daemon() -> (Daemon, UdpSocket) {
    let stand = Stand { resolution_px: UVec2::new(24, 16), ..lab::stand(0.0) };
    let projector = stand.toml("left").replace("kind = \"headless\"", "kind = \"headless\", latency_ms = 10");
    let tracked = lab::TRACKED.replace("listen =", "predict_ms = 30\nlisten =");
    let daemon = Daemon::start(&[lab::RENDER, lab::SCENE, &tracked, &projector].join("\n")).unwrap();
    let mut client = daemon.client().unwrap();
    client.apply(json!([lab::mirror()])).unwrap();
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.connect(client.status().unwrap()["trackers"]["optitrack"]["listen"].as_str().unwrap()).unwrap();
    (daemon, socket)
}

fn root_mean_square(of: impl Iterator<Item = f64>) -> f64 {
    let squares: Vec<_> = of.map(|x| x * x).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn a_walking_head_is_met_and_a_standing_one_does_not_shake() {
    let (daemon, socket) = daemon();
    let mut client = daemon.client().unwrap();
    let mut subscriber = daemon.client().unwrap();
    subscriber.ask_ok("subscribe", json!({"events": ["frame", "tracker", "pose"]})).unwrap();
    let csv = daemon.folder().path().join("latency.csv");
    let mut file = lantern_tests::harness::command("lanternctl").unwrap();
    let file = file.arg("--socket").arg(daemon.socket()).args(["watch", "--count", "20", "--csv"]).arg(&csv).spawn();
    let mut file = file.unwrap();

    let sent = sent();
    let (start_s, events) = thread::scope(|scope| {
        // The tracker is silent a second after its end, and by then the picture is where it stays.
        let silent = |event: &Event| matches!(event, Event::Tracker(of) if of.state == TrackerState::Silent);
        let hearing = scope.spawn(move || hear(subscriber, silent));
        let start_s = send(&socket, &sent);
        (start_s, hearing.join().unwrap())
    });
    let frames: Vec<FrameEvent> =
        events.iter().filter_map(|e| if let Event::Frame(frame) = e { Some(frame.clone()) } else { None }).collect();

    // Of every frame: which pose, how old when, and in which order.
    let by_sequence: BTreeMap<u32, Sent> = sent.iter().map(|of| (of.packet.sequence, *of)).collect();
    let mut errors: Vec<(f64, DVec3, DVec3)> = Vec::new();
    for frame in frames.iter().filter(|frame| !frame.poses.is_empty()) {
        let pose = &frame.poses["head"];
        let age = pose.age_ms;
        let [measured, received, submitted, completed] =
            [age.measured.unwrap(), age.received, age.submitted, age.completed];
        assert!(measured == 0.0 && 29.99 <= received && received <= submitted && submitted <= completed, "{frame:?}");
        assert!(age.presented.is_none() && frame.submitted_s <= frame.completed_s, "{frame:?}");
        // Once it has been silent until its prediction has faded, it is shown as of then.
        let Some(predicted_ms) = pose.predicted_ms else {
            assert!(submitted - received >= 499.0, "{frame:?}");
            continue;
        };
        assert!(predicted_ms <= 150.0 && pose.source == "optitrack", "{frame:?}");
        let of = by_sequence[&pose.sequence.unwrap()];
        // The estimate of when it was measured is late by what the fastest packet had beyond 30 ms, and what the machine added.
        let measured_s = frame.completed_s - completed / 1e3 - start_s;
        assert!((measured_s - of.measured_s).abs() < 0.25, "{measured_s} for {}", of.measured_s);
        // As the daemon does, and as it would without prediction, at the time of light.
        let light_s = frame.light_s - start_s;
        if predicted_ms < 149.0 {
            errors.push((light_s, DVec3::from_array(pose.position_m) - head(light_s), of.said - head(light_s)));
        }
    }
    let walking: Vec<_> = errors.iter().filter(|(t, ..)| (1.0..REST_S - 0.1).contains(t)).collect();
    let standing: Vec<_> = errors.iter().filter(|(t, ..)| (REST_S + 0.7..END_S).contains(t)).collect();
    let rms = |of: &[&(f64, DVec3, DVec3)]| {
        let mm = |error: DVec3| error.length() * 1e3;
        [root_mean_square(of.iter().map(|e| mm(e.1))), root_mean_square(of.iter().map(|e| mm(e.2)))]
    };
    let ([predicted, said], [still, noise]) = (rms(&walking), rms(&standing));
    println!("{} frames: {predicted:.1} mm, said {said:.1} mm", walking.len());
    println!("{} frames at rest: {still:.3} mm, said {noise:.3} mm", standing.len());
    assert!(walking.len() >= 30 && standing.len() >= 10, "too few frames: {} {}", walking.len(), standing.len());
    assert!(predicted <= 0.5 * said, "{predicted} mm, said {said} mm");
    assert!(still <= noise + 0.2, "{still} mm, said {noise} mm");

    // What poses were told of is what was sent and not overtaken.
    let told: Vec<_> =
        events.iter().filter_map(|e| if let Event::Pose(pose) = e { Some(pose) } else { None }).collect();
    assert!(told.len() > sent.len() / 2 && told.is_sorted_by_key(|pose| pose.sequence), "{}", told.len());
    for pose in told {
        let of = by_sequence[&pose.sequence.unwrap()];
        assert_eq!((pose.position_m, pose.body.as_str()), (of.said.to_array(), "head"));
        assert!(pose.measured_s.unwrap() <= pose.received_s - LATENCY_S + 1e-6, "{pose:?}");
    }

    // The tracker has fallen silent: the last pose stands, to the bit, and nothing more is done.
    let status = client.status().unwrap();
    let last = sent.iter().max_by_key(|of| of.packet.sequence).unwrap();
    assert_eq!(status["bodies"]["head"]["position_m"], json!(last.said.to_array()));
    let shown = frames.last().unwrap().poses["head"].position_m;
    assert_eq!(shown, last.said.to_array(), "the picture stays elsewhere than the head");
    let shown_frames = |client: &mut Client| client.status().unwrap()["projectors"]["left"]["frames"].clone();
    let before = shown_frames(&mut client);
    for sequence in 0..50 {
        let packet = PosePacket { sequence: last.packet.sequence + 1 + sequence, measured_ns: None, ..last.packet };
        socket.send(&packet.encode()).unwrap();
        thread::sleep(Duration::from_millis(8));
    }
    client.snapshot("left", "color").unwrap();
    assert_eq!(shown_frames(&mut client), before, "a body that says the same again woke the daemon");

    // The ledger's percentiles, and its file.
    let latency = &status["projectors"]["left"]["latency_ms"]["head"];
    for stage in ["received", "submitted", "completed"] {
        let of = ["p50", "p95", "p99", "max"].map(|rank| latency[stage][rank].as_f64().unwrap());
        assert!(of[0] >= 29.99 && of.is_sorted(), "{latency}");
    }
    assert!(latency["frames"].as_u64().unwrap() >= 30 && latency["presented"].is_null(), "{latency}");
    assert!(file.wait().unwrap().success());
    let text = fs::read_to_string(&csv).unwrap();
    let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!((lines.len(), lines[0][..4].join(",").as_str()), (21, "frame,projector,revision,body"));
    for line in &lines[1..] {
        assert!(line.len() == lines[0].len() && line[1] == "left" && line[0].parse::<u64>().is_ok(), "{line:?}");
    }
    assert!(lines[1..].iter().any(|line| line[3] == "head" && line[4] == "optitrack"), "{text}");
    let table = daemon.control(&["status"]).unwrap();
    assert!(String::from_utf8(table.stdout).unwrap().contains("p50 p95 p99 max"));
}

#[test]
fn a_predicted_node_moves_on_and_comes_to_rest() {
    let stand = Stand { resolution_px: UVec2::new(24, 16), ..lab::stand(0.0) };
    let tracked = lab::TRACKED
        .replace("name = \"hand\"", "name = \"hand\"\ndrives = \"node:ball\"")
        .replace("listen =", "predict_ms = \"auto\"\nlisten =");
    let daemon = Daemon::start(&[lab::RENDER, lab::SCENE, &tracked, &stand.toml("left")].join("\n")).unwrap();
    let (mut client, mut subscriber) = (daemon.client().unwrap(), daemon.client().unwrap());
    subscriber.ask_ok("subscribe", json!({"events": ["frame", "scene"]})).unwrap();
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.connect(client.status().unwrap()["trackers"]["optitrack"]["listen"].as_str().unwrap()).unwrap();

    // 1 m/s along +X for half a second, and then not a word.
    let start = Instant::now();
    let mut x = 0.0f32;
    for sequence in 0..50 {
        thread::sleep(Duration::from_millis(10 * u64::from(sequence)).saturating_sub(start.elapsed()));
        x = 0.01 * sequence as f32;
        let packet = PosePacket {
            body_id: 2,
            sequence,
            measured_ns: Some(1 + u64::from(sequence) * 10_000_000),
            position_m: Some([x, 0.4, 0.0]),
            ..PosePacket::default()
        };
        socket.send(&packet.encode()).unwrap();
    }
    let rest = [f64::from(x), f64::from(0.4f32), 0.0];
    let rests = |event: &Event| matches!(event, Event::Frame(frame) if frame.poses.get("hand").is_some_and(|pose| pose.position_m == rest));
    let events = hear(subscriber, rests);
    let ahead = events.iter().filter(|event| {
        matches!(event, Event::Frame(frame) if frame.poses.get("hand").is_some_and(|pose| pose.position_m[0] > rest[0] + 0.005))
    });
    assert!(ahead.count() > 0, "it was never shown ahead of what was said");
    assert!(
        events.iter().any(|event| matches!(event, Event::Scene(scene) if scene.nodes == 2)),
        "no revision was told"
    );
    let told = client.ask_ok("scene.get", json!({})).unwrap();
    let ball = told["edits"].as_array().unwrap().iter().find(|edit| edit["add"]["node"] == "ball").unwrap();
    assert_eq!(ball["add"]["translation_m"], json!(rest), "{ball}");
}
