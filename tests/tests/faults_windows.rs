//! What the daemon does when Vulkan calls of a window fail: the window is lost, or the device is, and both come back; the other
//! projector shows what it should all along.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::collections::BTreeSet;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use lantern_tests::client::Client;
use lantern_tests::desktops::{Desktop, Weston, Xvfb};
use lantern_tests::faults::{
    self, Failure, Fault, Faults, HUNG, LOST, NO_DEVICE_MEMORY, NO_HOST_MEMORY, NO_SURFACE, OUTDATED, SUBOPTIMAL,
};
use lantern_tests::harness::Daemon;
use lantern_tests::lab;
use serde_json::json;

/// A window that was lost is tried again once a second; nothing takes longer, even beside other tests.
const LIMIT: Duration = Duration::from_secs(30);

/// Frames that a window shows in turn.
const PICTURES: u32 = 20;

/// Calls of a window that is there, and how each may fail.
const SHOWING: [(&str, &[Failure]); 3] = [
    ("vkAcquireNextImageKHR", &[OUTDATED, NO_SURFACE, LOST, SUBOPTIMAL]),
    ("vkQueuePresentKHR", &[OUTDATED, NO_SURFACE, LOST, SUBOPTIMAL]),
    ("vkQueueSubmit2", &[NO_HOST_MEMORY]),
];

/// Calls of one that is opened.
const OPENING: [(&str, Failure); 9] = [
    ("vkCreateXcbSurfaceKHR", NO_HOST_MEMORY),
    ("vkGetPhysicalDeviceSurfaceSupportKHR", NO_SURFACE),
    ("vkGetPhysicalDeviceSurfaceCapabilitiesKHR", NO_SURFACE),
    ("vkGetPhysicalDeviceSurfaceFormatsKHR", NO_HOST_MEMORY),
    ("vkGetPhysicalDeviceSurfacePresentModesKHR", NO_DEVICE_MEMORY),
    ("vkCreateSwapchainKHR", NO_DEVICE_MEMORY),
    ("vkGetSwapchainImagesKHR", NO_HOST_MEMORY),
    ("vkCreateSemaphore", NO_DEVICE_MEMORY),
    ("vkQueueWaitIdle", NO_HOST_MEMORY),
];

/// The room, the left projector in a window.
fn room(x11: &Xvfb, latency_ms: u32) -> String {
    let window = format!("{{ kind = \"window\", server = \"{}\", latency_ms = {latency_ms} }}", x11.server());
    let left = lab::stand(-1.0).toml("left").replace("{ kind = \"headless\" }", &window);
    [lab::RENDER, lab::SCENE, lab::TRACKED, &left, &lab::stand(1.0).toml("right")].join("\n")
}

/// Waits until the window shows the picture; it may have to come back first.
fn shows(client: &mut Client, desktop: &dyn Desktop, of: &str) {
    let started = Instant::now();
    while client.status().unwrap()["projectors"]["left"]["screen"]["state"] != "shown" {
        assert!(started.elapsed() < LIMIT, "{of}: the window does not come back");
        thread::sleep(Duration::from_millis(50));
    }
    let picture = client.png("left", "color").unwrap();
    desktop.shows(&picture).unwrap_or_else(|error| panic!("{of}: {error}"));
}

#[test]
fn a_device_that_hangs_leaves_no_window_behind_and_one_that_is_lost_waits_for_its_outputs() {
    let mut x11 = Xvfb::start(lab::SIZE_PX.to_array()).unwrap();
    let folder = Arc::new(tempfile::tempdir().unwrap());
    // One projector, in a window: without that there is nothing to show anything on.
    let window = format!("{{ kind = \"window\", server = \"{}\" }}", x11.server());
    let left = lab::stand(-1.0).toml("left").replace("{ kind = \"headless\" }", &window);
    let config = [lab::RENDER, lab::SCENE, lab::TRACKED, &left].join("\n");
    let mut daemon: Daemon = faults::start(&folder, &config, None).unwrap().unwrap();
    let mut faults = Faults::connect(folder.path()).unwrap();
    let mut client = daemon.client().unwrap();
    shows(&mut client, &x11, "at the start");

    faults.arm(&Fault::once("vkWaitSemaphores", 1, HUNG)).unwrap();
    let edits = json!({"edits": [{"set": {"node": "ball", "translation_m": [0.1, 0.4, 0]}}], "durable": false});
    let _refused_perhaps = client.ask("scene.apply", edits).unwrap();
    faults.clear().unwrap();
    assert_eq!(client.status().unwrap()["device"]["lost"], 1);
    shows(&mut client, &x11, "after it hung");
    let started = Instant::now();
    while daemon.threads_named("window left").unwrap() != 1 {
        assert!(started.elapsed() < LIMIT, "the window before stays");
        thread::sleep(Duration::from_millis(50));
    }

    // A start waits ten seconds for outputs, and fails where none comes. This is none.
    x11.crash();
    faults.arm(&Fault::once("vkQueueSubmit2", 1, LOST)).unwrap();
    let edits = json!({"edits": [{"set": {"node": "ball", "translation_m": [0.2, 0.4, 0]}}], "durable": false});
    let _refused_perhaps = client.ask("scene.apply", edits).unwrap();
    assert!(faults.clear().unwrap().fired > 0);
    thread::sleep(Duration::from_secs(12));
    assert_eq!(client.status().unwrap()["device"]["lost"], 2);
    x11.restart().unwrap();
    shows(&mut client, &x11, "after it was lost");
    assert!(daemon.stop().unwrap().success());
}

