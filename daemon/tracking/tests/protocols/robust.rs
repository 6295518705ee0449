//! Broken packets of every protocol: nothing panics, and none moves a body by half.
//!
//! What can be told from a good packet depends on the format. Only FreeD has a checksum: of its packets every flipped bit is
//! refused. Of the others a flipped bit of a number is another number. So of those it is tested that a damaged packet is
//! either refused and moves nothing, or leaves every body at a place that can be, by a rotation; and that of a packet cut
//! short nothing moves, but where what is left is whole: DTRACK's lines and the elements of an OSC bundle, of which the last
//! may be missing.

use crate::packets::*;
use glam::{DQuat, DVec3};
use lantern_tracking::Bodies;
use proptest::prelude::*;
use std::path::Path;
use std::time::Duration;

/// A protocol: the tracker's keys, and good packets of it, which together move `head`.
struct Sample {
    keys: &'static str,
    packets: Vec<Vec<u8>>,
    /// Whether what is left of a packet that was cut short is a good one.
    is_whole: fn(&[u8]) -> bool,
}

fn samples() -> Vec<Sample> {
    let sample = |keys, packets| Sample { keys, packets, is_whole: |_| false };
    let fields = |x: f32| [vector(0, [x, 2.0, 3.0]), vector(1, [0.0; 3]), vector(2, [0.1, 0.2, 0.3])].concat();
    let body = "[1 1.000][100.5 200.2 300.1 1 2 3][0 1 0 -1 0 0 0 0 1]";
    let lines =
        format!("fr 5\r\nts 10.5\r\n6d 1 {body}\r\n6df2 1 1 [0 1.0 2 2][1 2 3][1 0 0 0 1 0 0 0 1][0 0.5 0.5]\r\n");
    let rigid = |x: f32| (1, [x, 0.2, 0.3], [0.5, -0.5, 0.5, 0.5], true);
    let numbers = [1.0, 2.0, 3.0, 0.5, -0.5, 0.5, 0.5];
    let place = [
        osc("/tracking/trackers/1/position", None, &numbers[..3]),
        osc("/tracking/trackers/1/rotation", None, &numbers[..3]),
    ];
    vec![
        sample("protocol = \"lantern\"", vec![lantern_packet(1), lantern_packet(2)]),
        sample("protocol = \"freed\"", vec![freed(1, [10.0, 20.0, 30.0], [1.0, 2.0, 3.0])]),
        sample("protocol = \"opentrack\"", vec![opentrack([1.0, 2.0, 3.0, 40.0, 50.0, 60.0])]),
        Sample { is_whole: |rest| rest.contains(&b']'), ..sample("protocol = \"dtrack\"", vec![lines.into_bytes()]) },
        sample(
            "protocol = \"psn\"\nbodies = { \"1\" = \"head\", \"name\" = \"hand\" }",
            vec![
                psn_names(&[(2, "name"), (1, "other")]),
                psn(psn_header(1000, 1, 1), &[(1, fields(1.0)), (2, fields(2.0))]),
                psn(psn_header(2000, 2, 2), &[(1, fields(3.0))]),
                psn(psn_header(2000, 2, 2), &[(2, fields(4.0))]),
            ],
        ),
        sample("protocol = \"natnet\"\nversion = \"3.1\"", vec![natnet((3, 1), 1, 1.0, &[rigid(0.5)])]),
        sample("protocol = \"natnet\"\nversion = \"4.0\"", vec![natnet((4, 0), 1, 1.0, &[rigid(0.5), rigid(1.5)])]),
        sample(
            "protocol = \"natnet\"\nserver = \"127.0.0.1:5000\"",
            vec![
                natnet_answer([4, 1]),
                natnet((4, 1), 1, 1.0, &[rigid(0.5), (2, [1.0; 3], [0.0, 0.0, 0.0, 1.0], false)]),
            ],
        ),
        sample(
            "protocol = \"osc\"\npreset = \"vmc\"",
            vec![
                osc("/VMC/Ext/Hmd/Pos", Some("1"), &numbers),
                osc_bundle(
                    1,
                    &[
                        osc_bundle(2 << 32, &[osc("/VMC/Ext/Tra/Pos", Some("1"), &numbers)]),
                        osc("/VMC/Ext/T", None, &[1.0]),
                    ],
                ),
            ],
        ),
        Sample {
            is_whole: |rest| {
                rest.len() == osc_bundle(1, &[osc("/tracking/trackers/1/position", None, &[0.0; 3])]).len()
            },
            ..sample("protocol = \"osc\"\npreset = \"vrchat\"", vec![osc_bundle(1, &place)])
        },
        sample("protocol = \"osc\"\npreset = \"optitrack\"", vec![osc("/rigidbody/1/transformation", None, &numbers)]),
        sample(
            "protocol = \"osc\"\naddress = \"/t/{id}\"\narguments = [\"time\", \"x\", \"y\", \"z\", \"rx\", \"ry\", \"rz\"]",
            vec![osc("/t/1", None, &numbers)],
        ),
    ]
}

