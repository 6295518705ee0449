//! Multicast groups, in a network that the test makes for itself (network_namespaces(7)): nothing of it leaves that.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]

use std::env;
use std::fs;
use std::net::UdpSocket;
use std::process::Command;
use std::time::Duration;

use glam::DQuat;
use lantern_tests::harness::{Daemon, program, run};
use lantern_tests::lab;
use lantern_tests::senders::{Pose, arrives, psn};
use natnet::{PlannedBody, SyntheticServer, Version};

/// Set within the test's own network.
const INSIDE: &str = "LANTERN_TEST_NETWORK";
/// What makes of a new network one in which groups lead to ourselves.
const NETWORK: &str =
    "ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo src 127.0.0.1 && exec \"$0\" \"$@\"";

#[test]
fn groups_are_joined_where_the_configuration_says() {
    if env::var_os(INSIDE).is_some() {
        return inside();
    }
    program("lanternd").unwrap();
    let mut command = Command::new("unshare");
    // Who is not root is so in a user namespace of its own.
    if !rustix::process::geteuid().is_root() {
        command.arg("--map-root-user");
    }
    command.args(["--net", "sh", "-c", NETWORK]).arg(env::current_exe().unwrap());
    command.args(["--exact", "groups_are_joined_where_the_configuration_says", "--nocapture"]);
    // What was just built is there; cargo might look for a network.
    let status = command.env(INSIDE, "1").env_remove("CARGO").status();
    let status =
        status.unwrap_or_else(|error| panic!("unshare: {error}; hint: packaging/senders installs it and `ip`"));
    assert!(
        status.success(),
        "{status}; hint: this needs `unshare`, `ip` (packaging/senders) and the right to make a network namespace"
    );
}

fn config(psn_interface: &str) -> String {
    let trackers = format!(
        "[[body]]\nname = \"head\"\n[[body]]\nname = \"hand\"\n\
         [[tracker]]\nname = \"stage\"\nprotocol = \"psn\"\nlisten = \"236.10.10.10:56565\"\ninterface = \"{psn_interface}\"\n\
         bodies = {{ \"Singer 1\" = \"head\" }}\n\
         [[tracker]]\nname = \"motive\"\nprotocol = \"natnet\"\nlisten = \"239.255.42.99:1511\"\ninterface = \"127.0.0.1\"\n\
         bodies = {{ \"7\" = \"hand\" }}\n"
    );
    [lab::RENDER, lab::SCENE, &trackers, &lab::stand(-1.0).toml("left")].join("\n")
}

fn inside() {
    // An interface that is not there is said in words, with those that are.
    let folder = tempfile::tempdir().unwrap();
    let [file, socket] = ["lantern.toml", "socket"].map(|name| folder.path().join(name));
    fs::write(&file, config("nosuch0")).unwrap();
    let arguments = ["run", "-c", file.to_str().unwrap(), "--socket", socket.to_str().unwrap()];
    let ended = run("lanternd", &arguments).unwrap();
    let said = String::from_utf8_lossy(&ended.stderr);
    assert!(!ended.status.success(), "{said}");
    for words in ["tracker `stage` cannot join 236.10.10.10 on `nosuch0`", "hint: there are lo;"] {
        assert!(said.contains(words), "{said}");
    }

    let daemon = Daemon::start(&config("lo")).unwrap();
    let mut client = daemon.client().unwrap();
    // The names come with the first frame and count from the second on.
    psn("236.10.10.10:56565", 1..=2).unwrap();
    psn("236.10.10.10:56565", 1..=2).unwrap();
    arrives(&mut client, "head", &Pose::number(1)).unwrap_or_else(|error| panic!("{error:#}"));

    // Motive's frames do not tell their version; the daemon asks the command port of whoever sends them.
    let server = UdpSocket::bind("127.0.0.1:1510").unwrap();
    server.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let pose = Pose::number(4);
    let orientation = DQuat::from_mat3(&pose.rotation).as_quat().to_array();
    let planned = [PlannedBody::tracked(7, pose.position_m.as_vec3().to_array(), orientation)];
    let synthetic = SyntheticServer::new(Version::new(3, 1, 0, 0), 10_000_000);
    let frame = |number: i32| synthetic.datagram(number, 1.0, &planned).unwrap();
    server.send_to(&frame(1), "239.255.42.99:1511").unwrap();
    let mut question = [0; 64];
    let (length, from) = server.recv_from(&mut question).unwrap();
    assert_eq!(question[..length], [0, 0, 0, 0], "no NAT_CONNECT");
    let answer = natnet::ServerInfo {
        application_name: "Motive".to_owned(),
        server_version: Version::new(3, 1, 2, 1),
        protocol_version: Version::new(3, 1, 0, 0),
        high_res_clock_frequency: 10_000_000,
        connection: natnet::ConnectionInfo { data_port: 1511, multicast: true, multicast_group: [239, 255, 42, 99] },
    };
    server.send_to(&answer.to_datagram().unwrap(), from).unwrap();
    while client.status().unwrap()["trackers"]["motive"]["others"]["packets"] != 1 {
        std::thread::sleep(Duration::from_millis(10));
    }
    server.send_to(&frame(2), "239.255.42.99:1511").unwrap();
    let status = arrives(&mut client, "hand", &pose).unwrap_or_else(|error| panic!("{error:#}"));
    let motive = &status["trackers"]["motive"];
    assert_eq!((&motive["accepted"], &motive["rejected"]), (&1.into(), &1.into()), "{motive:#}");
    assert!(motive["last_reject"].as_str().unwrap().contains("127.0.0.1:1510 has not answered"), "{motive:#}");
}
