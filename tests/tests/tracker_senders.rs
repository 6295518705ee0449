//! Programs that others wrote send poses to a real daemon, which listens to all of them at once, each by its protocol.
//!
//! A pose is sent in the sender's own numbers, which are made from ours by matrices: C·p and C·R·Cᵀ, where the rows of C are the
//! sender's axes in ours. The daemon converts by quaternions, angles and rotation vectors, so that what is tested is not
//! compared with itself; and each pose is one that a mirrored or swapped axis would change.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]

use std::net::{SocketAddr, UdpSocket};
use std::process::Command;
use std::time::Duration;

use glam::{DMat3, DQuat, DVec3, EulerRot};
use lantern_tests::client::Client;
use lantern_tests::harness::Daemon;
use lantern_tests::lab;
use lantern_tests::senders::{Pose, arrives, installed, port, psn, script, send, unity};
use natnet::{PlannedBody, SyntheticServer, Version};
use serde_json::{Value, json};
use vmc::rosc::encoder::encode;
use vmc::{DeviceTransform, DeviceType, IntoOSCPacket};

/// Trackers, by name, and what is theirs; each moves a body of its own name.
const TRACKERS: [(&str, &str); 13] = [
    ("vrchat", "protocol = \"osc\"\npreset = \"vrchat\"\nbodies = { head = \"vrchat\" }"),
    (
        "patch",
        "protocol = \"osc\"\naddress = \"/lab/{id}\"\narguments = [\"x\", \"y\", \"z\", \"qx\", \"qy\", \"qz\", \"qw\"]\naxes = \"z-up-left\"\nunits = \"cm\"\nbodies = { left = \"patch\" }",
    ),
    ("optitrack", "protocol = \"osc\"\npreset = \"optitrack\"\nbodies = { \"3\" = \"optitrack\" }"),
    ("vmc", "protocol = \"osc\"\npreset = \"vmc\"\nbodies = { \"LHR-8A41B2C7\" = \"vmc\" }"),
    ("natnet31", "protocol = \"natnet\"\nversion = \"3.1\"\nbodies = { \"7\" = \"natnet31\" }"),
    ("natnet40", "protocol = \"natnet\"\nversion = \"4.0\"\nbodies = { \"7\" = \"natnet40\" }"),
    ("natnet41", "protocol = \"natnet\"\nversion = \"4.1\"\nbodies = { \"7\" = \"natnet41\" }"),
    ("motive", "protocol = \"natnet\"\nserver = \"SERVER\"\nbodies = { \"7\" = \"motive\" }"),
    ("psn", "protocol = \"psn\"\nbodies = { \"Singer 60\" = \"psn\", \"3\" = \"spare\" }"),
    ("freed", "protocol = \"freed\"\nbodies = { \"1\" = \"freed\" }"),
    ("opentrack", "protocol = \"opentrack\"\nbodies = { face = \"opentrack\" }"),
    ("dtrack", "protocol = \"dtrack\"\nbodies = { \"0\" = \"dtrack\" }"),
    ("powerwall", "protocol = \"dtrack\"\nup = \"y\"\nbodies = { \"0\" = \"powerwall\" }"),
];

fn rows(x: DVec3, y: DVec3, z: DVec3) -> DMat3 {
    DMat3::from_cols(x, y, z).transpose()
}

/// x right, y ahead, z up.
fn z_up() -> DMat3 {
    rows(DVec3::X, DVec3::NEG_Z, DVec3::Y)
}

/// A pose as seven numbers in a sender's axes, in units of `per_m` to the metre.
fn seven(pose: &Pose, axes: DMat3, per_m: f64) -> [f64; 7] {
    let (p, r) = pose.seen(axes);
    let (p, q) = (p * per_m, DQuat::from_mat3(&r));
    [p.x, p.y, p.z, q.x, q.y, q.z, q.w]
}

/// A real daemon and a socket to send to its trackers from.
struct Lab {
    client: Client,
    socket: UdpSocket,
}