impl Sample {
    /// A tracker that has heard nothing yet, and whose poses are predicted.
    fn listener(&self) -> Listener {
        Listener::new(&format!("{}\npredict_ms = 10", self.keys))
    }
}

fn lantern_packet(sequence: u32) -> Vec<u8> {
    let position_m = Some([1.0, 2.0, 3.0]);
    let orientation = Some([0.5, -0.5, 0.5, 0.5]);
    lantern_proto::PosePacket { body_id: 1, sequence, position_m, orientation, ..Default::default() }.encode().to_vec()
}

/// Where all bodies are: equal only where nothing moved, for a place that cannot be is equal to nothing.
fn places(bodies: &Bodies) -> Vec<(DVec3, DQuat)> {
    ["head", "hand"].map(|body| bodies.get(body).unwrap()).map(|pose| (pose.position_m, pose.orientation)).to_vec()
}

fn hear_all(listener: &mut Listener, packets: &[Vec<u8>]) {
    for packet in packets {
        hear(listener, packet);
    }
}

/// Hears what may be anything: it is counted once, moves nothing if it was not accepted, and leaves all bodies somewhere.
fn hear(listener: &mut Listener, datagram: &[u8]) -> bool {
    let count = |listener: &mut Listener| {
        let status = listener.source.status();
        (status.accepted, status.accepted + status.rejected + status.others.packets)
    };
    let (before, (accepted, heard)) = (places(&listener.bodies), count(listener));
    listener.hear(datagram);
    let (now_accepted, now_heard) = count(listener);
    assert_eq!(now_heard, heard + 1, "a datagram was not counted once");
    for ahead_ms in [0, 20, 1000] {
        let light = listener.now + Duration::from_millis(ahead_ms);
        for placed in listener.bodies.placed(light, listener.now) {
            stands_somewhere(placed.pose.position_m, placed.pose.orientation);
        }
    }
    let after = places(&listener.bodies);
    if now_accepted == accepted {
        assert_eq!(before, after, "a datagram that was not accepted moved a body");
    }
    for (position_m, orientation) in &after {
        stands_somewhere(*position_m, *orientation);
    }
    after != before
}

#[track_caller]
fn stands_somewhere(position_m: DVec3, orientation: DQuat) {
    assert!(position_m.to_array().iter().all(|x| x.abs() <= 1e8), "{position_m}");
    assert!((orientation.length() - 1.0).abs() < 1e-6, "{orientation}");
}

#[test]
fn the_samples_are_good() {
    for sample in samples() {
        let mut listener = sample.listener();
        hear_all(&mut listener, &sample.packets);
        let status = listener.source.status();
        assert_eq!((status.rejected, status.bodies["1"].tracked), (0, true), "{}: {status:?}", sample.keys);
    }
}

