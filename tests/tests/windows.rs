//! Windows of real desktops: they show the pixels of the snapshots, and one that is lost leaves the others alone and comes back.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]

use std::thread;
use std::time::{Duration, Instant};

use image::RgbImage;
use lantern_tests::client::Client;
use lantern_tests::desktops::{Desktop, Weston, Xvfb};
use lantern_tests::harness::Daemon;
use lantern_tests::lab;
use rustix::process::Signal;
use serde_json::{Value, json};

/// No output takes longer to be seen to come or to go, even beside other tests.
const LIMIT: Duration = Duration::from_secs(30);

/// The room, with these outputs for its projectors.
fn room(left: &str, right: &str) -> String {
    let with = |projector: String, output: &str| projector.replace("{ kind = \"headless\" }", output);
    let projectors = with(lab::stand(-1.0).toml("left"), left) + &with(lab::stand(1.0).toml("right"), right);
    [lab::RENDER, lab::SCENE, lab::TRACKED, &projectors].join("\n")
}

fn screen(client: &mut Client, projector: &str) -> Value {
    client.status().unwrap()["projectors"][projector]["screen"].clone()
}

/// Waits until an output is in this state, and gives what is said of it.
fn becomes(client: &mut Client, projector: &str, state: &str) -> Value {
    let started = Instant::now();
    loop {
        let screen = screen(client, projector);
        if screen["state"] == state {
            return screen;
        }
        assert!(started.elapsed() < LIMIT, "{projector} is {screen}, not {state}");
        thread::sleep(Duration::from_millis(50));
    }
}

/// Whether a desktop shows what snapshots say, whatever is done to the picture; and whether that is a picture at all.
fn follows(client: &mut Client, desktop: &dyn Desktop, projector: &str, ball_m: [f64; 3]) {
    let shown = |client: &mut Client| {
        let picture = client.png(projector, "color").unwrap();
        desktop.shows(&picture).unwrap();
        picture
    };
    let first = shown(client);
    assert!(first.pixels().any(|p| p.0 != [0; 3]) && first.pixels().any(|p| p.0 != first.get_pixel(0, 0).0));
    client.apply(json!([{"set": {"node": "ball", "translation_m": ball_m}}, lab::mirror()])).unwrap();
    let moved = shown(client);
    client.pose("head", [ball_m[0] + 1.5, 1.2, 2.0]).unwrap();
    let seen = shown(client);
    client.ask_ok("pattern", json!({"name": "grid"})).unwrap();
    let grid = shown(client);
    client.ask_ok("pattern", json!({"name": "off"})).unwrap();
    assert!(shown(client) == seen && first != moved && moved != seen && seen != grid);
}

fn ends_well(mut daemon: Daemon) {
    assert_eq!(daemon.client().unwrap().status().unwrap()["device"]["validation_messages"], 0);
    assert!(daemon.stop().unwrap().success());
    assert_eq!(daemon.ills(), Vec::<String>::new());
}

#[test]
fn windows_show_the_pixels_of_the_snapshots() {
    let size_px = lab::SIZE_PX.to_array();
    let (x11, wayland) = (Xvfb::start(size_px).unwrap(), Weston::start(size_px).unwrap());
    let left = format!("{{ kind = \"window\", server = \"{}\" }}", x11.server());
    let right = format!("{{ kind = \"window\", server = \"{}\", fullscreen = true }}", wayland.server());
    let daemon = Daemon::start(&room(&left, &right)).unwrap();
    let mut client = daemon.client().unwrap();
    for projector in ["left", "right"] {
        let screen = becomes(&mut client, projector, "shown");
        assert_eq!((&screen["pixels"], &screen["refresh_hz"]), (&json!("8-bit"), &json!(60.0)), "{screen}");
    }
    follows(&mut client, &x11, "left", [0.3, 0.5, 0.1]);
    follows(&mut client, &wayland, "right", [-0.3, 0.6, 0.2]);
    ends_well(daemon);
    // A projector that nobody drives any more shows nothing.
    x11.shows(&RgbImage::new(size_px[0], size_px[1])).unwrap();
}

