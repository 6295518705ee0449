//! Trackers over real sockets on the loopback interface.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]

use glam::DVec3;
use lantern_config::{Body, Drives, Protocol, Tracker};
use lantern_proto::PosePacket;
use lantern_proto::status::TrackerStatus;
use lantern_tracking::{Bodies, TrackerError, Trackers};
use std::collections::BTreeMap;
use std::net::UdpSocket;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

const IDENTITY: [[f64; 4]; 4] =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

fn tracker(name: &str, listen: &str) -> Tracker {
    Tracker {
        name: name.into(),
        protocol: Protocol::Lantern,
        listen: listen.parse().unwrap(),
        interface: None,
        allow: vec!["127.0.0.1".parse().unwrap()],
        bodies: BTreeMap::from([("1".to_owned(), "head".to_owned())]),
        world_from_tracker: IDENTITY,
        predict_lead_ms: None,
    }
}

fn bodies() -> Arc<Bodies> {
    let head = Body { name: "head".into(), drives: Some(Drives::Viewer), position_m: [0.0; 3], offset_m: [0.0; 3] };
    Arc::new(Bodies::new(&[head]))
}

fn packet(sequence: u32) -> [u8; 64] {
    let position_m = Some([sequence as f32, 1.0, 2.0]);
    PosePacket { body_id: 1, sequence, position_m, ..PosePacket::default() }.encode()
}

