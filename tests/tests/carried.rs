//! A projector that a body carries shows what a projector shows that was calibrated there.

use glam::{DQuat, DVec3, UVec2};
use lantern_tests::{harness::Daemon, stage::Stand};
use serde_json::json;

const SIZE_PX: UVec2 = UVec2::new(160, 100);
/// Where the carrying body stood when the projector was calibrated.
const HOME_M: DVec3 = DVec3::new(0.3, 1.5, 2.0);

/// A floor with a ball and a box, lit by one projector, which `rig` carries.
fn config(stand: &Stand, carried: bool) -> String {
    let drives = if carried { "drives = \"projector:left\"\n" } else { "" };
    let node = |name: &str, shape: &str, at: [f64; 3], size: f64| {
        format!(
            "[[scene.node]]\nname = \"{name}\"\nuri = \"lantern:{shape}\"\ntranslation_m = {at:?}\nscale = [{size}, {size}, {size}]\n"
        )
    };
    format!(
        "[render]\nsamples = 1\n{}{}{}[[body]]\nname = \"rig\"\n{drives}position_m = {:?}\n{}",
        node("floor", "quad", [0.0; 3], 6.0),
        node("ball", "sphere", [-0.5, 0.3, 0.0], 0.3),
        node("box", "cube", [0.5, 0.2, 0.1], 0.4),
        HOME_M.to_array(),
        stand.toml("left"),
    )
}

#[test]
fn a_carried_projector_goes_with_its_body() {
    let home = Stand::new(DVec3::new(0.2, 1.7, 2.6), DVec3::new(0.0, 0.2, 0.0), SIZE_PX);
    let daemon = Daemon::start(&config(&home, true)).unwrap();
    let mut client = daemon.client().unwrap();
    let at_home = client.layer("left", "distance").unwrap();
    let mut seen = vec![at_home.values.clone()];
    for (turn_rad, to_m) in
        [(0.0, HOME_M + DVec3::new(-0.4, 0.1, 0.2)), (0.5, DVec3::new(1.2, 1.4, 1.5)), (0.0, HOME_M)]
    {
        let turn = DQuat::from_rotation_y(turn_rad);
        let pose = json!({"body": "rig", "position_m": to_m.to_array(), "orientation": turn.to_array()});
        client.ask_ok("pose", pose).unwrap();
        let carried = [client.layer("left", "distance").unwrap(), client.layer("left", "node").unwrap()];

        // One that was calibrated where the body holds the other.
        let there = |at_m: DVec3| to_m + turn * (at_m - HOME_M);
        let stand = Stand { position_m: there(home.position_m), target_m: there(home.target_m), ..home };
        let still = Daemon::start(&config(&stand, false)).unwrap();
        let mut other = still.client().unwrap();
        let expected = [other.layer("left", "distance").unwrap(), other.layer("left", "node").unwrap()];
        let same = |at: &usize| {
            let [carried, expected] = [&carried, &expected].map(|of| (of[0].values[*at], of[1].values[*at]));
            carried == expected || carried.1 == expected.1 && (carried.0 - expected.0).abs() < 1e-4 * expected.0
        };
        let count = (0..carried[0].values.len()).filter(same).count();
        assert!(count + 20 >= carried[0].values.len(), "turned by {turn_rad}: {count} pixels are the same");
        seen.push(carried[0].values.clone());
    }
    assert!(seen[0] != seen[1] && seen[1] != seen[2], "it moved");
    assert!(seen[0] == seen[3], "back home, to the bit");
    assert_eq!(daemon.ills(), Vec::<String>::new());
}

#[test]
fn a_reload_may_hand_a_projector_to_a_body() {
    let home = Stand::new(DVec3::new(0.2, 1.7, 2.6), DVec3::new(0.0, 0.2, 0.0), SIZE_PX);
    let daemon = Daemon::start(&config(&home, false)).unwrap();
    let mut client = daemon.client().unwrap();
    let before = client.layer("left", "distance").unwrap().values;
    let moved = json!({"body": "rig", "position_m": (HOME_M + DVec3::X * 0.3).to_array()});
    client.ask_ok("pose", moved.clone()).unwrap();
    assert!(client.layer("left", "distance").unwrap().values == before, "nothing carries it yet");

    std::fs::write(daemon.folder().path().join("lantern.toml"), config(&home, true)).unwrap();
    client.ask_ok("config.reload", json!({})).unwrap();
    client.ask_ok("pose", moved).unwrap();
    assert!(client.layer("left", "distance").unwrap().values != before, "the body carries it now");
    client.ask_ok("pose", json!({"body": "rig", "position_m": HOME_M.to_array()})).unwrap();
    assert!(client.layer("left", "distance").unwrap().values == before, "back home, to the bit");
}