impl Lab {
    fn to(&mut self, tracker: &str) -> SocketAddr {
        SocketAddr::from(([127, 0, 0, 1], port(&mut self.client, tracker).unwrap()))
    }

    fn send(&mut self, tracker: &str, datagram: &[u8]) {
        let to = self.to(tracker);
        self.socket.send_to(datagram, to).unwrap();
    }

    #[track_caller]
    fn arrives(&mut self, body: &str, pose: &Pose) -> Value {
        arrives(&mut self.client, body, pose).unwrap_or_else(|error| panic!("{error:#}"))
    }
}

#[test]
fn every_sender_moves_its_body() {
    let server = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut config = lab::RENDER.to_owned() + lab::SCENE + "[[body]]\nname = \"spare\"\n";
    for (name, keys) in TRACKERS {
        let keys = keys.replace("SERVER", &server.local_addr().unwrap().to_string());
        config +=
            &format!("[[body]]\nname = \"{name}\"\n[[tracker]]\nname = \"{name}\"\nlisten = \"127.0.0.1:0\"\n{keys}\n");
    }
    let daemon = Daemon::start(&(config + &lab::stand(-1.0).toml("left"))).unwrap();
    let mut lab = Lab { client: daemon.client().unwrap(), socket: UdpSocket::bind("127.0.0.1:0").unwrap() };

    python_osc(&mut lab);
    oscsend(&mut lab);
    vmc_performer(&mut lab);
    natnet_synthetic(&mut lab);
    natnet_unicast(&mut lab, &server);
    posistagenet(&mut lab);
    freed_golden(&mut lab);
    opentrack(&mut lab);
    dtrack(&mut lab);

    // Nothing that was sent was refused, by any of them.
    let status = lab.client.status().unwrap();
    for (name, _) in TRACKERS {
        let tracker = &status["trackers"][name];
        let early = name == "motive" && tracker["last_reject"].as_str().unwrap_or_default().contains("unknown version");
        assert!(tracker["rejected"] == 0 || early, "{name}: {tracker:#}");
        assert!(tracker["accepted"].as_u64().unwrap() > 0, "{name}: {tracker:#}");
    }
}

/// Both of its messages in a bundle, and one message of our own description.
fn python_osc(lab: &mut Lab) {
    let python = installed("python/bin/python").unwrap();
    let mut osc = |tracker: &str, messages: Value| {
        let port = port(&mut lab.client, tracker).unwrap().to_string();
        send(Command::new(&python).arg(script("osc.py")).args([&port, &messages.to_string()])).unwrap();
    };
    // Unity's angles: z first, then x, then y, each in the sense of its left-handed axes, whose matrices look as ours do.
    let pose = Pose::number(1);
    let (p, r) = pose.seen(unity());
    let (y, x, z) = r.to_euler(EulerRot::YXZ);
    let angles = [x, y, z].map(f64::to_degrees);
    osc(
        "vrchat",
        json!([
            ["/tracking/trackers/head/position", p.x, p.y, p.z],
            ["/tracking/trackers/head/rotation", angles[0], angles[1], angles[2]],
        ]),
    );
    let other = Pose::number(2);
    let unreal = rows(DVec3::NEG_Z, DVec3::X, DVec3::Y);
    let [px, py, pz, qx, qy, qz, qw] = seven(&other, unreal, 100.0);
    osc("patch", json!([["/lab/left", px, py, pz, qx, qy, qz, qw]]));
    lab.arrives("vrchat", &pose);
    lab.arrives("patch", &other);
}

