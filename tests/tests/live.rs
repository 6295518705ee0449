//! Poses from a tracker and from the socket, what they move, and that nothing is done where nothing moves.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{
    fs,
    net::UdpSocket,
    thread,
    time::{Duration, Instant},
};

use lantern_proto::PosePacket;
use lantern_tests::{client::Client, harness::Daemon, lab};
use serde_json::{Value, json};

/// Between two looks of who looks again and again: other tests share the machine.
const BREATH: Duration = Duration::from_millis(5);

/// A tracker's sender, on an address of this machine.
struct Sender {
    socket: UdpSocket,
    to: String,
}

impl Sender {
    fn new(from: &str, client: &mut Client) -> Self {
        let to = client.status().unwrap()["trackers"]["optitrack"]["listen"].as_str().unwrap().to_owned();
        Self { socket: UdpSocket::bind(from).unwrap(), to }
    }

    /// Sends, and waits until it was counted; gives the tracker's status.
    fn send(&self, client: &mut Client, datagram: &[u8]) -> Value {
        let count = |status: &Value| status["accepted"].as_u64().unwrap() + status["rejected"].as_u64().unwrap();
        let tracker = |client: &mut Client| client.status().unwrap()["trackers"]["optitrack"].clone();
        let before = count(&tracker(client));
        self.socket.send_to(datagram, &self.to).unwrap();
        let started = Instant::now();
        loop {
            let now = tracker(client);
            if count(&now) > before {
                return now;
            }
            assert!(started.elapsed() < Duration::from_secs(10), "a datagram was not counted: {now}");
            thread::sleep(Duration::from_millis(5));
        }
    }
}

fn packet(sequence: u32, position_m: [f32; 3]) -> PosePacket {
    PosePacket { body_id: 1, sequence, position_m: Some(position_m), ..PosePacket::default() }
}

#[test]
fn the_eye_moves_what_depends_on_it_and_nothing_else() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let mut client = daemon.client().unwrap();
    let sender = Sender::new("127.0.0.1:0", &mut client);
    let colors = |client: &mut Client| ["left", "right"].map(|name| client.snapshot(name, "color").unwrap().1);

    // Of a diffuse room not a bit changes.
    let diffuse = colors(&mut client);
    let tracker = sender.send(&mut client, &packet(1, [-1.5, 1.2, 2.0]).encode());
    assert_eq!((&tracker["accepted"], &tracker["rejected"]), (&json!(1), &json!(0)));
    let head = client.status().unwrap()["bodies"]["head"].clone();
    assert_eq!((&head["source"], &head["position_m"][0]), (&json!("optitrack"), &json!(-1.5)));
    assert!(head["age_ms"].as_f64().unwrap() < 5000.0);
    assert!(colors(&mut client) == diffuse, "the eye moved, and a diffuse room changed");

    // A mirror shows something else to another eye, on every projector.
    client.apply(json!([lab::mirror()])).unwrap();
    let mirror = colors(&mut client);
    sender.send(&mut client, &packet(2, [1.5, 0.8, 2.5]).encode());
    let moved = colors(&mut client);
    assert!(mirror[0] != moved[0] && mirror[1] != moved[1], "the eye moved, and a mirror shows the same");

    // The socket's word is as good as a tracker's: the picture of an eye is that of the place.
    client.pose("head", [-1.5, f64::from(1.2f32), 2.0]).unwrap();
    assert_eq!(client.status().unwrap()["bodies"]["head"]["source"], "socket");
    assert!(colors(&mut client) == mirror, "the same eye sees another picture");
}

