//! Frames on a real daemon that have less time than they need, or screens of different rates: what is shown in the end is whole.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]

use std::thread;
use std::time::{Duration, Instant};

use lantern_tests::client::Client;
use lantern_tests::harness::Daemon;
use lantern_tests::lab;
use serde_json::{Value, json};

/// The room with a mirror in it, and outputs of these rates; what `[render]` says besides.
fn room(render: &str, left_hz: u32, right_hz: u32) -> String {
    let with = |projector: String, hz: u32| {
        projector.replace("{ kind = \"headless\" }", &format!("{{ kind = \"headless\", refresh_hz = {hz} }}"))
    };
    let projectors = with(lab::stand(-1.0).toml("left"), left_hz) + &with(lab::stand(1.0).toml("right"), right_hz);
    [&format!("[render]\nsamples = 4\n{render}\n"), lab::SCENE, lab::TRACKED, &projectors].join("\n")
}

fn projector(client: &mut Client, name: &str) -> Value {
    client.status().unwrap()["projectors"][name].clone()
}

/// Moves the eye until `until` says so, or for ten seconds, and leaves it where it always ends.
fn walk(client: &mut Client, mut until: impl FnMut(&mut Client) -> bool) {
    let started = Instant::now();
    let mut step = 0;
    while started.elapsed() < Duration::from_secs(10) && !until(client) {
        step += 1;
        client.pose("head", [0.5 + 0.01 * f64::from(step % 50), 1.6, 2.5]).unwrap();
        thread::sleep(Duration::from_millis(4));
    }
    client.pose("head", [0.25, 1.5, 2.0]).unwrap();
}

#[test]
fn what_is_coarse_while_the_eye_moves_is_whole_when_it_rests_and_for_whoever_reads() {
    // No frame is made in a thousandth of a second.
    let whole = Daemon::start(&room("degrade = false", 1000, 1000)).unwrap();
    let coarse = Daemon::start(&room("degrade = true", 1000, 1000)).unwrap();
    let (mut whole_client, mut client) = (whole.client().unwrap(), coarse.client().unwrap());
    for client in [&mut whole_client, &mut client] {
        client.apply(json!([lab::mirror()])).unwrap();
    }
    let mut seen = false;
    walk(&mut client, |client| {
        seen |= projector(client, "left")["coarse"] == true;
        seen
    });
    assert!(seen, "it was never coarse");
    assert!(coarse.log().contains("reflections are coarser while anything moves"));
    // Whoever reads gets a whole picture at once.
    walk(&mut whole_client, |_| true);
    for name in ["left", "right"] {
        let expected = whole_client.snapshot(name, "color").unwrap();
        assert!(client.snapshot(name, "color").unwrap() == expected, "{name}");
    }
    assert_eq!(projector(&mut whole_client, "left")["coarse"], false);

    // And so does whoever merely waits.
    walk(&mut client, |client| projector(client, "left")["coarse"] == true);
    let started = Instant::now();
    while projector(&mut client, "left")["coarse"] == true {
        assert!(started.elapsed() < Duration::from_secs(20), "what rests stays coarse");
        thread::sleep(Duration::from_millis(20));
    }
    for mut daemon in [whole, coarse] {
        assert!(daemon.stop().unwrap().success());
        assert_eq!(daemon.ills(), Vec::<String>::new());
    }
}

#[test]
fn a_slower_screen_is_left_out_of_frames_that_it_would_not_show_and_misses_nothing_in_the_end() {
    let mut daemon = Daemon::start(&room("", 50, 2)).unwrap();
    let mut client = daemon.client().unwrap();
    client.apply(json!([lab::mirror()])).unwrap();
    let frames =
        |client: &mut Client| ["left", "right"].map(|name| projector(client, name)["frames"].as_u64().unwrap());
    let (before, started) = (frames(&mut client), Instant::now());
    walk(&mut client, |_| started.elapsed() > Duration::from_secs(3));
    let after = frames(&mut client);
    let [left, right] = [after[0] - before[0], after[1] - before[1]];
    // As many as it has refreshes, one under way at either end; an edit or a read may add none here.
    let refreshes = (started.elapsed().as_secs_f64() * 2.0).ceil() as u64 + 1;
    assert!(right >= 2 && right <= refreshes && left > right, "{left} and {right} of {refreshes}");

    // Both show the eye where it came to rest, as a daemon does that was never in a hurry.
    let calm = Daemon::start(&room("", 50, 50)).unwrap();
    let mut expected = calm.client().unwrap();
    expected.apply(json!([lab::mirror()])).unwrap();
    walk(&mut expected, |_| true);
    let started = Instant::now();
    for name in ["left", "right"] {
        let whole = expected.snapshot(name, "color").unwrap();
        assert!(client.snapshot(name, "color").unwrap() == whole, "{name} after {:?}", started.elapsed());
    }
    assert!(daemon.stop().unwrap().success());
    assert_eq!(daemon.ills(), Vec::<String>::new());
}