/// OptiTrack's bridges in both forms, by liblo.
fn oscsend(lab: &mut Lab) {
    let port = port(&mut lab.client, "optitrack").unwrap().to_string();
    let numbers = |pose: &Pose| seven(pose, DMat3::IDENTITY, 1.0).map(|x| x.to_string());
    let oscsend = |arguments: &[String]| {
        send(Command::new("oscsend").args(["127.0.0.1", &port]).args(arguments)).unwrap();
    };
    let [first, second] = [3, 4].map(Pose::number);
    let head = ["/rigidbody/3/transformation", "fffffff"].map(str::to_owned);
    oscsend(&[&head[..], &numbers(&first)].concat());
    lab.arrives("optitrack", &first);
    let head = ["/rb", "iiffffffff", "3", "2", "12.5"].map(str::to_owned);
    oscsend(&[&head[..], &numbers(&second)].concat());
    lab.arrives("optitrack", &second);
    // A body that is lost keeps its pose.
    oscsend(&["/rigidbody/3/tracked", "i", "0"].map(str::to_owned));
    let lost = wait_for(lab, |status| status["trackers"]["optitrack"]["bodies"]["3"]["tracked"] == false);
    assert_eq!(lost["trackers"]["optitrack"]["accepted"], 3);
    lab.arrives("optitrack", &second);
}