#[test]
fn a_window_whose_calls_fail_comes_back_and_takes_nothing_with_it() {
    let x11 = Xvfb::start(lab::SIZE_PX.to_array()).unwrap();
    let folder = Arc::new(tempfile::tempdir().unwrap());
    let mut daemon: Daemon = faults::start(&folder, &room(&x11, 0), None).unwrap().unwrap();
    let mut faults = Faults::connect(folder.path()).unwrap();
    let mut client = daemon.client().unwrap();
    let strangers = faults.clear().unwrap().strangers;
    assert_eq!(strangers, Vec::<String>::new(), "extensions or calls that the layer does not know");
    shows(&mut client, &x11, "at the start");

    let mut turn = 0;
    let mut losses = 0;
    for (call, results) in SHOWING {
        for failure in results {
            let (fault, nth) = (Fault::once(call, 1, *failure), turn);
            faults.arm(&fault).unwrap();
            let edit = json!([{"set": {"node": "ball", "translation_m": [0.05 * f64::from(nth + 1), 0.4, 0]}}]);
            // Whoever edits hears of it at most where the device is lost, or the very work of the frame was refused.
            let done = client.ask("scene.apply", json!({"edits": edit, "durable": false})).unwrap();
            if let Err(refused) = done {
                assert!(["device-lost", "out-of-memory"].contains(&refused.code.as_str()), "{fault}: {refused}");
            }
            shows(&mut client, &x11, &fault.to_string());
            assert!(faults.clear().unwrap().fired > 0, "{fault} was never called");
            losses += u64::from(*failure == LOST);
            turn += 1;
        }
    }
    assert_eq!(client.status().unwrap()["device"]["lost"], losses);

    let mut opened = BTreeSet::new();
    for (call, failure) in OPENING {
        let fault = Fault::once(call, 1, failure);
        faults.arm(&fault).unwrap();
        turn += 1;
        std::fs::write(folder.path().join("lantern.toml"), room(&x11, turn)).unwrap();
        client.ask_ok("config.reload", json!({})).unwrap();
        shows(&mut client, &x11, &fault.to_string());
        assert!(faults.clear().unwrap().fired > 0, "{fault} was never called");
        opened.insert(call);
    }
    assert_eq!(opened.len(), OPENING.len());
    assert_eq!(client.status().unwrap()["device"]["validation_messages"], 0);
    assert!(daemon.stop().unwrap().success());
}

#[test]
fn a_surface_that_goes_on_being_less_than_the_best_gets_no_swapchain_for_each_picture() {
    let x11 = Xvfb::start(lab::SIZE_PX.to_array()).unwrap();
    let folder = Arc::new(tempfile::tempdir().unwrap());
    let mut daemon: Daemon = faults::start(&folder, &room(&x11, 0), None).unwrap().unwrap();
    let mut faults = Faults::connect(folder.path()).unwrap();
    let mut client = daemon.client().unwrap();
    shows(&mut client, &x11, "at the start");
    for (turn, call) in ["vkAcquireNextImageKHR", "vkQueuePresentKHR"].into_iter().enumerate() {
        let fault = Fault::from_then_on(call, 1, SUBOPTIMAL);
        let started = Instant::now();
        faults.arm(&fault).unwrap();
        for nth in 1..=PICTURES {
            let at_m = [0.01 * f64::from(nth), 0.4 + 0.1 * turn as f64, 0.0];
            let edit = json!([{"set": {"node": "ball", "translation_m": at_m}}]);
            client.ask_ok("scene.apply", json!({"edits": edit, "durable": false})).unwrap();
        }
        shows(&mut client, &x11, &fault.to_string());
        let report = faults.report().unwrap();
        let calls = |name: &str| report.counts.get(name).copied().unwrap_or(0);
        // One a second, the first of them at once.
        let (made, at_most) = (calls("vkCreateSwapchainKHR"), started.elapsed().as_secs() + 1);
        assert!(report.fired >= u64::from(PICTURES) && calls("vkQueuePresentKHR") >= u64::from(PICTURES), "{report:?}");
        assert!(made <= at_most, "{fault}: {made} swapchains, and not {at_most} at most");
    }
    faults.clear().unwrap();
    assert_eq!(client.status().unwrap()["device"]["lost"], 0);
    assert_eq!(client.status().unwrap()["device"]["validation_messages"], 0);
    assert!(daemon.stop().unwrap().success());
}

#[test]
fn a_wayland_window_comes_back_from_the_call_that_x11_has_not() {
    let wayland = Weston::start(lab::SIZE_PX.to_array()).unwrap();
    let folder = Arc::new(tempfile::tempdir().unwrap());
    let room = |latency_ms: u32| {
        let server = wayland.server();
        let window =
            format!("{{ kind = \"window\", server = \"{server}\", fullscreen = true, latency_ms = {latency_ms} }}");
        let left = lab::stand(-1.0).toml("left").replace("{ kind = \"headless\" }", &window);
        [lab::RENDER, lab::SCENE, lab::TRACKED, &left, &lab::stand(1.0).toml("right")].join("\n")
    };
    let mut daemon: Daemon = faults::start(&folder, &room(0), None).unwrap().unwrap();
    let mut faults = Faults::connect(folder.path()).unwrap();
    let mut client = daemon.client().unwrap();
    shows(&mut client, &wayland, "at the start");
    let fault = Fault::once("vkCreateWaylandSurfaceKHR", 1, NO_HOST_MEMORY);
    faults.arm(&fault).unwrap();
    std::fs::write(folder.path().join("lantern.toml"), room(1)).unwrap();
    client.ask_ok("config.reload", json!({})).unwrap();
    shows(&mut client, &wayland, &fault.to_string());
    assert!(faults.clear().unwrap().fired > 0, "{fault} was never called");
    assert_eq!(client.status().unwrap()["device"]["validation_messages"], 0);
    assert!(daemon.stop().unwrap().success());
}
