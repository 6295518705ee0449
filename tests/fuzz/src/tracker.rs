//! A tracker that hears what a fuzzer has made up, and what must hold whatever that is.

use lantern_config::{Body, Config};
use lantern_tracking::{Bodies, Source};
use std::path::Path;
use std::time::{Duration, Instant};

/// The bodies of every configuration.
const BODIES: [&str; 2] = ["head", "hand"];

/// Hears datagrams: of each, two bytes (little-endian) say its length, and the last one has what is left. `keys` are those of the
/// tracker but for its name and address.
///
/// # Panics
/// Where a datagram is not counted once, moves a body without being accepted, or leaves one where nothing can be.
pub fn hear(keys: &str, mut data: &[u8]) {
    let text = format!(
        "[[body]]\nname = \"head\"\n[[body]]\nname = \"hand\"\n[[tracker]]\nname = \"t\"\nlisten = \"127.0.0.1:1\"\n{keys}\n\
         [[projector]]\nname = \"any\"\nresolution_px = [8, 8]\n[projector.calibration]\nconvention = \"opengl\"\n\
         projection = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1.01, -0.2], [0, 0, -1, 0]]\n\
         view = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -2], [0, 0, 0, 1]]\n"
    );
    let config = Config::parse(&text, "fuzz.toml", Path::new("/")).expect("the fuzzer's own configuration");
    let bodies = BODIES.map(|name| Body { name: name.into(), drives: None, position_m: [0.0; 3], offset_m: [0.0; 3] });
    let (bodies, mut source) = (Bodies::new(&bodies), Source::new(&config.trackers[0]));
    let places = |bodies: &Bodies| BODIES.map(|body| bodies.get(body).map(|pose| (pose.position_m, pose.orientation)));

    let mut now = Instant::now();
    let (mut accepted, mut counted) = (0, 0);
    while !data.is_empty() {
        let (length, rest) = data.split_at(data.len().min(2));
        let length = usize::from(length[0]) | usize::from(*length.get(1).unwrap_or(&0)) << 8;
        let (datagram, rest) = rest.split_at(rest.len().min(length));
        data = rest;

        now += Duration::from_millis(8);
        let before = places(&bodies);
        source.hear(datagram, ([127, 0, 0, 1], 1510).into(), &bodies, now);
        let status = source.status();
        let after = places(&bodies);
        assert_eq!(
            status.accepted + status.rejected + status.others.packets,
            counted + 1,
            "not counted once: {status:?}"
        );
        assert!(status.accepted > accepted || before == after, "moved a body without being accepted: {status:?}");
        for (position_m, orientation) in after.into_iter().flatten() {
            assert!(position_m.abs().max_element() <= 1e8, "a body at {position_m}");
            assert!((orientation.length() - 1.0).abs() < 1e-6, "a body turned by {orientation}");
        }
        (accepted, counted) = (status.accepted, counted + 1);
    }
}

/// The same by one of several trackers, by the first byte.
pub fn hear_by(keys: &[&str], data: &[u8]) {
    if let [which, data @ ..] = data {
        hear(keys[usize::from(*which) % keys.len()], data);
    }
}
