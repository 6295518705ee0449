//! One tracker: who may speak, whom it means, and where its frame lies in the world.

use crate::bodies::Bodies;
use crate::clock::Timekeeper;
use crate::counters::{Counters, Socket};
use crate::order::FrameOrder;
use crate::pose::{Timing, Update, is_place, is_velocity};
use crate::protocol::{BodyId, Heard, Protocol, Reading, Refusal, Saying, bad, canonical};
use crate::protocols;
use glam::{DMat3, DMat4, DQuat, DVec3};
use lantern_config::Tracker;
use lantern_proto::pose_packet::sequence_is_newer;
use lantern_proto::status::{TrackedStatus, TrackerStatus};
use std::collections::BTreeMap;
use std::fmt;
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

/// A body that the configuration has of this tracker.
struct Followed {
    /// Our name of it.
    body: String,
    /// The newest packet's number, where bodies are counted one by one.
    sequence: Option<u32>,
    /// Whether the tracker saw it when it last spoke of it.
    is_tracked: bool,
    /// When its last pose was heard.
    posed: Option<Instant>,
}

/// A tracker's settings and what it has heard; the socket is another's.
pub struct Source {
    name: Arc<str>,
    protocol_name: &'static str,
    allow: Vec<IpAddr>,
    followed: BTreeMap<BodyId, Followed>,
    world_from_tracker: WorldFromTracker,
    protocol: Box<dyn Protocol>,
    order: FrameOrder,
    timekeeper: Timekeeper,
    counters: Counters,
    /// What the last datagram said; kept for its memory.
    heard: Heard,
}

impl fmt::Debug for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Source")
            .field("name", &self.name)
            .field("protocol", &self.protocol_name)
            .finish_non_exhaustive()
    }
}

