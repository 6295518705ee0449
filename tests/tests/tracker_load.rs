//! Four trackers, 1,000 packets a second each: what the daemon is sent it takes. What the system has thrown away before the daemon
//! could take it is counted apart.
//!
//! CI sends for two seconds. `cargo test -p lantern-tests --test tracker_load -- --ignored --nocapture` does so for a minute while pictures
//! are made, and prints what that costs; docs/performance.md has the figures.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]

use std::fs;
use std::net::UdpSocket;
use std::thread;
use std::time::{Duration, Instant};

use lantern_proto::PosePacket;
use lantern_tests::client::Client;
use lantern_tests::harness::Daemon;
use lantern_tests::lab;
use lantern_tests::senders::port;
use natnet::{PlannedBody, SyntheticServer, Version};
use serde_json::{Value, json};
use vmc::rosc::encoder::encode;
use vmc::{DeviceTransform, DeviceType, IntoOSCPacket};

const PER_S: u32 = 1000;

const TRACKERS: [(&str, &str); 4] = [
    ("lantern", "protocol = \"lantern\"\nbodies = { \"1\" = \"lantern\" }"),
    ("natnet", "protocol = \"natnet\"\nversion = \"4.1\"\nbodies = { \"1\" = \"natnet\" }"),
    ("osc", "protocol = \"osc\"\npreset = \"vmc\"\nbodies = { \"1\" = \"osc\" }"),
    ("dtrack", "protocol = \"dtrack\"\nbodies = { \"1\" = \"dtrack\" }"),
];

fn config() -> String {
    let tracker = |(name, keys): (&str, &str)| {
        format!("[[body]]\nname = \"{name}\"\n[[tracker]]\nname = \"{name}\"\nlisten = \"127.0.0.1:0\"\n{keys}\n")
    };
    let eye = "[[body]]\nname = \"eye\"\ndrives = \"viewer\"\nposition_m = [0.5, 1.6, 2.5]\n";
    let trackers = TRACKERS.map(tracker).concat();
    [lab::RENDER, lab::SCENE, eye, &trackers, &lab::stand(-1.0).toml("left")].join("\n")
}

/// The packet of a tracker with a number, each at another place.
fn packet(tracker: &str, number: u32) -> Vec<u8> {
    let x = (number % 1000) as f32 * 0.001;
    match tracker {
        "lantern" => {
            PosePacket { body_id: 1, sequence: number, position_m: Some([x, 1.0, 2.0]), ..PosePacket::default() }
                .encode()
                .into()
        }
        "natnet" => {
            let bodies = [1, 2, 3, 4].map(|id| PlannedBody::tracked(id, [x, 1.0, 2.0], [0.0, 0.0, 0.0, 1.0]));
            SyntheticServer::new(Version::V4_1, 1_000_000)
                .datagram(number as i32, f64::from(number) * 0.001, &bodies)
                .unwrap()
        }
        "osc" => {
            let pose = DeviceTransform::new(DeviceType::Tracker, "1", [x, 1.0, 2.0], [0.0, 0.0, 0.0, 1.0], false);
            encode(&pose.into_osc_packet()).unwrap()
        }
        _ => {
            let bodies = "[1 1.000][1 2 3 0 0 0][1 0 0 0 1 0 0 0 1][2 1.000][1 2 3 0 0 0][1 0 0 0 1 0 0 0 1]";
            let bodies = bodies.replacen("[1 2 3", &format!("[{} 2 3", number % 1000), 1);
            format!("fr {number}\r\nts {:.6}\r\n6dcal 2\r\n6d 2 {bodies}\r\n", f64::from(number) * 0.001).into_bytes()
        }
    }
}

/// Sends by all trackers at once, and gives how many packets each has sent.
fn send_for(client: &mut Client, seconds: u32, first: u32) -> u32 {
    let count = seconds * PER_S;
    let ports = TRACKERS.map(|(name, _)| (name, port(client, name).unwrap()));
    thread::scope(|scope| {
        for (name, port) in ports {
            scope.spawn(move || {
                let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
                socket.connect(("127.0.0.1", port)).unwrap();
                let start = Instant::now();
                for number in 0..count {
                    socket.send(&packet(name, first + number)).unwrap();
                    let due = start + Duration::from_secs(1) * (number + 1) / PER_S;
                    thread::sleep(due.saturating_duration_since(Instant::now()));
                }
            });
        }
    });
    count
}