#[test]
fn what_is_no_pose_is_counted_with_its_reason() {
    let config = lab::room().replace("listen = \"127.0.0.1:0\"", "listen = \"127.0.0.1:0\"\nallow = [\"127.0.0.1\"]");
    let daemon = Daemon::start(&config).unwrap();
    let mut client = daemon.client().unwrap();
    client.apply(json!([lab::mirror()])).unwrap();
    let sender = Sender::new("127.0.0.1:0", &mut client);
    let good = packet(100, [1.0, 1.5, 2.0]).encode();
    sender.send(&mut client, &good);
    let before =
        (client.status().unwrap()["bodies"]["head"]["position_m"].clone(), client.snapshot("left", "color").unwrap());

    let with = |at: usize, bytes: &[u8]| {
        let mut datagram = good.to_vec();
        datagram[8..12].copy_from_slice(&200u32.to_le_bytes());
        datagram[at..at + bytes.len()].copy_from_slice(bytes);
        datagram
    };
    let turned = PosePacket { orientation: Some([0.0, 0.0, 0.0, 1.02]), ..packet(201, [9.0, 9.0, 9.0]) };
    let bad: Vec<(Vec<u8>, &str)> = vec![
        (vec![], "0 bytes"),
        (good[..63].to_vec(), "63 bytes"),
        ([&good[..], &[0]].concat(), "65 bytes"),
        (vec![0xa5; 9000], "9000 bytes"),
        (with(0, b"LNTQ"), "magic"),
        (with(4, &[2]), "version"),
        (with(24, &f32::NAN.to_le_bytes()), "finite"),
        (with(28, &f32::INFINITY.to_le_bytes()), "finite"),
        (turned.encode().to_vec(), "norm"),
        (with(6, &77u16.to_le_bytes()), "body id 77"),
        (good.to_vec(), "sequence 100"),
        (packet(99, [9.0, 9.0, 9.0]).encode().to_vec(), "sequence 99"),
        (packet(100u32.wrapping_sub(5), [9.0, 9.0, 9.0]).encode().to_vec(), "sequence 95"),
    ];
    for (count, (datagram, reason)) in bad.iter().enumerate() {
        let tracker = sender.send(&mut client, datagram);
        assert_eq!((&tracker["accepted"], &tracker["rejected"]), (&json!(1), &json!(count + 1)), "{reason}: {tracker}");
        let said = tracker["last_reject"].as_str().unwrap();
        assert!(said.contains(reason), "`{said}` does not say `{reason}`");
    }

    // A stranger is told by its address, whatever it says.
    let stranger = Sender::new("127.0.0.2:0", &mut client);
    let tracker = stranger.send(&mut client, &packet(300, [9.0, 9.0, 9.0]).encode());
    assert!(tracker["last_reject"].as_str().unwrap().contains("127.0.0.2"), "{tracker}");
    let status = client.status().unwrap();
    assert_eq!(status["bodies"]["head"]["position_m"], before.0);
    assert!(client.snapshot("left", "color").unwrap() == before.1, "another picture is shown");

    // Sequences wrap, and body and bits are told apart.
    let far = packet(100u32.wrapping_add(1 << 30), [0.0, 1.0, 2.0]);
    assert_eq!(sender.send(&mut client, &far.encode())["accepted"], 2);
    let hand =
        PosePacket { body_id: 2, orientation: Some([0.0, 1.0, 0.0, 0.0]), position_m: None, ..packet(1, [0.0; 3]) };
    assert_eq!(sender.send(&mut client, &hand.encode())["accepted"], 3);
    let hand = client.status().unwrap()["bodies"]["hand"].clone();
    assert_eq!((&hand["position_m"], &hand["orientation"]), (&json!([0.0, 0.0, 0.0]), &json!([0.0, 1.0, 0.0, 0.0])));
}

/// Seconds of processor time that a process has used: fields 14 and 15 of its `stat`, in hundredths (proc(5), USER_HZ).
fn cpu_s(pid: u32) -> f64 {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
    // The second field is in parentheses and may hold spaces.
    let fields: Vec<_> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
    let ticks: u64 = [11, 12].map(|field: usize| fields[field].parse::<u64>().unwrap()).iter().sum();
    ticks as f64 / 100.0
}

fn frames(client: &mut Client) -> Value {
    let status = client.status().unwrap();
    json!([status["projectors"]["left"]["frames"], status["projectors"]["right"]["frames"]])
}