/// Waits until the tracker has counted `count` datagrams.
fn settle(trackers: &Trackers, name: &str, count: u64) -> TrackerStatus {
    let deadline = Instant::now() + Duration::from_secs(10);
    loop {
        let status = trackers.status()[name].clone();
        if status.accepted + status.rejected >= count {
            return status;
        }
        assert!(Instant::now() < deadline, "only {status:?} after 10 s");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn runtime() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap()
}

#[test]
fn packets_move_bodies_and_garbage_is_counted() {
    let (runtime, bodies) = (runtime(), bodies());
    let woken = Arc::new(AtomicUsize::new(0));
    let count = woken.clone();
    let trackers = Trackers::start(runtime.handle().clone(), &[tracker("t", "127.0.0.1:0")], bodies.clone()).unwrap();
    bodies.set_waker(Arc::new(move || {
        count.fetch_add(1, Ordering::SeqCst);
    }));

    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    sender.connect(trackers.address("t").unwrap()).unwrap();
    for sequence in 1..=20 {
        sender.send(&packet(sequence)).unwrap();
    }
    let status = settle(&trackers, "t", 20);
    assert_eq!((status.accepted, status.rejected, status.last_reject.as_deref()), (20, 0, None));
    assert!(status.rate_hz >= 1.0, "{status:?}");
    assert_eq!(bodies.eye_m(), Some(DVec3::new(20.0, 1.0, 2.0)));
    assert_eq!(woken.load(Ordering::SeqCst), 20);
    let body = &bodies.status()["head"];
    assert_eq!((body.position_m, body.source.as_str()), ([20.0, 1.0, 2.0], "t"));
    assert!(body.age_ms < 10_000.0);

    for garbage in [&b""[..], b"x", &[0xff; 64], &[0; 9000], &packet(7)] {
        sender.send(garbage).unwrap();
    }
    let status = settle(&trackers, "t", 25);
    assert_eq!((status.accepted, status.rejected, status.dropped_old), (20, 5, 1));
    assert_eq!(bodies.eye_m(), Some(DVec3::new(20.0, 1.0, 2.0)));
    assert_eq!(woken.load(Ordering::SeqCst), 20);
}

#[test]
fn strangers_are_not_heard() {
    let (runtime, bodies) = (runtime(), bodies());
    let elsewhere = Tracker { allow: vec!["192.0.2.1".parse().unwrap()], ..tracker("t", "127.0.0.1:0") };
    let trackers = Trackers::start(runtime.handle().clone(), &[elsewhere], bodies.clone()).unwrap();
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    sender.send_to(&packet(1), trackers.address("t").unwrap()).unwrap();
    let status = settle(&trackers, "t", 1);
    assert_eq!((status.accepted, status.rejected), (0, 1));
    assert!(status.last_reject.unwrap().contains("127.0.0.1"));
    assert_eq!(bodies.eye_m(), Some(DVec3::ZERO));
}

#[test]
fn a_socket_of_both_families_hears_its_natnet_server() {
    let (runtime, bodies) = (runtime(), bodies());
    let server = UdpSocket::bind("127.0.0.1:0").unwrap();
    let settings = lantern_config::Natnet { version: None, server: Some(server.local_addr().unwrap()) };
    let tracker = Tracker { protocol: Protocol::Natnet(settings), ..tracker("t", "[::]:0") };
    let trackers = Trackers::start(runtime.handle().clone(), &[tracker], bodies).unwrap();

    server.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    let mut buffer = [0; 64];
    let (length, from) = server.recv_from(&mut buffer).unwrap();
    assert_eq!(buffer[..length], [0, 0, 0, 0], "it is not asked for its version");
    // A name of 256 bytes, the server's version, and the stream's: 4.1.
    let answer = [&[1, 0, 8, 1][..], &[0; 256], &[3, 1, 2, 1], &[4, 1, 0, 0]].concat();
    server.send_to(&answer, from).unwrap();
    let deadline = Instant::now() + Duration::from_secs(10);
    loop {
        let status = trackers.status()["t"].clone();
        if status.others.packets == 1 {
            assert_eq!((status.rejected, status.last_reject), (0, None));
            return;
        }
        assert!(Instant::now() < deadline, "only {status:?} after 10 s");
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn a_taken_port_is_refused_and_changes_nothing() {
    let (runtime, bodies) = (runtime(), bodies());
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let mut trackers =
        Trackers::start(runtime.handle().clone(), &[tracker("t", "127.0.0.1:0")], bodies.clone()).unwrap();
    let error = trackers.configure(&[tracker("u", &address)]).unwrap_err();
    let TrackerError::Bind { ref name, .. } = error else { panic!("{error}") };
    assert_eq!(name, "u");
    assert!(error.to_string().contains(&address), "{error}");

    // The one before is heard as before.
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    sender.send_to(&packet(1), trackers.address("t").unwrap()).unwrap();
    assert_eq!(settle(&trackers, "t", 1).accepted, 1);
}

#[test]
fn another_configuration_keeps_sockets_and_counts() {
    let (runtime, bodies) = (runtime(), bodies());
    let mut trackers =
        Trackers::start(runtime.handle().clone(), &[tracker("t", "127.0.0.1:0")], bodies.clone()).unwrap();
    let address = trackers.address("t").unwrap();
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    sender.send_to(&packet(5), address).unwrap();
    settle(&trackers, "t", 1);

    let moved = Tracker {
        world_from_tracker: [[1.0, 0.0, 0.0, 100.0], IDENTITY[1], IDENTITY[2], IDENTITY[3]],
        ..tracker("t", "127.0.0.1:0")
    };
    trackers.configure(&[moved]).unwrap();
    assert_eq!(trackers.address("t"), Some(address));
    sender.send_to(&packet(6), address).unwrap();
    assert_eq!(settle(&trackers, "t", 2).accepted, 2);
    assert_eq!(bodies.eye_m(), Some(DVec3::new(106.0, 1.0, 2.0)));

    // One that is gone has let go of its port.
    trackers.configure(&[]).unwrap();
    assert!(trackers.status().is_empty());
    UdpSocket::bind(address).unwrap();
}

/// A port that was free a moment ago.
fn free_port() -> u16 {
    UdpSocket::bind("0.0.0.0:0").unwrap().local_addr().unwrap().port()
}

#[test]
fn an_address_may_grow_over_its_own_port_and_shrink_again() {
    let (runtime, bodies) = (runtime(), bodies());
    let port = free_port();
    let [narrow, wide] = ["127.0.0.1", "0.0.0.0"].map(|ip| format!("{ip}:{port}"));
    let mut trackers = Trackers::start(runtime.handle().clone(), &[tracker("t", &narrow)], bodies.clone()).unwrap();
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    for (sequence, listen) in (1..).zip([&wide, &narrow, &wide, &narrow]) {
        trackers.configure(&[tracker("t", listen)]).unwrap();
        assert_eq!(trackers.address("t").unwrap().to_string(), *listen);
        sender.send_to(&packet(sequence), &narrow).unwrap();
        assert_eq!(settle(&trackers, "t", 1).accepted, 1);
        assert_eq!(bodies.eye_m().unwrap().x, f64::from(sequence));
    }
}

#[test]
fn a_socket_that_made_way_in_vain_comes_back() {
    let (runtime, bodies) = (runtime(), bodies());
    let port = free_port();
    let [narrow, wide] = ["127.0.0.1", "0.0.0.0"].map(|ip| format!("{ip}:{port}"));
    let mut trackers = Trackers::start(runtime.handle().clone(), &[tracker("t", &narrow)], bodies.clone()).unwrap();
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    sender.send_to(&packet(1), &narrow).unwrap();
    settle(&trackers, "t", 1);

    // The wide one can be had, the other cannot.
    let taken = sender.local_addr().unwrap().to_string();
    let error = trackers.configure(&[tracker("t", &wide), tracker("u", &taken)]).unwrap_err();
    assert!(matches!(&error, TrackerError::Bind { name, .. } if name == "u"), "{error}");
    assert_eq!(trackers.address("t").unwrap().to_string(), narrow);
    sender.send_to(&packet(2), &narrow).unwrap();
    let status = settle(&trackers, "t", 2);
    assert_eq!((status.accepted, status.rejected), (2, 0), "{status:?}");
    assert_eq!(bodies.eye_m().unwrap().x, 2.0);
}
