//! Metrics of a real daemon, read by Prometheus' own library for Python; and what asks for them wrongly, too slowly or too much.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use lantern_tests::harness::{self, Daemon};
use lantern_tests::lab;
use serde_json::Value;

/// A daemon with metrics, and where they are.
fn start() -> (Daemon, SocketAddr) {
    let daemon = Daemon::start(&lab::room_with("[metrics]\nlisten = \"127.0.0.1:0\"\n")).unwrap();
    let address = daemon.wait_for_log(|log| {
        let (address, _) = log.split_once("metrics at http://")?.1.split_once('/')?;
        address.parse().ok()
    });
    (daemon, address.unwrap())
}

/// What is answered to some bytes, up to the end of the connection.
fn answer(address: SocketAddr, request: &[u8]) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    // It may be answered and cut off before all is said.
    let _ = stream.write_all(request);
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    String::from_utf8(answer).unwrap()
}

/// All samples by name and labels, as an independent reader finds them.
fn read(address: SocketAddr) -> BTreeMap<String, f64> {
    let script = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/readers/metrics.py"));
    // Debian's own, whose packages it sees, whatever else is called python3 here.
    let output =
        Command::new("/usr/bin/python3").arg(script).arg(format!("http://{address}/metrics")).output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}\nhint: packaging/test installs python3-prometheus-client");
    let page: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(page["content_type"].as_str().unwrap().starts_with("text/plain; version=0.0.4"));
    let mut samples = BTreeMap::new();
    for family in page["families"].as_array().unwrap() {
        assert!(family["type"] != "unknown" && family["type"] != "untyped" && family["help"] != "", "{family}");
        for sample in family["samples"].as_array().unwrap() {
            let labels: BTreeMap<String, String> = serde_json::from_value(sample["labels"].clone()).unwrap();
            let labels: Vec<_> = labels.iter().map(|(name, value)| format!("{name}={value}")).collect();
            let name = format!("{} {}", sample["name"].as_str().unwrap(), labels.join(" "));
            let before = samples.insert(name.trim_end().to_owned(), sample["value"].as_f64().unwrap());
            assert!(before.is_none(), "{sample} is there twice");
        }
    }
    samples
}

#[test]
fn prometheus_reads_what_status_says() {
    let (daemon, address) = start();
    let mut client = daemon.client().unwrap();
    client.pose("head", [0.25, 1.5, 2.0]).unwrap();
    client.snapshot("left", "color").unwrap();
    let (status, samples) = (client.status().unwrap(), read(address));
    let at = |name: &str| *samples.get(name).unwrap_or_else(|| panic!("no {name} in {samples:#?}"));
    for (name, path) in [
        ("lantern_projector_frames_total projector=left", "/projectors/left/frames"),
        ("lantern_projector_width_pixels projector=right", "/projectors/right/resolution_px/0"),
        ("lantern_projector_device_bytes projector=left", "/projectors/left/gpu_bytes"),
        ("lantern_scene_triangles", "/scene/triangles"),
        ("lantern_scene_revision", "/scene/revision"),
        ("lantern_body_position_meters axis=x body=head", "/bodies/head/position_m/0"),
        ("lantern_tracker_accepted_packets_total tracker=optitrack", "/trackers/optitrack/accepted"),
        ("lantern_device_validation_messages_total", "/device/validation_messages"),
    ] {
        assert_eq!(status.pointer(path).and_then(Value::as_f64), Some(at(name)), "{name}");
    }
    let slowest_ms = status["projectors"]["left"]["frame_ms"]["max"].as_f64().unwrap();
    assert_eq!(at("lantern_projector_frame_seconds projector=left quantile=1"), slowest_ms * 1e-3);
    assert!(at("lantern_uptime_seconds") >= status["uptime_s"].as_f64().unwrap());
    let version = status["version"].as_str().unwrap();
    assert_eq!(at(&format!("lantern_info version={version}")), 1.0);
    assert_eq!(at("lantern_body_info body=head source=socket"), 1.0);

    // Nothing is counted by being asked for.
    assert_eq!(
        at("lantern_projector_frames_total projector=left"),
        read(address)["lantern_projector_frames_total projector=left"]
    );
}

#[test]
fn what_is_asked_wrongly_is_refused_and_what_is_slow_is_dropped() {
    let (daemon, address) = start();
    let good = b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n";
    assert!(answer(address, good).starts_with("HTTP/1.1 200 "));
    let head = answer(address, b"HEAD /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n");
    assert!(head.starts_with("HTTP/1.1 200 ") && head.ends_with("\r\n\r\n"), "{head}");
    for (request, status) in [
        (&b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"[..], "404"),
        (b"POST /metrics HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\n\r\n", "405"),
        (b"\x16\x03\x01\x00\x05hello\r\n\r\n", "400"),
        (&[&b"GET /metrics HTTP/1.1\r\nX: "[..], &[b'x'; 1 << 20], b"\r\n\r\n"].concat(), "431"),
    ] {
        let answer = answer(address, request);
        let answered = answer.split(' ').nth(1).unwrap_or_default();
        // Whoever goes on talking when it has been refused may be cut off before it reads why.
        assert!(answered == status || (status == "431" && answer.is_empty()), "{status}: {answer}");
    }

    // Those who say nothing hold every place, and lose it.
    let mut silent: Vec<_> = (0..12).map(|_| TcpStream::connect(address).unwrap()).collect();
    daemon.client().unwrap().snapshot("left", "color").unwrap();
    assert!(answer(address, good).starts_with("HTTP/1.1 200 "));
    for first in &mut silent[..4] {
        first.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        assert_eq!(first.read(&mut [0]).unwrap(), 0, "it is still there");
    }
}

#[test]
fn none_where_nobody_asked_for_them_and_none_for_other_machines() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    assert!(!daemon.log().contains("metrics at"));
    let folder = daemon.folder().path().join("open.toml");
    std::fs::write(&folder, lab::room_with("[metrics]\nlisten = \"0.0.0.0:9464\"\n")).unwrap();
    let output = harness::run("lanternd", &["check", "-c", folder.to_str().unwrap()]).unwrap();
    assert!(!output.status.success());
    let told = [output.stdout, output.stderr].concat();
    assert!(String::from_utf8_lossy(&told).contains("which other machines can reach"));
}