#[test]
fn a_body_drives_a_node_and_rest_costs_nothing() {
    let config =
        lab::room().replace("name = \"hand\"", "name = \"hand\"\ndrives = \"node:ball\"\noffset_m = [0, 0.4, 0]");
    let daemon = Daemon::start(&config).unwrap();
    let mut client = daemon.client().unwrap();
    let sender = Sender::new("127.0.0.1:0", &mut client);
    let nodes = client.layer("left", "node").unwrap();
    let hand = |sequence, x: f32| PosePacket { body_id: 2, ..packet(sequence, [x, 0.0, 0.0]) }.encode();
    sender.send(&mut client, &hand(1, 0.5));
    assert_ne!(client.layer("left", "node").unwrap(), nodes, "the body moved, and its node did not");
    let told = client.ask_ok("scene.get", json!({})).unwrap();
    let ball = told["edits"].as_array().unwrap().iter().find(|edit| edit["add"]["node"] == "ball").unwrap();
    assert_eq!(ball["add"]["translation_m"], json!([0.5, 0.4, 0.0]), "{ball}");

    // What a client does beside it holds, and the body goes on.
    client.apply(json!([{"add": {"node": "box", "uri": "lantern:cube", "translation_m": [0, -2, 0]}}])).unwrap();
    sender.send(&mut client, &hand(2, 0.0));
    let status = client.status().unwrap();
    assert_eq!(status["scene"]["nodes"], 3);
    assert_eq!(status["projectors"]["left"]["revision"], status["projectors"]["right"]["revision"]);

    // At rest no frame is made, and next to no time is spent; a tracker that says the same again changes nothing.
    client.snapshot("left", "color").unwrap();
    let (shown, spent_s) = (frames(&mut client), cpu_s(daemon.pid()));
    thread::sleep(Duration::from_secs(3));
    let spent_s = cpu_s(daemon.pid()) - spent_s;
    assert!(spent_s < 0.06, "{spent_s} s of processor time in 3 s of rest");
    sender.send(&mut client, &hand(3, 0.0));
    client.snapshot("left", "color").unwrap();
    assert_eq!(frames(&mut client), shown, "nothing changed, and frames were made");
}

/// Edits that take their time, and a body that moves its node meanwhile: neither undoes the other.
#[test]
fn edits_and_driven_nodes_go_on_beside_each_other() {
    let config = lab::room().replace("name = \"hand\"", "name = \"hand\"\ndrives = \"node:ball\"");
    let daemon = Daemon::start(&config).unwrap();
    let (mut client, mut other) = (daemon.client().unwrap(), daemon.client().unwrap());
    let added = 12;
    thread::scope(|scope| {
        let editing = scope.spawn(|| {
            for number in 0..added {
                let node = format!("pot {number}");
                other.apply(json!([{"add": {"node": node, "uri": "lantern:teapot", "role": "virtual"}}])).unwrap();
            }
        });
        let mut moves = 0;
        while !editing.is_finished() {
            client.pose("hand", [0.001 * f64::from(moves % 500), 0.4, 0.0]).unwrap();
            moves += 1;
            thread::sleep(BREATH);
        }
    });
    client.pose("hand", [0.3, 0.4, 0.0]).unwrap();
    client.snapshot("left", "color").unwrap();
    let told = client.ask_ok("scene.get", json!({})).unwrap();
    let nodes: Vec<_> = told["edits"].as_array().unwrap().iter().filter(|edit| edit.get("add").is_some()).collect();
    assert_eq!(nodes.len(), 2 + added, "{told}");
    assert_eq!(nodes[1]["add"]["translation_m"], json!([0.3, 0.4, 0.0]), "{told}");
}

#[test]
fn all_projectors_show_one_revision() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let mut client = daemon.client().unwrap();
    let mut watcher = daemon.client().unwrap();
    thread::scope(|scope| {
        let editing = scope.spawn(|| {
            for step in 0..30 {
                let x = f64::from(step) * 0.01;
                client.apply(json!([{"set": {"node": "ball", "translation_m": [x, 0.4, 0]}}])).unwrap();
            }
        });
        let mut seen = Vec::new();
        while !editing.is_finished() {
            let status = watcher.status().unwrap();
            let of = |name: &str| status["projectors"][name]["revision"].as_u64().unwrap();
            assert_eq!(of("left"), of("right"), "{status}");
            seen.push(of("left"));
            thread::sleep(BREATH);
        }
        assert!(seen.is_sorted(), "revisions went back: {seen:?}");
        editing.join().unwrap();
    });
}