#[test]
fn a_lost_output_comes_back_while_the_others_go_on() {
    let size_px = lab::SIZE_PX.to_array();
    let (mut x11, mut wayland) = (Xvfb::start(size_px).unwrap(), Weston::start(size_px).unwrap());
    let left = format!("{{ kind = \"window\", server = \"{}\", fullscreen = \"screen\" }}", x11.server());
    let right = format!("{{ kind = \"window\", server = \"{}\", fullscreen = true }}", wayland.server());
    let daemon = Daemon::start(&room(&left, &right)).unwrap();
    let (mut client, mut listener) = (daemon.client().unwrap(), daemon.client().unwrap());
    listener.ask_ok("subscribe", json!({"events": ["output"]})).unwrap();
    let mut told = |projector: &str, state: &str| {
        let event = listener.line().unwrap().unwrap();
        assert_eq!(
            (&event["event"], &event["projector"], &event["state"]),
            (&json!("output"), &json!(projector), &json!(state))
        );
        event
    };

    becomes(&mut client, "left", "shown");
    x11.crash();
    let lost = becomes(&mut client, "left", "lost");
    assert!(lost["detail"].as_str().is_some_and(|why| !why.is_empty()), "{lost}");
    told("left", "lost");
    // The other one goes on, and what is edited meanwhile is there when this one is back.
    client.apply(json!([{"set": {"node": "ball", "translation_m": [0.2, 0.6, 0.0]}}])).unwrap();
    wayland.shows(&client.png("right", "color").unwrap()).unwrap();
    x11.restart().unwrap();
    becomes(&mut client, "left", "shown");
    x11.shows(&client.png("left", "color").unwrap()).unwrap();

    wayland.crash();
    becomes(&mut client, "right", "lost");
    client.apply(json!([{"set": {"node": "ball", "translation_m": [0.1, 0.4, 0.0]}}])).unwrap();
    x11.shows(&client.png("left", "color").unwrap()).unwrap();
    ends_well(daemon);
}

#[test]
fn frames_go_on_as_before_when_an_output_comes_back_while_something_moves() {
    let size_px = lab::SIZE_PX.to_array();
    let mut x11 = Xvfb::start(size_px).unwrap();
    let left = format!("{{ kind = \"window\", server = \"{}\", refresh_hz = 20 }}", x11.server());
    let daemon = Daemon::start(&room(&left, "{ kind = \"headless\", refresh_hz = 20 }")).unwrap();
    let mut client = daemon.client().unwrap();
    // Moves the eye for so long, or until an output is there: frames meanwhile.
    let walk = |client: &mut Client, time: Duration, shown: bool| {
        let frames = |client: &mut Client| client.status().unwrap()["projectors"]["right"]["frames"].as_u64().unwrap();
        let (before, started) = (frames(client), Instant::now());
        while started.elapsed() < time && !(shown && screen(client, "left")["state"] == "shown") {
            client.pose("head", [0.5 + started.elapsed().as_secs_f64() % 1.0, 1.6, 2.5]).unwrap();
            thread::sleep(Duration::from_millis(10));
        }
        frames(client) - before
    };
    becomes(&mut client, "left", "shown");
    client.apply(json!([lab::mirror()])).unwrap();
    walk(&mut client, Duration::from_secs(5), false);
    x11.crash();
    assert!(walk(&mut client, Duration::from_secs(2), false) > 4, "they stop where it goes");
    x11.restart().unwrap();
    walk(&mut client, LIMIT, true);
    assert_eq!(screen(&mut client, "left")["state"], "shown");
    // Of some forty; a clock that starts again would have to run for seven seconds before the next.
    assert!(walk(&mut client, Duration::from_secs(2), false) > 4, "they stop where it comes back");
    x11.shows(&client.png("left", "color").unwrap()).unwrap();
    ends_well(daemon);
}

#[test]
fn a_window_whose_monitor_goes_shows_nothing_until_it_is_back() {
    let [columns, rows] = lab::SIZE_PX.to_array();
    let x11 = Xvfb::start([columns * 2, rows]).unwrap();
    x11.monitors(&format!("--setmonitor lab {columns}/25x{rows}/17+{columns}+0 none")).unwrap();
    let left = format!("{{ kind = \"window\", server = \"{}\", fullscreen = \"lab\" }}", x11.server());
    let daemon = Daemon::start(&room(&left, "{ kind = \"headless\" }")).unwrap();
    let mut client = daemon.client().unwrap();
    becomes(&mut client, "left", "shown");
    // It stands on the right half of the screen, and nothing stands on the left one.
    let beside = |picture: RgbImage| {
        let mut both = RgbImage::new(columns * 2, rows);
        image::imageops::replace(&mut both, &picture, columns.into(), 0);
        both
    };
    x11.shows(&beside(client.png("left", "color").unwrap())).unwrap();
    // The same pixels at another place are another projector's.
    x11.monitors("--delmonitor lab").unwrap();
    becomes(&mut client, "left", "lost");
    x11.shows(&RgbImage::new(columns * 2, rows)).unwrap();
    x11.monitors(&format!("--setmonitor lab {columns}/25x{rows}/17+{columns}+0 none")).unwrap();
    becomes(&mut client, "left", "shown");
    x11.shows(&beside(client.png("left", "color").unwrap())).unwrap();
    ends_well(daemon);
}