fn wait_for(lab: &mut Lab, is_there: impl Fn(&Value) -> bool) -> Value {
    for _ in 0..1000 {
        let status = lab.client.status().unwrap();
        if is_there(&status) {
            return status;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("{:#}", lab.client.status().unwrap());
}

/// Crate `vmc`: what it makes of a tracker of the Virtual Motion Capture protocol.
fn vmc_performer(lab: &mut Lab) {
    for (number, device) in [(5, DeviceType::HMD), (6, DeviceType::Controller), (7, DeviceType::Tracker)] {
        let pose = Pose::number(number);
        let [px, py, pz, qx, qy, qz, qw] = seven(&pose, unity(), 1.0).map(|x| x as f32);
        let transform = DeviceTransform::new(device, "LHR-8A41B2C7", [px, py, pz], [qx, qy, qz, qw], false);
        lab.send("vmc", &encode(&transform.into_osc_packet()).unwrap());
        lab.arrives("vmc", &pose);
    }
}

fn planned(id: i32, pose: &Pose) -> PlannedBody {
    let [px, py, pz, qx, qy, qz, qw] = seven(pose, DMat3::IDENTITY, 1.0).map(|x| x as f32);
    PlannedBody::tracked(id, [px, py, pz], [qx, qy, qz, qw])
}

/// Crate `natnet`'s synthetic server, of three versions; its body vanishes and returns.
fn natnet_synthetic(lab: &mut Lab) {
    for (number, version) in [(31, (3, 1)), (40, (4, 0)), (41, (4, 1))] {
        let tracker = format!("natnet{number}");
        let server = SyntheticServer::new(Version::new(version.0, version.1, 0, 0), 10_000_000);
        let [first, second] = [8 + number % 7, 9].map(Pose::number);
        let frame =
            |frame: i32, bodies: &[PlannedBody]| server.datagram(frame, f64::from(frame) * 0.01, bodies).unwrap();
        lab.send(&tracker, &frame(1, &[planned(6, &second), planned(7, &first)]));
        lab.arrives(&tracker, &first);
        let is_tracked = |tracked: bool| {
            let tracker = tracker.clone();
            move |status: &Value| status["trackers"][&tracker]["bodies"]["7"]["tracked"] == tracked
        };
        // It is lost, then left out beside another, then nothing is seen at all.
        let gone: [&[PlannedBody]; 3] = [&[PlannedBody::dropout(7)], &[planned(6, &second)], &[]];
        for (next, bodies) in (2..).zip(gone) {
            lab.send(&tracker, &frame(next, bodies));
            wait_for(lab, |status| status["trackers"][&tracker]["accepted"] == next);
            wait_for(lab, is_tracked(false));
            lab.arrives(&tracker, &first);
        }
        lab.send(&tracker, &frame(5, &[planned(7, &second)]));
        wait_for(lab, is_tracked(true));
        lab.arrives(&tracker, &second);
    }
}

/// A server that streams unicast: it is asked for its version, answers, and streams to where the question came from, for as long as it
/// hears that someone is there.
fn natnet_unicast(lab: &mut Lab, server: &UdpSocket) {
    server.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let mut buffer = [0; 1024];
    let mut heard = |what: u16| loop {
        let (length, from) = server.recv_from(&mut buffer).unwrap_or_else(|error| panic!("no message {what}: {error}"));
        if length >= 4 && u16::from_le_bytes([buffer[0], buffer[1]]) == what {
            return from;
        }
    };
    let (connect, keep_alive) = (0, 10);
    let client = heard(connect);
    let answer = natnet::ServerInfo {
        application_name: "Motive".to_owned(),
        server_version: Version::new(3, 1, 2, 1),
        protocol_version: Version::V4_1,
        high_res_clock_frequency: 10_000_000,
        connection: natnet::ConnectionInfo { data_port: client.port(), multicast: false, multicast_group: [0; 4] },
    };
    server.send_to(&answer.to_datagram().unwrap(), client).unwrap();
    assert_eq!(heard(keep_alive), client);
    let pose = Pose::number(11);
    let frame = SyntheticServer::new(Version::V4_1, 10_000_000).datagram(1, 1.0, &[planned(7, &pose)]).unwrap();
    server.send_to(&frame, client).unwrap();
    lab.arrives("motive", &pose);
}

/// npm's encoder of PosiStageNet: as many trackers as fill several packets, one of them known by its name.
fn posistagenet(lab: &mut Lab) {
    let to = lab.to("psn").to_string();
    let packets = psn(&to, 1..=60).unwrap();
    assert!(packets > 1, "one packet is no test of gathering");
    lab.arrives("psn", &Pose::number(60));
    let status = lab.arrives("spare", &Pose::number(3));
    assert_eq!(status["trackers"]["psn"]["incomplete"], 0);
}

/// The golden vector of FORMATS: pan 180°, tilt 90°, roll −180° at 131069, 131070, 131071 mm.
fn freed_golden(lab: &mut Lab) {
    let golden = [
        0xd1, 0x01, 0x5a, 0, 0, 0x2d, 0, 0, 0xa6, 0, 0, 0x7f, 0xff, 0x40, 0x7f, 0xff, 0x80, 0x7f, 0xff, 0xc0, 1, 2, 3,
        4, 5, 6, 0, 0, 0x32,
    ];
    lab.send("freed", &golden);
    // Turned round it faces back; looking up, its top is ahead; upside down its top is at the back and right is right again.
    let rotation = DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y);
    lab.arrives("freed", &Pose { position_m: DVec3::new(131.069, 131.071, -131.070), rotation });
}

/// Yaw to the left, pitch up, roll clockwise from behind; cm and degrees.
fn opentrack(lab: &mut Lab) {
    let pose = Pose::number(12);
    let (yaw, pitch, roll) = pose.rotation.to_euler(EulerRot::YXZ);
    let p = pose.position_m * 100.0;
    let numbers = [p.x, p.y, p.z, yaw.to_degrees(), pitch.to_degrees(), -roll.to_degrees()];
    lab.send("opentrack", &numbers.map(f64::to_le_bytes).concat());
    lab.arrives("opentrack", &pose);
}

/// The lines of FORMATS, with either axis up.
fn dtrack(lab: &mut Lab) {
    for (tracker, axes, number) in [("dtrack", z_up(), 13), ("powerwall", DMat3::IDENTITY, 14)] {
        let pose = Pose::number(number);
        let (p, r) = pose.seen(axes);
        let p = p * 1000.0;
        let b = r.to_cols_array().map(|b| format!("{b:.6}")).join(" ");
        let body = format!("6d 1 [0 1.000][{:.3} {:.3} {:.3} 0.0 0.0 0.0][{b}]", p.x, p.y, p.z);
        lab.send(tracker, format!("fr 21753\r\nts 39596.024831\r\n6dcal 1\r\n{body}\r\n6df 0\r\n").as_bytes());
        lab.arrives(tracker, &pose);
    }
}
