//! One tracker: who may speak, whom it means, and where its frame lies in the world.

use crate::bodies::{Bodies, is_place};
use crate::clock::Timekeeper;
use crate::counters::Counters;
use crate::pose::Update;
use crate::protocol::{Protocol, Reading};
use glam::{DMat3, DMat4, DQuat, DVec3};
use lantern_config::Tracker;
use lantern_proto::pose_packet::sequence_is_newer;
use std::collections::{BTreeMap, HashMap};
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::time::Instant;

/// From a tracker's frame to the world: a rotation, a translation and one scale.
#[derive(Clone, Copy, Debug)]
struct WorldFromTracker {
    matrix: DMat4,
    rotation: DQuat,
}

impl WorldFromTracker {
    fn new(rows: [[f64; 4]; 4]) -> Self {
        let matrix = DMat4::from_cols_array_2d(&rows).transpose();
        // The configuration has seen to it that the columns are orthogonal, equally long and right-handed.
        let scale = matrix.x_axis.truncate().length();
        let rotation = DQuat::from_mat3(&(DMat3::from_mat4(matrix) * scale.recip())).normalize();
        Self { matrix, rotation }
    }

    fn point(&self, p: DVec3) -> DVec3 {
        self.matrix.transform_point3(p)
    }

    fn vector(&self, v: DVec3) -> DVec3 {
        self.matrix.transform_vector3(v)
    }
}

/// A tracker's settings and what it has heard; the socket is another's.
pub(crate) struct Source {
    name: Arc<str>,
    protocol_name: &'static str,
    allow: Vec<IpAddr>,
    bodies_by_id: BTreeMap<u16, String>,
    world_from_tracker: WorldFromTracker,
    protocol: Box<dyn Protocol>,
    /// By body id: the newest sequence. Only ids that the configuration names get in, so it stays small.
    last_sequence: HashMap<u16, u32>,
    timekeeper: Timekeeper,
    counters: Counters,
}

