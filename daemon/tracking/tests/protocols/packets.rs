//! Good packets of every protocol, written by hand from the protocols' descriptions, and trackers that hear them.

use glam::{DQuat, DVec3};
use lantern_config::{Body, Config, Drives, Tracker};
use lantern_proto::status::TrackerStatus;
use lantern_tracking::{Bodies, Source};
use std::net::SocketAddr;
use std::path::Path;
use std::time::{Duration, Instant};

pub(crate) const SENDER: &str = "127.0.0.1:5000";

/// A tracker by its keys but for `name`, `listen` and, where it is "1" = "head", `bodies`.
pub(crate) fn tracker(keys: &str) -> Tracker {
    let bodies = if keys.contains("bodies") { "" } else { "bodies = { \"1\" = \"head\" }" };
    let listen = if keys.contains("listen") { "" } else { "listen = \"127.0.0.1:7000\"" };
    let text = format!(
        "[[body]]\nname = \"head\"\n[[body]]\nname = \"hand\"\n[[tracker]]\nname = \"t\"\n{listen}\n{bodies}\n{keys}\n\
         [[projector]]\nname = \"any\"\nresolution_px = [8, 8]\n[projector.calibration]\nconvention = \"opengl\"\n\
         projection = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1.01, -0.2], [0, 0, -1, 0]]\n\
         view = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -2], [0, 0, 0, 1]]\n"
    );
    let config = Config::parse(&text, "test.toml", Path::new("/"));
    let config = config.unwrap_or_else(|problems| panic!("{problems:#?}\n{text}"));
    config.trackers[0].clone()
}

/// A tracker that hears, and the bodies `head` and `hand` that it moves.
pub(crate) struct Listener {
    pub(crate) source: Source,
    pub(crate) bodies: Bodies,
    pub(crate) now: Instant,
}

impl Listener {
    pub(crate) fn new(keys: &str) -> Self {
        let body = |name: &str, drives| Body {
            name: name.into(),
            drives: Some(drives),
            position_m: [0.0; 3],
            offset_m: [0.0; 3],
        };
        let bodies = Bodies::new(&[body("head", Drives::Viewer), body("hand", Drives::Node("hand".into()))]);
        Self { source: Source::new(&tracker(keys)), bodies, now: Instant::now() }
    }

    /// Hears a datagram, a hundredth of a second after the one before.
    pub(crate) fn hear(&mut self, datagram: &[u8]) -> TrackerStatus {
        self.hear_from(datagram, SENDER)
    }

    pub(crate) fn hear_from(&mut self, datagram: &[u8], from: &str) -> TrackerStatus {
        self.now += Duration::from_millis(10);
        let from: SocketAddr = from.parse().unwrap();
        self.source.hear(datagram, from, &self.bodies, self.now);
        self.source.status()
    }

    /// Hears one that must be good.
    #[track_caller]
    pub(crate) fn good(&mut self, datagram: &[u8]) -> TrackerStatus {
        let before = self.source.status().accepted;
        let status = self.hear(datagram);
        assert_eq!(status.accepted, before + 1, "{status:?}");
        status
    }

    /// Hears one that must be refused in these words, and move nothing.
    #[track_caller]
    pub(crate) fn bad(&mut self, datagram: &[u8], says: &str) -> TrackerStatus {
        let (before, generation) = (self.source.status().rejected, self.bodies.generation());
        let status = self.hear(datagram);
        assert_eq!((status.rejected, self.bodies.generation()), (before + 1, generation), "{status:?}");
        assert!(status.last_reject.as_deref().unwrap().contains(says), "{status:?} does not say {says}");
        status
    }

    pub(crate) fn pose(&self, body: &str) -> (DVec3, DQuat) {
        let pose = self.bodies.get(body).unwrap();
        (pose.position_m, pose.orientation)
    }

    /// Whether a body is where it should be, and where its right, top and back point.
    #[track_caller]
    pub(crate) fn stands(&self, body: &str, position_m: [f64; 3], right_up_back: [[f64; 3]; 3]) {
        let (p, q) = self.pose(body);
        assert!((p - DVec3::from_array(position_m)).length() < 1e-5, "at {p}, not {position_m:?}");
        for (axis, image) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().zip(right_up_back) {
            let error = (q * axis - DVec3::from_array(image)).length();
            assert!(error < 1e-4, "{axis} is at {}, not {image:?}", q * axis);
        }
    }
}

/// A FreeD message of a camera, from degrees and mm.
pub(crate) fn freed(camera: u8, pan_tilt_roll: [f64; 3], x_y_z_mm: [f64; 3]) -> Vec<u8> {
    let mut bytes = vec![0xd1, camera];
    let mut put = |number: f64| bytes.extend_from_slice(&(number.round() as i32).to_be_bytes()[1..]);
    pan_tilt_roll.into_iter().for_each(|angle| put(angle * 32768.0));
    x_y_z_mm.into_iter().for_each(|length| put(length * 64.0));
    bytes.extend_from_slice(&[1, 2, 3, 4, 5, 6, 0, 0]);
    let sum = bytes.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte));
    bytes.push(0x40u8.wrapping_sub(sum));
    bytes
}

pub(crate) fn opentrack(pose: [f64; 6]) -> Vec<u8> {
    pose.iter().flat_map(|number| number.to_le_bytes()).collect()
}

/// One chunk of PosiStageNet.
pub(crate) fn chunk(id: u16, has_chunks: bool, inner: &[u8]) -> Vec<u8> {
    let header = u32::from(id) | (inner.len() as u32) << 16 | u32::from(has_chunks) << 31;
    [&header.to_le_bytes(), inner].concat()
}

