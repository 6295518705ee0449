//! Who is not on a tracker's list is not heard, whatever the protocol: told from its address, before anything of the datagram is read.

use std::net::UdpSocket;

use lantern_tests::harness::Daemon;
use lantern_tests::lab;
use lantern_tests::senders::port;
use serde_json::json;

/// Every protocol there is, with what its tracker says besides.
const PROTOCOLS: [(&str, &str); 7] = [
    ("lantern", ""),
    ("osc", "preset = \"vmc\""),
    ("natnet", "version = \"4.0\""),
    ("freed", ""),
    ("psn", ""),
    ("opentrack", ""),
    ("dtrack", ""),
];

#[test]
fn strangers_are_not_heard_by_any_protocol() {
    let mut config = lab::RENDER.to_owned() + lab::SCENE;
    for (protocol, keys) in PROTOCOLS {
        let id = if protocol == "opentrack" { "face" } else { "1" };
        config += &format!(
            "[[body]]\nname = \"{protocol}\"\n[[tracker]]\nname = \"{protocol}\"\nprotocol = \"{protocol}\"\n\
             listen = \"127.0.0.1:0\"\nallow = [\"127.0.0.1\"]\n{keys}\nbodies = {{ \"{id}\" = \"{protocol}\" }}\n"
        );
    }
    let daemon = Daemon::start(&(config + &lab::stand(-1.0).toml("left"))).unwrap();
    let mut client = daemon.client().unwrap();
    let stranger = UdpSocket::bind("127.0.0.2:0").unwrap();
    let before = client.status().unwrap();
    for (protocol, _) in PROTOCOLS {
        let to = ("127.0.0.1", port(&mut client, protocol).unwrap());
        for length in [0, 1, 48, 64, 1400, 65_000] {
            stranger.send_to(&vec![0x4c; length], to).unwrap();
        }
    }
    for (protocol, _) in PROTOCOLS {
        let tracker = loop {
            let tracker = client.status().unwrap()["trackers"][protocol].clone();
            if tracker["rejected"].as_u64() >= Some(6) {
                break tracker;
            }
        };
        assert_eq!((&tracker["accepted"], &tracker["rejected"]), (&json!(0), &json!(6)), "{protocol}");
        assert_eq!(tracker["last_reject"], "from 127.0.0.2, which `allow` does not have", "{protocol}");
        assert_eq!(tracker["others"], before["trackers"][protocol]["others"], "{protocol}");
        let body = &client.status().unwrap()["bodies"][protocol];
        assert_eq!(
            (&body["source"], &body["position_m"]),
            (&json!("config"), &before["bodies"][protocol]["position_m"])
        );
    }

    // Whoever adds a protocol adds it here.
    let all = include_str!("../../config/src/protocol.rs");
    let names = all.split("pub fn as_str").nth(1).unwrap().split("    }\n").next().unwrap();
    assert_eq!(names.matches("=> \"").count(), PROTOCOLS.len());
}