#[test]
fn a_packet_cut_short_moves_nothing() {
    for sample in samples() {
        for (at, packet) in sample.packets.iter().enumerate() {
            for length in 0..packet.len() {
                let mut listener = sample.listener();
                hear_all(&mut listener, &sample.packets[..at]);
                let moved = hear(&mut listener, &packet[..length]);
                let is_whole = (sample.is_whole)(&packet[..length]);
                assert!(!moved || is_whole, "{} cut to {length} bytes moved a body", sample.keys);
            }
        }
    }
}

#[test]
fn every_flipped_bit_is_refused_or_harmless() {
    for sample in samples() {
        for (at, packet) in sample.packets.iter().enumerate() {
            for bit in 0..packet.len() * 8 {
                let mut damaged = packet.clone();
                damaged[bit / 8] ^= 1 << (bit % 8);
                let mut listener = sample.listener();
                hear_all(&mut listener, &sample.packets[..at]);
                let before = listener.source.status().accepted;
                let moved = hear(&mut listener, &damaged);
                assert!(!moved || !sample.keys.contains("freed"), "bit {bit} of a FreeD packet was not missed");
                // The damage is forgotten with the packet, or with the frame that it is a part of: what comes later is heard as
                // ever. Only where a damaged packet was taken for a later one than there is, what is earlier is old.
                let was_taken = listener.source.status().accepted > before;
                let is_heard = (0..2).any(|_| last_is_heard(&mut listener, &sample.packets[at..], was_taken));
                assert!(is_heard, "after bit {bit} of {at}, {}: {:?}", sample.keys, listener.source.status());
            }
        }
    }
}

/// Whether the last of good packets is accepted, or old where it may be.
fn last_is_heard(listener: &mut Listener, packets: &[Vec<u8>], may_be_old: bool) -> bool {
    let (last, others) = packets.split_last().unwrap();
    hear_all(listener, others);
    let before = listener.source.status().accepted;
    hear(listener, last);
    let status = listener.source.status();
    status.accepted > before || may_be_old && status.last_reject.unwrap().starts_with("old: ")
}

/// Neither what a tracker says of velocities nor what its places tell of them leads out of where anything can be.
#[test]
fn predictions_stay_where_anything_can_be() {
    let mut listener = Listener::new("protocol = \"lantern\"\npredict_ms = 10");
    let packet = |sequence, x, velocity| lantern_proto::PosePacket {
        body_id: 1,
        sequence,
        position_m: Some([x, 0.0, 0.0]),
        velocity_m_s: Some([velocity, 0.0, 0.0]),
        ..Default::default()
    };
    for (sequence, velocity) in [(1, 1.7e38), (2, 1001.0)] {
        listener.bad(&packet(sequence, 1.0, velocity).encode(), "velocity beyond 1e3 m/s");
    }
    // To and fro, and along the border.
    for sequence in 3..100 {
        let x = if sequence % 4 < 2 { 9.9e7 } else { -9.9e7 };
        hear(&mut listener, &packet(sequence, x, 999.0).encode());
    }
    for sequence in 100..200 {
        let x = 1e8 - 100.0 * (200 - sequence) as f32;
        hear(&mut listener, &packet(sequence, x, 999.0).encode());
    }
    assert_eq!(listener.source.status().accepted, 197);
}

/// What is told of datagrams is told in a line of 1 MiB, together with all the rest, whatever words stand in them.
#[test]
fn long_words_make_no_long_status() {
    let mut listener = Listener::new("protocol = \"osc\"\npreset = \"vmc\"");
    // Each of these is six bytes in JSON.
    let long = "\u{1}".repeat(15_000);
    for stranger in 0..20 {
        let name = format!("é{stranger}{long}");
        let numbers = [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0];
        listener.bad(&osc("/VMC/Ext/Hmd/Pos", Some(&name), &numbers), "body id é");
    }
    listener.hear(&osc(&format!("/{long}"), None, &[1.0]));
    let status = listener.source.status();
    assert_eq!((status.others.packets, status.others.bodies.len()), (1, 16));
    let words = status.others.bodies.iter().chain(&status.last_reject).chain(&status.others.last);
    for word in words {
        assert!(word.chars().count() <= 128 && word.ends_with('…'), "{word}");
    }
    let json = serde_json::to_string(&status).unwrap();
    assert!(json.len() < 20_000, "{} bytes", json.len());
}