impl Source {
    pub(crate) fn new(tracker: &Tracker) -> Self {
        Self {
            name: Arc::from(tracker.name.as_str()),
            protocol_name: tracker.protocol.as_str(),
            allow: tracker.allow.clone(),
            bodies_by_id: tracker.bodies.clone(),
            world_from_tracker: WorldFromTracker::new(tracker.world_from_tracker),
            protocol: match tracker.protocol {
                lantern_config::Protocol::Lantern => Box::new(crate::lantern::Lantern),
            },
            last_sequence: HashMap::new(),
            timekeeper: Timekeeper::new(tracker),
            counters: Counters::new(Instant::now()),
        }
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Takes the settings of another configuration and keeps the counts, if it is still the same tracker.
    ///
    /// Sequences are forgotten: a sender that started again from 0 is heard again after a reload.
    pub(crate) fn configure(&mut self, tracker: &Tracker) {
        let new = Self::new(tracker);
        let same = new.name == self.name;
        let old = std::mem::replace(self, new);
        if same {
            self.counters = old.counters;
        }
    }

    pub(crate) fn status(&mut self, listen: String) -> lantern_proto::status::TrackerStatus {
        self.counters.status(self.protocol_name, listen, Instant::now())
    }

    /// Takes one datagram: it moves a body, or it is counted with the reason why not.
    pub(crate) fn hear(&mut self, datagram: &[u8], from: SocketAddr, bodies: &Bodies, received: Instant) {
        // An IPv4 sender to an IPv6 socket is still the IPv4 address that people write.
        let address = from.ip().to_canonical();
        if !self.allow.contains(&address) {
            return self.counters.reject(format!("from {address}, which `allow` does not have"));
        }
        let reading = match self.protocol.read(datagram) {
            Ok(reading) => reading,
            Err(reason) => return self.counters.reject(reason),
        };
        let Some(body) = self.bodies_by_id.get(&reading.body_id) else {
            return self.counters.reject(format!("body id {}, which `bodies` does not have", reading.body_id));
        };

        // Only what is newer counts; the first packet of a body is.
        if let Some(&last) = self.last_sequence.get(&reading.body_id)
            && !sequence_is_newer(reading.sequence, last)
        {
            return self.counters.drop_old(format!("old: sequence {} is not newer than {last}", reading.sequence));
        }
        let timing = self.timekeeper.timing(reading.measured_ns, received);
        let update = Update { timing, ..self.to_world(&reading) };
        if update.position_m.is_some_and(|position_m| !is_place(position_m)) {
            return self.counters.reject("position beyond 1e8 m".to_owned());
        }
        if !bodies.apply(body, &update, &self.name, received) {
            return self.counters.reject(format!("body `{body}`, which is not there any more"));
        }
        self.last_sequence.insert(reading.body_id, reading.sequence);
        self.counters.accept(received);
    }

    /// Counts a failure of the socket.
    pub(crate) fn fail(&mut self, error: &std::io::Error) {
        self.counters.reject(format!("socket: {error}"));
    }

    fn to_world(&self, reading: &Reading) -> Update {
        let world = &self.world_from_tracker;
        Update {
            position_m: reading.position_m.map(|p| world.point(p)),
            orientation: reading.orientation.map(|q| (world.rotation * q).normalize()),
            velocity_m_s: reading.velocity_m_s.map(|v| world.vector(v)),
            sequence: Some(reading.sequence),
            measured_ns: reading.measured_ns,
            ..Update::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use lantern_config::{Body, Protocol};
    use lantern_proto::{PosePacket, status::TrackerStatus};

    const ALLOWED: &str = "10.0.0.1:5000";

    fn tracker() -> Tracker {
        Tracker {
            name: "optitrack".into(),
            protocol: Protocol::Lantern,
            listen: "127.0.0.1:0".parse().unwrap(),
            allow: vec!["10.0.0.1".parse().unwrap()],
            bodies: BTreeMap::from([(1, "head".to_owned()), (2, "gone".to_owned())]),
            // +Z up to +Y up, in millimetres, and 1 m to the right.
            world_from_tracker: [
                [0.001, 0.0, 0.0, 1.0],
                [0.0, 0.0, 0.001, 0.0],
                [0.0, -0.001, 0.0, 0.0],
                [0.0, 0.0, 0.0, 1.0],
            ],
            predict_lead_ms: None,
        }
    }

    fn bodies() -> Bodies {
        Bodies::new(&[Body { name: "head".into(), drives: None, position_m: [0.0; 3], offset_m: [0.0; 3] }])
    }

    fn packet(sequence: u32) -> PosePacket {
        PosePacket { body_id: 1, sequence, position_m: Some([sequence as f32, 0.0, 0.0]), ..PosePacket::default() }
    }

    fn hear(source: &mut Source, bodies: &Bodies, datagram: &[u8]) -> TrackerStatus {
        source.hear(datagram, ALLOWED.parse().unwrap(), bodies, Instant::now());
        source.status(String::new())
    }

    #[test]
    fn everything_is_brought_into_the_world() {
        let (mut source, bodies) = (Source::new(&tracker()), bodies());
        let up_in_tracker = glam::Quat::from_rotation_arc(Vec3::X, Vec3::Z);
        let packet = PosePacket {
            body_id: 1,
            sequence: 0,
            measured_ns: Some(5),
            position_m: Some([100.0, 200.0, 300.0]),
            orientation: Some(up_in_tracker.to_array()),
            velocity_m_s: Some([0.0, 0.0, 1000.0]),
        };
        assert_eq!(hear(&mut source, &bodies, &packet.encode()).accepted, 1);
        let pose = bodies.get("head").unwrap();
        assert!((pose.position_m - DVec3::new(1.1, 0.3, -0.2)).length() < 1e-12, "{pose:?}");
        // The body's X points up in the tracker's frame, and so it does in the world's.
        assert!((pose.orientation * DVec3::X - DVec3::Y).length() < 1e-6, "{pose:?}");
        assert!((pose.velocity_m_s.unwrap() - DVec3::Y).length() < 1e-12);
        assert_eq!((pose.sequence, pose.measured_ns, &*pose.source), (Some(0), Some(5), "optitrack"));
    }

    #[test]
    fn only_valid_fields_are_applied() {
        let (mut source, bodies) = (Source::new(&tracker()), bodies());
        hear(&mut source, &bodies, &packet(1).encode());
        let before = bodies.get("head").unwrap();
        let turned = PosePacket { orientation: Some([1.0, 0.0, 0.0, 0.0]), position_m: None, ..packet(2) };
        hear(&mut source, &bodies, &turned.encode());
        let after = bodies.get("head").unwrap();
        assert_eq!(after.position_m, before.position_m);
        assert_ne!(after.orientation, before.orientation);
        assert_eq!(after.velocity_m_s, None);
    }

    #[test]
    fn a_lost_body_shows_the_age_of_its_last_pose() {
        let (mut source, bodies) = (Source::new(&tracker()), bodies());
        let (lost, seen) = (PosePacket { position_m: None, velocity_m_s: Some([1.0; 3]), ..packet(1) }, packet(2));
        assert_eq!(hear(&mut source, &bodies, &lost.encode()).accepted, 1);
        assert_eq!(bodies.status()["head"].source, "config");
        hear(&mut source, &bodies, &seen.encode());
        let (before, generation) = (bodies.get("head").unwrap(), bodies.generation());
        assert_eq!(&*before.source, "optitrack");
        let lost = PosePacket { sequence: 3, ..lost };
        let later = Instant::now() + std::time::Duration::from_secs(5);
        source.hear(&lost.encode(), ALLOWED.parse().unwrap(), &bodies, later);
        assert_eq!((source.status(String::new()).accepted, bodies.generation()), (3, generation));
        assert_eq!(bodies.get("head").unwrap(), before);
        // Its packets count in their order all the same, and either of the two is a pose.
        assert_eq!(hear(&mut source, &bodies, &packet(3).encode()).dropped_old, 1);
        let turned = PosePacket { orientation: Some([0.0, 0.0, 0.0, 1.0]), sequence: 4, ..lost };
        source.hear(&turned.encode(), ALLOWED.parse().unwrap(), &bodies, later);
        assert_eq!(bodies.get("head").unwrap().received, later);
    }

    #[test]
    fn old_packets_are_dropped_and_named() {
        let (mut source, bodies) = (Source::new(&tracker()), bodies());
        // Up, and over the end of the range.
        for sequence in [u32::MAX - 1, u32::MAX, 0, 5] {
            hear(&mut source, &bodies, &packet(sequence).encode());
        }
        let place = bodies.get("head").unwrap().position_m;
        let mut status = TrackerStatus::default();
        for old in [5, 4, u32::MAX] {
            status = hear(&mut source, &bodies, &packet(old).encode());
        }
        assert_eq!((status.accepted, status.rejected, status.dropped_old), (4, 3, 3));
        assert_eq!(status.last_reject.as_deref(), Some("old: sequence 4294967295 is not newer than 5"));
        assert_eq!(bodies.get("head").unwrap().position_m, place);
        // A reload starts anew, and keeps the counts.
        source.configure(&tracker());
        let status = hear(&mut source, &bodies, &packet(0).encode());
        assert_eq!((status.accepted, status.dropped_old), (5, 3));
    }

    #[test]
    fn everything_else_is_counted_with_its_reason() {
        let (mut source, bodies) = (Source::new(&tracker()), bodies());
        let generation = bodies.generation();
        let mut nan = packet(9).encode();
        nan[24..28].copy_from_slice(&f32::NAN.to_le_bytes());
        let with = |change: fn(&mut PosePacket)| {
            let mut changed = packet(9);
            change(&mut changed);
            changed.encode()
        };
        let cases: [(&[u8], &str); 7] = [
            (b"garbage", "7 bytes"),
            (&[0; 64], "magic"),
            (&nan, "non-finite position"),
            (&with(|p| p.orientation = Some([0.5; 4].map(|x| x * 1.02))), "norm 1.02"),
            (&with(|p| p.body_id = 9), "body id 9"),
            (&with(|p| p.body_id = 2), "body `gone`"),
            (&with(|p| p.position_m = Some([0.0, 3e38, 0.0])), "beyond 1e8 m"),
        ];
        for (count, (datagram, reason)) in cases.into_iter().enumerate() {
            let status = hear(&mut source, &bodies, datagram);
            assert_eq!((status.accepted, status.rejected), (0, count as u64 + 1));
            assert!(status.last_reject.as_ref().unwrap().contains(reason), "{status:?} for {reason}");
        }
        for stranger in ["10.0.0.2:5000", "[::1]:5000"] {
            source.hear(&packet(9).encode(), stranger.parse().unwrap(), &bodies, Instant::now());
            assert!(source.status(String::new()).last_reject.unwrap().contains("`allow`"));
        }
        assert_eq!(bodies.generation(), generation);
        // An allowed IPv4 sender may come through an IPv6 socket.
        source.hear(&packet(9).encode(), "[::ffff:10.0.0.1]:5000".parse().unwrap(), &bodies, Instant::now());
        assert_eq!(source.status(String::new()).accepted, 1);
    }
}