/// Every packet was taken, but for those that never reached the daemon. Gives how many those were.
fn none_is_lost(client: &mut Client, sent: u64) -> u64 {
    let mut dropped_in_all = 0;
    for (name, _) in TRACKERS {
        let started = Instant::now();
        loop {
            let tracker = client.status().unwrap()["trackers"][name].clone();
            let number = |key: &str| tracker[key].as_u64().unwrap();
            let (accepted, dropped) = (number("accepted"), number("kernel_dropped"));
            assert_eq!((number("rejected"), number("dropped_old")), (0, 0), "{tracker:#}");
            assert_eq!(tracker["others"]["packets"], 0, "{tracker:#}");
            if accepted + dropped == sent {
                dropped_in_all += dropped;
                break;
            }
            assert!(
                started.elapsed() < Duration::from_secs(10),
                "of {sent} packets {accepted} were taken: {tracker:#}"
            );
            thread::sleep(Duration::from_millis(20));
        }
    }
    dropped_in_all
}

#[test]
fn the_daemon_loses_none() {
    let daemon = Daemon::start(&config()).unwrap();
    let mut client = daemon.client().unwrap();
    let sent = send_for(&mut client, 2, 1);
    none_is_lost(&mut client, sent.into());
}

/// Seconds of processor time of a process's threads whose names begin so (proc(5): `stat`, fields 14 and 15, hundredths).
fn cpu_s(pid: u32, threads: &str) -> f64 {
    let tasks = fs::read_dir(format!("/proc/{pid}/task")).unwrap();
    let stat = |task: fs::DirEntry| fs::read_to_string(task.path().join("stat")).ok();
    let ticks = |stat: String| {
        let (head, rest) = stat.rsplit_once(')')?;
        head.split_once('(')?.1.starts_with(threads).then_some(())?;
        let fields: Vec<_> = rest.split_whitespace().collect();
        Some(fields[11].parse::<f64>().ok()? + fields[12].parse::<f64>().ok()?)
    };
    tasks.flatten().filter_map(stat).filter_map(ticks).sum::<f64>() / 100.0
}

/// Moves the eye 30 times a second before a mirror for so long, so that pictures are made; gives their number and times.
fn frames_for(client: &mut Client, seconds: u32) -> (u64, Value) {
    let shown = |client: &mut Client| client.status().unwrap()["projectors"]["left"].clone();
    let before = shown(client)["frames"].as_u64().unwrap();
    let start = Instant::now();
    for turn in 0..seconds * 30 {
        client.pose("eye", [0.5 + 0.001 * f64::from(turn % 500), 1.6, 2.5]).unwrap();
        let due = start + Duration::from_secs(1) * (turn + 1) / 30;
        thread::sleep(due.saturating_duration_since(Instant::now()));
    }
    let after = shown(client);
    (after["frames"].as_u64().unwrap() - before, after["frame_ms"].clone())
}

#[test]
#[ignore = "takes two minutes, and measures"]
fn a_minute_of_four_trackers() {
    let daemon = Daemon::start(&config()).unwrap();
    let mut client = daemon.client().unwrap();
    client.apply(json!([lab::mirror()])).unwrap();
    frames_for(&mut client, 5);

    // Nothing else going on: all that the process does is to listen.
    let before = cpu_s(daemon.pid(), "");
    let mut sent = send_for(&mut client, 20, 1);
    println!("listening alone: {:.1} % of a core", (cpu_s(daemon.pid(), "") - before) / 20.0 * 100.0);

    // Pictures without packets, then a minute of both.
    let quiet = frames_for(&mut client, 20);
    println!("frames in 20 s without packets: {} {}", quiet.0, quiet.1);
    let before = cpu_s(daemon.pid(), "tokio");
    let mut other = daemon.client().unwrap();
    let busy = thread::scope(|scope| {
        let frames = scope.spawn(|| frames_for(&mut other, 60));
        sent += send_for(&mut client, 60, sent + 1);
        frames.join().unwrap()
    });
    let spent_s = cpu_s(daemon.pid(), "tokio") - before;
    println!("frames in 60 s with packets: {} {}", busy.0, busy.1);
    println!("threads that listen, meanwhile: {:.1} % of a core", spent_s / 60.0 * 100.0);
    println!("{} packets, of which the system threw {} away", 4 * sent, none_is_lost(&mut client, sent.into()));
}