#[test]
fn a_desktop_that_does_not_answer_holds_up_neither_the_start_nor_the_others() {
    let size_px = lab::SIZE_PX.to_array();
    let (x11, wayland) = (Xvfb::start(size_px).unwrap(), Weston::start(size_px).unwrap());
    for (desktop, fullscreen) in [(&x11 as &dyn Desktop, false), (&wayland, true)] {
        desktop.signal(Signal::STOP).unwrap();
        let left = format!("{{ kind = \"window\", server = \"{}\", fullscreen = {fullscreen} }}", desktop.server());
        let daemon = Daemon::start(&room(&left, "{ kind = \"headless\" }")).unwrap();
        let mut client = daemon.client().unwrap();
        let lost = becomes(&mut client, "left", "lost");
        assert!(lost["detail"].as_str().unwrap().contains("does not answer"), "{lost}");
        client.apply(json!([lab::mirror()])).unwrap();
        // It is still waited for.
        desktop.signal(Signal::CONT).unwrap();
        becomes(&mut client, "left", "shown");
        desktop.shows(&client.png("left", "color").unwrap()).unwrap();
        ends_well(daemon);
    }
}

#[test]
fn where_the_pixels_are_not_those_of_the_calibration_it_stays_dark() {
    let [columns, rows] = lab::SIZE_PX.to_array();
    let x11 = Xvfb::start([columns + 32, rows + 16]).unwrap();
    let left = format!("{{ kind = \"window\", server = \"{}\", fullscreen = true }}", x11.server());
    let daemon = Daemon::start(&room(&left, "{ kind = \"headless\" }")).unwrap();
    let mut client = daemon.client().unwrap();
    let screen = becomes(&mut client, "left", "black");
    let words = format!("it has {}x{} px, and the calibration is for {columns}x{rows}", columns + 32, rows + 16);
    assert_eq!(screen["detail"], words);
    x11.shows(&RgbImage::new(columns + 32, rows + 16)).unwrap();
    // The picture itself is there for whoever asks.
    assert!(client.png("left", "color").unwrap().pixels().any(|p| p.0 != [0; 3]));
    ends_well(daemon);
}

#[test]
fn an_output_that_never_comes_is_said_and_without_any_the_start_fails() {
    let nowhere = "{ kind = \"window\", server = \":4711\" }";
    let folder = std::sync::Arc::new(tempfile::tempdir().unwrap());
    let config = room(nowhere, "{ kind = \"display\", connector = \"DP-99\" }");
    let ended =
        Daemon::try_start_in(&folder, &config).unwrap().map(drop).expect_err("it has nothing to show anything on");
    assert_eq!(ended.status.code(), Some(1));
    for words in ["no output is there", "output of left", ":4711", "output of right"] {
        assert!(ended.stderr.contains(words), "{words} is not in\n{}", ended.stderr);
    }

    // With one that is there it starts all the same.
    let daemon = Daemon::start(&room(nowhere, "{ kind = \"headless\" }")).unwrap();
    let mut client = daemon.client().unwrap();
    assert_eq!(screen(&mut client, "left")["state"], "lost");
    assert_eq!(screen(&mut client, "right")["state"], "shown");
    ends_well(daemon);
}

#[test]
fn a_reload_takes_other_outputs_and_keeps_those_that_stay() {
    let size_px = lab::SIZE_PX.to_array();
    let (first, second) = (Xvfb::start(size_px).unwrap(), Xvfb::start(size_px).unwrap());
    let on = |server: &Xvfb| format!("{{ kind = \"window\", server = \"{}\" }}", server.server());
    let daemon = Daemon::start(&room(&on(&first), "{ kind = \"headless\" }")).unwrap();
    let mut client = daemon.client().unwrap();
    first.shows(&client.png("left", "color").unwrap()).unwrap();
    let reload = |client: &mut Client, config: &str| {
        std::fs::write(daemon.folder().path().join("lantern.toml"), config).unwrap();
        client.ask_ok("config.reload", json!({})).unwrap();
    };

    // A monitor that is not there is lost, and says which there are; the other output is not touched.
    let absent = format!("{{ kind = \"window\", server = \"{}\", fullscreen = \"HDMI-9\" }}", second.server());
    reload(&mut client, &room(&on(&first), &absent));
    let started = Instant::now();
    let words = "there is no monitor \"HDMI-9\"; hint: there are screen";
    while !becomes(&mut client, "right", "lost")["detail"].as_str().unwrap().contains(words) {
        assert!(started.elapsed() < LIMIT, "{words} is not said");
        thread::sleep(Duration::from_millis(50));
    }
    first.shows(&client.png("left", "color").unwrap()).unwrap();

    reload(&mut client, &room(&on(&first), &on(&second)));
    becomes(&mut client, "right", "shown");
    for (desktop, projector) in [(&first, "left"), (&second, "right")] {
        desktop.shows(&client.png(projector, "color").unwrap()).unwrap();
    }
    reload(&mut client, &room("{ kind = \"headless\" }", &on(&second)));
    first.shows(&RgbImage::new(size_px[0], size_px[1])).unwrap();
    second.shows(&client.png("right", "color").unwrap()).unwrap();
    ends_well(daemon);
}