pub(crate) fn vector(id: u16, numbers: [f32; 3]) -> Vec<u8> {
    chunk(id, false, &numbers.map(f32::to_le_bytes).concat())
}

pub(crate) fn psn_header(time_us: u64, frame: u8, packets: u8) -> Vec<u8> {
    chunk(0, false, &[&time_us.to_le_bytes()[..], &[2, 3, frame, packets]].concat())
}

/// A packet of trackers: ids and their fields.
pub(crate) fn psn(header: Vec<u8>, trackers: &[(u16, Vec<u8>)]) -> Vec<u8> {
    let trackers: Vec<u8> = trackers.iter().flat_map(|(id, fields)| chunk(*id, true, fields)).collect();
    chunk(0x6755, true, &[header, chunk(1, true, &trackers)].concat())
}

pub(crate) fn psn_names(names: &[(u16, &str)]) -> Vec<u8> {
    let named = |(id, name): &(u16, &str)| chunk(*id, true, &chunk(0, false, name.as_bytes()));
    let list: Vec<u8> = names.iter().flat_map(named).collect();
    chunk(0x6756, true, &[psn_header(1, 1, 1), chunk(1, false, b"server"), chunk(2, true, &list)].concat())
}

/// A rigid body of NatNet: id, position, quaternion, tracked.
pub(crate) type RigidBody = (i32, [f32; 3], [f32; 4], bool);

/// A frame of NatNet with something in every section.
pub(crate) fn natnet(version: (u8, u8), number: i32, time_s: f64, bodies: &[RigidBody]) -> Vec<u8> {
    let sized = version >= (4, 1);
    let body = |(id, p, q, tracked): &RigidBody| {
        let numbers: Vec<u8> = p.iter().chain(q).flat_map(|x| x.to_le_bytes()).collect();
        [&id.to_le_bytes()[..], &numbers, &0.001f32.to_le_bytes(), &u16::from(*tracked).to_le_bytes()].concat()
    };
    let section = |count: u32, inner: Vec<u8>| {
        let size = if sized { (inner.len() as u32).to_le_bytes().to_vec() } else { vec![] };
        [count.to_le_bytes().to_vec(), size, inner].concat()
    };
    let three = [1.0f32, 2.0, 3.0].map(f32::to_le_bytes).concat();
    let bone = body(&(7, [1.0; 3], [0.0, 0.0, 0.0, 1.0], true));
    let labelled = [&5i32.to_le_bytes()[..], &three, &[0; 4], &[0; 2], &[0; 4]].concat();
    let device =
        [&1i32.to_le_bytes()[..], &2i32.to_le_bytes(), &1i32.to_le_bytes(), &[0; 4], &0i32.to_le_bytes()].concat();
    let mut payload = number.to_le_bytes().to_vec();
    payload.extend(section(1, [&b"set\0"[..], &1i32.to_le_bytes(), &three].concat()));
    payload.extend(section(1, three.clone()));
    payload.extend(section(bodies.len() as u32, bodies.iter().flat_map(body).collect()));
    payload.extend(section(1, [&3i32.to_le_bytes()[..], &1i32.to_le_bytes(), &bone].concat()));
    if sized {
        let asset = [&4i32.to_le_bytes()[..], &1i32.to_le_bytes(), &bone, &1i32.to_le_bytes(), &labelled].concat();
        payload.extend(section(1, asset));
    }
    payload.extend(section(1, labelled));
    payload.extend(section(1, device.clone()));
    payload.extend(section(1, device));
    payload.extend([0; 8]);
    payload.extend(time_s.to_le_bytes());
    payload.extend([0; 24]);
    payload.extend(if sized { &[0; 8][..] } else { &[] });
    payload.extend([0; 6]);
    natnet_message(7, &payload)
}

pub(crate) fn natnet_message(id: u16, payload: &[u8]) -> Vec<u8> {
    [&id.to_le_bytes()[..], &(payload.len() as u16).to_le_bytes(), payload].concat()
}

/// What a NatNet server answers.
pub(crate) fn natnet_answer(version: [u8; 2]) -> Vec<u8> {
    let mut payload = vec![0; 256];
    payload[..6].copy_from_slice(b"Motive");
    payload.extend([3, 1, 2, 1, version[0], version[1], 0, 0]);
    payload.extend(10_000_000u64.to_le_bytes());
    payload.extend([0xe7, 0x05, 1, 239, 255, 42, 99]);
    natnet_message(1, &payload)
}

/// A string of OSC, with its zeros.
pub(crate) fn osc_string(text: &str) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    bytes.resize((text.len() / 4 + 1) * 4, 0);
    bytes
}

/// A message of a name, if it has one, and floats.
pub(crate) fn osc(address: &str, name: Option<&str>, numbers: &[f32]) -> Vec<u8> {
    let tags = format!(",{}{}", if name.is_some() { "s" } else { "" }, "f".repeat(numbers.len()));
    let numbers = numbers.iter().flat_map(|number| number.to_be_bytes()).collect();
    [osc_string(address), osc_string(&tags), name.map(osc_string).unwrap_or_default(), numbers].concat()
}

pub(crate) fn osc_bundle(time: u64, elements: &[Vec<u8>]) -> Vec<u8> {
    let element = |element: &Vec<u8>| [&(element.len() as u32).to_be_bytes()[..], element].concat();
    [b"#bundle\0".to_vec(), time.to_be_bytes().to_vec(), elements.iter().flat_map(element).collect()].concat()
}
