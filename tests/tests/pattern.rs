//! Test patterns on a real daemon: exactly the pattern in place of the scene, on the projectors asked for, and the scene again.

use lantern_tests::{harness::Daemon, lab};
use serde_json::json;

#[test]
fn a_pattern_stands_in_for_the_scene_until_it_is_off() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let mut client = daemon.client().unwrap();
    let (left, right) = (client.png("left", "color").unwrap(), client.png("right", "color").unwrap());

    client.ask_ok("pattern", json!({"name": "white", "projector": "left"})).unwrap();
    assert!(client.png("left", "color").unwrap().pixels().all(|p| p.0 == [255; 3]));
    assert!(client.png("right", "color").unwrap() == right, "the other projector has changed");

    client.ask_ok("pattern", json!({"name": "black"})).unwrap();
    for projector in ["left", "right"] {
        assert!(client.png(projector, "color").unwrap().pixels().all(|p| p.0 == [0; 3]), "{projector}");
    }

    // Squares of 64 px, white at the top left: the image is 96 wide and 64 high.
    client.ask_ok("pattern", json!({"name": "checker"})).unwrap();
    let checker = client.png("left", "color").unwrap();
    assert!(checker.enumerate_pixels().all(|(x, _, p)| p.0 == [if x < 64 { 255 } else { 0 }; 3]));

    // The frame shows whether the whole image arrives; what identifies differs from projector to projector.
    for name in ["grid", "identify"] {
        client.ask_ok("pattern", json!({ "name": name })).unwrap();
        let shown = client.png("left", "color").unwrap();
        let (w, h) = shown.dimensions();
        let on_frame = |x: u32, y: u32| x == 0 || y == 0 || x == w - 1 || y == h - 1;
        assert!(
            shown.enumerate_pixels().filter(|(x, y, _)| on_frame(*x, *y)).all(|(_, _, p)| p.0 == [255; 3]),
            "{name}"
        );
        assert_eq!(shown == client.png("right", "color").unwrap(), name == "grid", "{name}");
    }

    client.ask_ok("pattern", json!({"name": "off"})).unwrap();
    assert!(client.png("left", "color").unwrap() == left && client.png("right", "color").unwrap() == right);
}

#[test]
fn a_pattern_stays_when_the_configuration_renders_otherwise() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let mut client = daemon.client().unwrap();
    client.ask_ok("pattern", json!({"name": "white", "projector": "left"})).unwrap();
    let right = client.png("right", "color").unwrap();
    let config = lab::room().replace("samples = 1", "samples = 4");
    std::fs::write(daemon.folder().path().join("lantern.toml"), config).unwrap();
    client.ask_ok("config.reload", json!({})).unwrap();
    assert!(client.png("right", "color").unwrap() != right, "it renders as before");
    assert!(client.png("left", "color").unwrap().pixels().all(|p| p.0 == [255; 3]), "the pattern has gone");
}