/// Every two and four bytes of a packet that could be a length or a count, as other ones.
#[test]
fn lengths_may_lie() {
    for sample in samples() {
        for (at, packet) in sample.packets.iter().enumerate() {
            for start in 0..packet.len() {
                for lie in
                    [&[0xff; 4][..], &[0xff; 2], &[0x7f, 0xff, 0xff, 0xff], &[0, 0, 0, 0x80], &[0; 4], &[0xff, 0x7f]]
                {
                    let mut damaged = packet.clone();
                    let end = (start + lie.len()).min(packet.len());
                    damaged[start..end].copy_from_slice(&lie[..end - start]);
                    let mut listener = sample.listener();
                    hear_all(&mut listener, &sample.packets[..at]);
                    hear(&mut listener, &damaged);
                }
            }
        }
    }
}

/// The fuzzers' corpus, and which of their targets a sample is of, with the byte by which that chooses among several trackers.
const CORPUS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/fuzz/corpus");

fn fuzzed(number: usize) -> (&'static str, Option<u8>) {
    [
        ("lantern", None),
        ("freed", None),
        ("opentrack", None),
        ("dtrack", None),
        ("psn", None),
        ("natnet", Some(0)),
        ("natnet", Some(1)),
        ("natnet", Some(3)),
        ("osc", Some(0)),
        ("osc", Some(1)),
        ("osc", Some(2)),
        ("osc", Some(3)),
    ][number]
}

/// What the fuzzers have found worth keeping is heard by every tracker of its protocol, and harms none. The samples are there, too.
#[test]
fn the_stored_corpus_is_harmless() {
    for (number, sample) in samples().iter().enumerate() {
        let (target, choice) = fuzzed(number);
        let folder = Path::new(CORPUS).join(format!("tracker_{target}"));
        let framed =
            sample.packets.iter().flat_map(|packet| [&(packet.len() as u16).to_le_bytes()[..], packet].concat());
        let seed: Vec<u8> = choice.into_iter().chain(framed).collect();
        let file = folder.join(format!("sample-{number}"));
        if std::env::var_os("LANTERN_BLESS").is_some() {
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(&file, &seed).unwrap();
        }
        let stored = std::fs::read(&file).unwrap();
        assert!(stored == seed, "{} is not the sample; hint: LANTERN_BLESS=1 writes it", file.display());

        for entry in std::fs::read_dir(&folder).unwrap() {
            let data = std::fs::read(entry.unwrap().path()).unwrap();
            let mut rest = if choice.is_some() { data.get(1..).unwrap_or_default() } else { &data[..] };
            let mut listener = sample.listener();
            while let [low, high, after @ ..] = rest {
                let (datagram, after) = after.split_at(after.len().min(usize::from(u16::from_le_bytes([*low, *high]))));
                hear(&mut listener, datagram);
                rest = after;
            }
        }
    }
}

proptest! {
    /// Any sequence of good, damaged and senseless datagrams.
    #[test]
    fn anything_may_come(
        choice in 0..12_usize,
        datagrams in prop::collection::vec(
            (any::<prop::sample::Index>(), prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4), any::<prop::sample::Index>(), any::<bool>()),
            1..20,
        ),
        noise in prop::collection::vec(any::<u8>(), 0..300),
    ) {
        let sample = &samples()[choice];
        let mut listener = sample.listener();
        for (which, changes, cut, is_cut) in &datagrams {
            let mut packet = which.get(&sample.packets).clone();
            for (place, byte) in changes {
                let at = place.index(packet.len());
                packet[at] = *byte;
            }
            if *is_cut {
                packet.truncate(cut.index(packet.len() + 1));
            }
            hear(&mut listener, &packet);
        }
        hear(&mut listener, &noise);
    }
}