impl Source {
    /// One that has heard nothing yet.
    pub fn new(tracker: &Tracker) -> Self {
        let followed = |body: &String| Followed { body: body.clone(), sequence: None, is_tracked: false, posed: None };
        Self {
            name: Arc::from(tracker.name.as_str()),
            protocol_name: tracker.protocol.as_str(),
            allow: tracker.allow.clone(),
            followed: tracker.bodies.iter().map(|(id, body)| (BodyId::parse(id), followed(body))).collect(),
            world_from_tracker: WorldFromTracker::new(tracker.world_from_tracker),
            protocol: protocols::new(tracker),
            order: FrameOrder::default(),
            timekeeper: Timekeeper::new(tracker),
            counters: Counters::new(Instant::now()),
            heard: Heard::default(),
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

    pub(crate) fn status_of(&mut self, socket: Socket) -> TrackerStatus {
        let now = Instant::now();
        let age_ms = |posed: Instant| now.saturating_duration_since(posed).as_secs_f64() * 1e3;
        let status = |followed: &Followed| TrackedStatus {
            body: followed.body.clone(),
            tracked: followed.is_tracked,
            age_ms: followed.posed.map(age_ms),
        };
        let bodies = self.followed.iter().map(|(id, followed)| (id.to_string(), status(followed))).collect();
        self.counters.status(self.protocol_name, socket, bodies, now)
    }

    /// What `status` says of it, but for its socket.
    pub fn status(&mut self) -> TrackerStatus {
        self.status_of(Socket::default())
    }

    /// Takes one datagram: it moves bodies, or it is counted with the reason why not. It never moves some of the bodies
    /// that it speaks of because of what it says of others.
    pub fn hear(&mut self, datagram: &[u8], from: SocketAddr, bodies: &Bodies, received: Instant) {
        // An IPv4 sender to an IPv6 socket is still the IPv4 address that people write.
        let from = canonical(from);
        let address = from.ip();
        if !self.allow.contains(&address) {
            return self.counters.reject(format!("from {address}, which `allow` does not have"));
        }
        let mut heard = std::mem::take(&mut self.heard);
        heard.clear();
        let read = self.protocol.read(datagram, from, received, &mut heard);
        match read.and_then(|()| self.take(&heard, bodies, received)) {
            Ok(()) => self.counters.accept(received),
            Err(refusal) => self.counters.refuse(refusal),
        }
        self.counters.miss(heard.incomplete_frames);
        self.heard = heard;
    }

    /// Counts a failure of the socket.
    pub(crate) fn fail(&mut self, error: &dyn std::error::Error) {
        self.counters.reject(format!("socket: {error}"));
    }

    /// What the protocol wants to have sent now.
    pub(crate) fn say(&mut self, now: Instant) -> Vec<Saying> {
        self.protocol.say(now)
    }

    /// Moves the bodies that the readings are about, after all of the readings have been found good.
    fn take(&mut self, heard: &Heard, bodies: &Bodies, received: Instant) -> Result<(), Refusal> {
        if let Some(frame) = heard.frame
            && let Some(newest) = self.order.newer_than(frame, received)
        {
            return Err(Refusal::Old(format!("frame {frame} is not newer than {newest}")));
        }
        let mut updates = Vec::with_capacity(heard.readings.len().min(self.followed.len()));
        for reading in &heard.readings {
            let Some(id) = self.id_of(reading) else {
                self.counters.meet(&reading.body);
                continue;
            };
            updates.push((id.clone(), self.checked(reading, id)?));
        }
        // Of strange bodies alone nothing can be used, and whoever configures must hear it; but for a tracker that tells of all
        // bodies at once: it says that it does not see ours.
        if updates.is_empty()
            && !heard.is_everything
            && let Some(stranger) = heard.readings.first()
        {
            return bad(format!("body id {}, which `bodies` does not have", stranger.body));
        }

        // All of a datagram has mostly one time, and the clock is to hear of it once.
        let mut timing: Option<(Option<u64>, Timing)> = None;
        for (_, update) in &mut updates {
            let known = timing.filter(|(measured_ns, _)| *measured_ns == update.measured_ns).map(|(_, timing)| timing);
            update.timing = known.unwrap_or_else(|| self.timekeeper.timing(update.measured_ns, received));
            timing = Some((update.measured_ns, update.timing));
        }
        if heard.is_everything {
            self.followed.values_mut().for_each(|followed| followed.is_tracked = false);
        }
        let mut gone = None;
        for (id, update) in updates {
            let Some(followed) = self.followed.get_mut(&id) else { continue };
            if !bodies.apply(&followed.body, &update, &self.name, received) {
                gone = Some(followed.body.clone());
                continue;
            }
            followed.sequence = update.sequence.or(followed.sequence);
            followed.is_tracked = update.position_m.is_some() || update.orientation.is_some();
            followed.posed = if followed.is_tracked { Some(received) } else { followed.posed };
        }
        if let Some(body) = gone {
            return bad(format!("body `{body}`, which is not there any more"));
        }
        if let Some(frame) = heard.frame {
            self.order.take(frame, received);
        }
        Ok(())
    }

    /// Under which id the configuration has the body of a reading.
    fn id_of(&self, reading: &Reading) -> Option<&BodyId> {
        match reading.body {
            BodyId::Only => self.followed.keys().next(),
            _ => self.followed.get_key_value(&reading.body).map(|(id, _)| id),
        }
    }

    /// A reading in the world's frame, if it is newer than what is known of its body, somewhere, and no faster than can be.
    fn checked(&self, reading: &Reading, id: &BodyId) -> Result<Update, Refusal> {
        let last = self.followed.get(id).and_then(|followed| followed.sequence);
        if let (Some(sequence), Some(last)) = (reading.sequence, last)
            && !sequence_is_newer(sequence, last)
        {
            return Err(Refusal::Old(format!("sequence {sequence} is not newer than {last}")));
        }
        let update = self.to_world(reading);
        if update.position_m.is_some_and(|position_m| !is_place(position_m)) {
            return bad("position beyond 1e8 m");
        }
        if update.velocity_m_s.is_some_and(|velocity_m_s| !is_velocity(velocity_m_s)) {
            return bad("velocity beyond 1e3 m/s");
        }
        Ok(update)
    }

    fn to_world(&self, reading: &Reading) -> Update {
        let world = &self.world_from_tracker;
        Update {
            position_m: reading.position_m.map(|p| world.point(p)),
            orientation: reading.orientation.map(|q| (world.rotation * q).normalize()),
            velocity_m_s: reading.velocity_m_s.map(|v| world.vector(v)),
            sequence: reading.sequence,
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
    use lantern_proto::PosePacket;

    const ALLOWED: &str = "10.0.0.1:5000";

    fn tracker() -> Tracker {
        Tracker {
            name: "optitrack".into(),
            protocol: Protocol::Lantern,
            listen: "127.0.0.1:0".parse().unwrap(),
            interface: None,
            allow: vec!["10.0.0.1".parse().unwrap()],
            bodies: BTreeMap::from([("1".to_owned(), "head".to_owned()), ("2".to_owned(), "gone".to_owned())]),
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
        source.status()
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
        assert_eq!((source.status().accepted, bodies.generation()), (3, generation));
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
        let cases: [(&[u8], &str); 8] = [
            (b"garbage", "7 bytes"),
            (&[0; 64], "magic"),
            (&nan, "non-finite position"),
            (&with(|p| p.orientation = Some([0.5; 4].map(|x| x * 1.02))), "norm 1.02"),
            (&with(|p| p.body_id = 9), "body id 9"),
            (&with(|p| p.body_id = 2), "body `gone`"),
            (&with(|p| p.position_m = Some([0.0, 3e38, 0.0])), "beyond 1e8 m"),
            // In the world it is a thousandth of that, and still too fast.
            (&with(|p| p.velocity_m_s = Some([0.0, 1.1e6, 0.0])), "velocity beyond 1e3 m/s"),
        ];
        for (count, (datagram, reason)) in cases.into_iter().enumerate() {
            let status = hear(&mut source, &bodies, datagram);
            assert_eq!((status.accepted, status.rejected), (0, count as u64 + 1));
            assert!(status.last_reject.as_ref().unwrap().contains(reason), "{status:?} for {reason}");
        }
        for stranger in ["10.0.0.2:5000", "[::1]:5000"] {
            source.hear(&packet(9).encode(), stranger.parse().unwrap(), &bodies, Instant::now());
            assert!(source.status().last_reject.unwrap().contains("`allow`"));
        }
        assert_eq!(bodies.generation(), generation);
        // An allowed IPv4 sender may come through an IPv6 socket.
        source.hear(&packet(9).encode(), "[::ffff:10.0.0.1]:5000".parse().unwrap(), &bodies, Instant::now());
        assert_eq!(source.status().accepted, 1);
    }
}
