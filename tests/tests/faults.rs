//! What the daemon does when Vulkan calls fail: each call that it makes is made to, by the layer in `tests/faults`, while it starts
//! and while it does each of the things that a client may ask for.
//!
//! Whatever fails, it neither crashes nor hangs. What was asked is done or refused in words, and then what was shown before is
//! shown to the bit; where the device is lost or hangs, it is opened again. While it starts, it comes up or ends with one message.
//!
//! CI walks a part: of each call that an operation makes the first or the last one, with one of the results that it may give; of
//! operations that make many pipelines, only the calls that no other makes. With `LANTERN_FAULTS=all` every call of every operation
//! and of the start fails with every result: some thousands of cases.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    sync::Arc,
    thread,
    time::{Duration, Instant},
};

use lantern_tests::{
    client::{Client, Refused},
    faults::{self, Failure, Fault, Faults, HUNG, LOST, NO_DEVICE_MEMORY, NO_HOST_MEMORY},
    harness::{Daemon, Ended},
    lab, models,
};
use rustix::process::Signal;
use serde_json::{Value, json};
use tempfile::TempDir;

const SOON: Duration = Duration::from_secs(60);

/// Calls that answer with a loss: those that give the device work, or wait for it.
const WORK: [&str; 3] = ["vkQueueSubmit2", "vkWaitSemaphores", "vkGetSemaphoreCounterValue"];

fn walks_everything() -> bool {
    std::env::var("LANTERN_FAULTS").is_ok_and(|value| value == "all")
}

/// A daemon with the layer in it.
struct Bench {
    daemon: Daemon,
    client: Client,
    faults: Faults,
}

impl Bench {
    fn new(config: &str) -> Self {
        Self::in_folder(&Arc::new(tempfile::tempdir().unwrap()), config)
    }

    /// With a file of 320,000 triangles to add.
    fn with_hills() -> Self {
        let folder = Arc::new(tempfile::tempdir().unwrap());
        fs::write(folder.path().join("hills.glb"), models::hills(400, false)).unwrap();
        let tables = format!("[daemon]\nasset_roots = [{:?}]\n", folder.path().to_str().unwrap());
        Self::in_folder(&folder, &lab::room_with(&tables))
    }

    fn in_folder(folder: &Arc<TempDir>, config: &str) -> Self {
        let daemon = faults::start(folder, config, None).unwrap().unwrap();
        let faults = Faults::connect(folder.path()).unwrap();
        Self { client: daemon.client().unwrap(), daemon, faults }
    }

    fn lost(&mut self) -> u64 {
        self.client.status().unwrap()["device"]["lost"].as_u64().unwrap()
    }

    /// What both projectors show. A loss that nobody has noticed yet is noticed by this.
    fn pictures(&mut self) -> Vec<Vec<u8>> {
        pictures(&mut self.client)
    }
}

fn pictures(client: &mut Client) -> Vec<Vec<u8>> {
    let mut picture = |projector: &str| {
        let request = || json!({"projector": projector, "layer": "color"});
        let mut head = client.ask("snapshot", request()).unwrap();
        if head.as_ref().is_err_and(|refused| refused.code == "device-lost") {
            head = client.ask("snapshot", request()).unwrap();
        }
        client.bytes(&head.unwrap()).unwrap()
    };
    ["left", "right"].map(&mut picture).into()
}

/// Something that a client asks for, and what takes it back.
struct Operation {
    name: &'static str,
    there: fn(&mut Bench) -> Result<Value, Refused>,
    back: fn(&mut Bench) -> Result<Value, Refused>,
    /// Takes a second each time.
    is_slow: bool,
}

fn apply(bench: &mut Bench, edits: Value) -> Result<Value, Refused> {
    bench.client.ask("scene.apply", json!({"edits": edits, "durable": false})).unwrap()
}

/// A pose is taken at once; the snapshot waits for the frame that shows it, and may itself be what is refused.
fn pose(bench: &mut Bench, x: f64) -> Result<Value, Refused> {
    bench.client.pose("head", [x, 1.6, 2.5]).unwrap();
    if let Ok(head) = snapshot(bench, "color") {
        bench.client.bytes(&head).unwrap();
    }
    Ok(json!({}))
}

fn snapshot(bench: &mut Bench, layer: &str) -> Result<Value, Refused> {
    bench.client.ask("snapshot", json!({"projector": "left", "layer": layer})).unwrap()
}

fn pattern(bench: &mut Bench, name: &str) -> Result<Value, Refused> {
    bench.client.ask("pattern", json!({"name": name})).unwrap()
}

/// The room, where others may import the left projector's pictures.
fn room() -> String {
    lab::room().replacen("{ kind = \"headless\" }", "{ kind = \"export\" }", 1)
}

/// Takes one picture as its memory; the output that a fault may have closed is waited for.
fn export(bench: &mut Bench) -> Result<Value, Refused> {
    let started = Instant::now();
    while bench.client.status().unwrap()["projectors"]["left"]["screen"]["state"] != "shown" {
        assert!(started.elapsed() < SOON, "the output does not come back");
        thread::sleep(Duration::from_millis(20));
    }
    let mut reader = bench.daemon.client().unwrap();
    let opened = reader.ask("export.open", json!({"projector": "left"})).unwrap();
    if opened.is_ok() {
        // Whatever fails, it is told of a picture or of the end.
        let event = reader.line().unwrap().unwrap();
        assert!(["export", "export_end"].contains(&event["event"].as_str().unwrap()), "{event}");
    }
    opened
}

fn reload(bench: &mut Bench, samples: u32) -> Result<Value, Refused> {
    let config = room().replace("samples = 1", &format!("samples = {samples}"));
    fs::write(bench.daemon.folder().path().join("lantern.toml"), config).unwrap();
    bench.client.ask("config.reload", json!({})).unwrap()
}

const POT: &str = "lantern:teapot";

/// Everything that makes the daemon talk to its device.
const OPERATIONS: [Operation; 8] = [
    Operation {
        name: "an edit that moves a node",
        there: |bench| apply(bench, json!([{"set": {"node": "ball", "translation_m": [0.3, 0.4, 0]}}])),
        back: |bench| apply(bench, json!([{"set": {"node": "ball", "translation_m": [0, 0.4, 0]}}])),
        is_slow: false,
    },
    Operation {
        name: "an edit that adds a mesh",
        there: |bench| apply(bench, json!([{"add": {"node": "pot", "uri": POT, "translation_m": [0.8, 0, 0.5]}}])),
        back: |bench| apply(bench, json!([{"remove": {"node": "pot"}}])),
        is_slow: false,
    },
    Operation { name: "a pose", there: |bench| pose(bench, -0.5), back: |bench| pose(bench, 0.5), is_slow: false },
    Operation {
        name: "a pattern",
        there: |bench| pattern(bench, "grid"),
        back: |bench| pattern(bench, "off"),
        is_slow: false,
    },
    Operation {
        name: "a view of the room",
        there: |bench| snapshot(bench, "room").inspect(|head| drop(bench.client.bytes(head).unwrap())),
        back: |_| Ok(json!({})),
        is_slow: false,
    },
    Operation { name: "an export", there: export, back: |_| Ok(json!({})), is_slow: false },
    Operation {
        name: "an edit that wants other pipelines",
        there: |bench| apply(bench, json!([{"material": {"name": "ball/sphere", "transmission": 1, "roughness": 0}}])),
        back: |bench| apply(bench, json!([{"material": {"name": "ball/sphere", "transmission": 0, "roughness": 1}}])),
        is_slow: true,
    },
    Operation { name: "a reload", there: |bench| reload(bench, 4), back: |bench| reload(bench, 1), is_slow: true },
];

/// Which calls of an operation to fail, and how. `turn` makes parts of a walk differ.
fn cases(counts: &BTreeMap<String, u64>) -> Vec<Fault> {
    let mut cases = Vec::new();
    for (turn, (call, count)) in counts.iter().enumerate() {
        let results: &[Failure] = match call.as_str() {
            call if WORK.contains(&call) => &[LOST, NO_HOST_MEMORY, NO_DEVICE_MEMORY],
            "vkSetDebugUtilsObjectNameEXT" => &[NO_HOST_MEMORY],
            _ => &[NO_DEVICE_MEMORY, NO_HOST_MEMORY],
        };
        let one = [[1, *count][turn % 2]];
        let all: Vec<u64> = (1..=*count).collect();
        let (nths, results) = match (walks_everything(), WORK.contains(&call.as_str())) {
            (true, _) => (&all[..], results),
            (false, true) => (&one[..], &results[..2]),
            (false, false) => (&one[..], &results[turn % results.len()..][..1]),
        };
        cases.extend(nths.iter().flat_map(|nth| results.iter().map(|failure| Fault::once(call, *nth, *failure))));
    }
    cases
}

/// A refusal names what was being done, and is of a kind that a client can act upon.
#[track_caller]
fn assert_in_words(refused: &Refused, of: &str) {
    assert!(["out-of-memory", "device-lost", "render-failed"].contains(&refused.code.as_str()), "{of}: {refused}");
    let (operation, rest) = refused.message.split_once(": ").unwrap_or_default();
    assert!(operation.len() > 5 && rest.len() > 5, "{of}: {refused}");
}

#[test]
fn whatever_fails_is_refused_or_recovered_from() {
    let mut bench = Bench::new(&room());
    let mut called = bench.faults.clear().unwrap();
    assert_eq!(called.strangers, Vec::<String>::new(), "extensions or calls that the layer does not know");
    let base = bench.pictures();
    let (mut walked, mut failed) = (0, BTreeSet::new());
    for operation in &OPERATIONS {
        // Once there and back without a fault, to see what is called and what is shown. The second time what was made before is there.
        bench.faults.clear().unwrap();
        (operation.there)(&mut bench).unwrap();
        let counts = bench.faults.report().unwrap().counts;
        let there = bench.pictures();
        (operation.back)(&mut bench).unwrap();
        assert_eq!(bench.pictures(), base, "{} and back", operation.name);
        for (call, count) in &counts {
            *called.counts.entry(call.clone()).or_default() += count;
        }

        let mut cases = cases(&counts);
        if operation.is_slow && !walks_everything() {
            cases.retain(|fault| !failed.contains(&fault.call));
        }
        for fault in cases {
            let of = format!("{}, where {fault}", operation.name);
            let losses = bench.lost();
            bench.faults.arm(&fault).unwrap();
            let done = (operation.there)(&mut bench);
            let report = bench.faults.clear().unwrap();
            let shown = bench.pictures();
            if let Err(refused) = &done {
                assert!(report.fired > 0, "{of}: refused without a fault: {refused}");
                assert_in_words(refused, &of);
                assert!(shown == base, "{of}: refused, and something else is shown");
                (operation.there)(&mut bench)
                    .unwrap_or_else(|again| panic!("{of}: refused the next time as well: {again}"));
                assert!(bench.pictures() == there, "{of}: something else is shown the next time");
            } else {
                assert!(shown == there, "{of}: done, and something else is shown");
            }
            let lost = bench.lost() - losses;
            if fault.failure == LOST && report.fired > 0 {
                assert_eq!(lost, 1, "{of}: opened again {lost} times");
            }
            (operation.back)(&mut bench).unwrap_or_else(|refused| panic!("{of}: no way back: {refused}"));
            assert!(bench.pictures() == base, "{of}: something else is shown when it is taken back");
            walked += u64::from(report.fired > 0);
            failed.insert(fault.call);
        }
    }
    let status = bench.client.status().unwrap();
    assert_eq!(status["device"]["validation_messages"], 0);
    println!("{walked} faults, {} losses", status["device"]["lost"]);
    assert!(walked > 50, "only {walked}");

    // No call is missed: of those that the sources make, every one was made above.
    let missed: BTreeSet<String> =
        faults::calls_in_sources().unwrap().into_iter().filter(|c| !called.counts.contains_key(c)).collect();
    let elsewhere: BTreeSet<String> = NOT_CALLED_HERE.iter().map(|(call, _)| (*call).to_owned()).collect();
    let missed: Vec<_> = missed.difference(&elsewhere).collect();
    assert!(missed.is_empty(), "calls that nothing here makes: {missed:?}");
    let wrong: Vec<_> = elsewhere.iter().filter(|call| called.counts.contains_key(*call)).collect();
    assert_eq!(wrong, ["vkSignalSemaphore"; 0], "said to be called elsewhere");
    assert!(bench.daemon.stop().unwrap().success());
}

/// Calls of `daemon/gpu` that the walk does not make, and why.
const NOT_CALLED_HERE: [(&str, &str); 24] = [
    ("vkSignalSemaphore", "where a submission was refused; the walk fails those, and then it is called"),
    ("vkCreateAccelerationStructureKHR", "the software driver has no ray queries"),
    ("vkCreateWaylandSurfaceKHR", "of windows, which faults_windows.rs fails"),
    ("vkGetSemaphoreFdKHR", "the software driver exports no timelines"),
    ("vkWaitForPresentKHR", "the software driver has no VK_KHR_present_wait"),
    ("vkGetPhysicalDeviceSurfaceCapabilities2EXT", "another extension's, of nearly the same name"),
    ("vkGetPhysicalDeviceSurfaceCapabilities2KHR", "the software driver has no VK_NV_present_barrier"),
    ("vkCreateXcbSurfaceKHR", "of windows, which faults_windows.rs fails"),
    ("vkGetPhysicalDeviceSurfaceSupportKHR", "of windows, which faults_windows.rs fails"),
    ("vkGetPhysicalDeviceSurfaceCapabilitiesKHR", "of windows, which faults_windows.rs fails"),
    ("vkGetPhysicalDeviceSurfaceFormatsKHR", "of windows, which faults_windows.rs fails"),
    ("vkGetPhysicalDeviceSurfacePresentModesKHR", "of windows, which faults_windows.rs fails"),
    ("vkCreateSwapchainKHR", "of windows, which faults_windows.rs fails"),
    ("vkGetSwapchainImagesKHR", "of windows, which faults_windows.rs fails"),
    ("vkAcquireNextImageKHR", "of windows, which faults_windows.rs fails"),
    ("vkQueuePresentKHR", "of windows, which faults_windows.rs fails"),
    ("vkQueueWaitIdle", "of windows, which faults_windows.rs fails"),
    ("vkGetDisplayModePropertiesKHR", "of displays, of which none is wired to the software driver"),
    ("vkCreateDisplayPlaneSurfaceKHR", "of displays, of which none is wired to the software driver"),
    ("vkGetPhysicalDeviceDisplayPlanePropertiesKHR", "of displays, of which none is wired to the software driver"),
    ("vkGetDisplayPlaneSupportedDisplaysKHR", "of displays, of which none is wired to the software driver"),
    ("vkGetDrmDisplayEXT", "of displays, of which none is wired to the software driver"),
    ("vkAcquireDrmDisplayEXT", "of displays, of which none is wired to the software driver"),
    ("vkReleaseDisplayEXT", "of displays, of which none is wired to the software driver"),
];

#[test]
fn a_fault_at_the_start_ends_in_one_message_or_in_the_picture() {
    let config = lab::room();
    let folder = Arc::new(tempfile::tempdir().unwrap());
    let start = |fault: Option<&Fault>| faults::start(&folder, &config, fault).unwrap();
    let mut daemon = start(None).unwrap();
    let counts = Faults::connect(folder.path()).unwrap().report().unwrap().counts;
    let whole = pictures(&mut daemon.client().unwrap());
    assert!(daemon.stop().unwrap().success());
    let (mut ended, mut came_up) = (0, 0);
    for fault in cases(&counts) {
        match start(Some(&fault)) {
            Ok(mut daemon) => {
                assert!(
                    pictures(&mut daemon.client().unwrap()) == whole,
                    "{fault}: it came up and shows something else"
                );
                assert!(daemon.stop().unwrap().success(), "{fault}");
                came_up += 1;
            }
            Err(Ended { status, stderr }) => {
                assert_eq!(status.code(), Some(1), "{fault}: {stderr}");
                let said: Vec<_> = stderr.lines().filter(|line| line.starts_with("lanternd: ")).collect();
                assert!(said.len() == 1 && said[0].len() > 20, "{fault}: {stderr}");
                assert!(!stderr.contains("vulkan::validation") && !stderr.contains("panicked"), "{fault}: {stderr}");
                ended += 1;
            }
        }
    }
    println!("{ended} starts ended with a message, {came_up} came up");
    assert!(ended > 20 && came_up > 3, "{ended} ended, {came_up} came up");
}

#[test]
fn the_end_comes_whatever_fails() {
    for (call, failure) in
        [("vkGetPipelineCacheData", NO_HOST_MEMORY), ("vkWaitSemaphores", LOST), ("vkWaitSemaphores", HUNG)]
    {
        let mut bench = Bench::new(&lab::room());
        bench.faults.arm(&Fault::from_then_on(call, 1, failure)).unwrap();
        bench.daemon.signal(Signal::TERM).unwrap();
        let status = bench.daemon.wait(SOON).unwrap();
        assert_eq!(status.code(), Some(0), "{call} {}: {}", failure.name, bench.daemon.log());
    }
}

#[test]
fn the_end_comes_while_the_device_cannot_be_had() {
    let mut bench = Bench::new(&lab::room());
    bench.faults.arm(&Fault::from_then_on("vkQueueSubmit2", 1, LOST)).unwrap();
    let mut other = bench.daemon.client().unwrap();
    let edits = json!({"edits": [lab::mirror()], "durable": false});
    let waiting = thread::spawn(move || other.ask("scene.apply", edits));
    while bench.faults.report().unwrap().fired < 3 {
        thread::sleep(Duration::from_millis(5));
    }
    bench.daemon.signal(Signal::TERM).unwrap();
    assert_eq!(bench.daemon.wait(SOON).unwrap().code(), Some(0), "{}", bench.daemon.log());
    // Refused, or cut off.
    assert!(!matches!(waiting.join().unwrap(), Ok(Ok(_))));
}

#[test]
fn a_lost_device_is_opened_again_and_shows_the_newest_revision() {
    let mut bench = Bench::new(&lab::room());
    bench.client.ask_ok("pattern", json!({"name": "grid", "projector": "right"})).unwrap();
    let before = bench.client.status().unwrap();
    bench.faults.arm(&Fault::once("vkQueueSubmit2", 1, LOST)).unwrap();

    // Whoever waits for a revision hears of it when it is shown, on the new device.
    let applied = bench.client.apply(json!([lab::mirror()])).unwrap();
    bench.faults.clear().unwrap();
    let status = bench.client.status().unwrap();
    assert_eq!(status["device"]["lost"], 1);
    assert_eq!(status["device"]["name"], before["device"]["name"]);
    let projector = &status["projectors"]["left"];
    assert_eq!((&projector["revision"], &projector["frame"]), (&applied["revision"], &applied["frame"]));
    let frames = |status: &Value| status["projectors"]["left"]["frames"].as_u64().unwrap();
    assert!(frames(&status) > frames(&before), "frames are counted on");
    let again = bench.pictures();
    assert!(bench.daemon.log().contains("the device is lost") && bench.daemon.log().contains("shows again"));

    // The same as a daemon shows whose device was never lost, test pattern included.
    let mut other = Bench::new(&lab::room());
    other.client.ask_ok("pattern", json!({"name": "grid", "projector": "right"})).unwrap();
    other.client.apply(json!([lab::mirror()])).unwrap();
    assert!(again == other.pictures());
}

#[test]
fn a_device_that_hangs_is_given_up() {
    let mut bench = Bench::new(&lab::room());
    bench.faults.arm(&Fault::once("vkWaitSemaphores", 1, HUNG)).unwrap();
    let applied = bench.client.apply(json!([lab::mirror()])).unwrap();
    assert_eq!(bench.lost(), 1);
    assert!(bench.daemon.log().contains("has not finished within"), "{}", bench.daemon.log());
    let frame = bench.client.status().unwrap()["projectors"]["left"]["frame"].clone();
    assert_eq!(frame, applied["frame"]);
    assert!(bench.daemon.stop().unwrap().success());
}

#[test]
fn a_revision_over_which_the_device_is_lost_twice_is_refused() {
    let mut bench = Bench::new(&lab::room());
    let before = bench.pictures();
    // The second submission is that of the same revision on the new device.
    bench.faults.arm(&Fault::from_then_on("vkQueueSubmit2", 1, LOST)).unwrap();
    let mut second = bench.daemon.client().unwrap();
    let waiting = thread::spawn(move || second.ask("scene.apply", json!({"edits": [lab::mirror()], "durable": false})));
    while bench.faults.report().unwrap().fired < 2 {
        thread::sleep(Duration::from_millis(5));
    }
    bench.faults.clear().unwrap();
    let refused = waiting.join().unwrap().unwrap().unwrap_err();
    assert_eq!(refused.code, "device-lost", "{refused}");
    assert!(bench.pictures() == before);
    bench.client.apply(json!([lab::mirror()])).unwrap();
}

#[test]
fn a_device_that_cannot_be_had_again_ends_the_process_with_an_error() {
    let mut bench = Bench::new(&lab::room());
    bench.faults.arm(&Fault::from_then_on("vkQueueSubmit2", 1, LOST)).unwrap();
    let refused =
        bench.client.ask("scene.apply", json!({"edits": [lab::mirror()], "durable": false})).unwrap().unwrap_err();
    assert_eq!(refused.code, "device-lost", "{refused}");
    let status = bench.daemon.wait(SOON).unwrap();
    let log = bench.daemon.log();
    assert_eq!(status.code(), Some(1), "{log}");
    assert!(log.lines().any(|line| line.starts_with("lanternd: ") && line.contains("6 attempts")), "{log}");
}

/// Beyond what a frame takes along, and beyond the block of memory that small scenes share.
fn hills() -> Value {
    json!([{"add": {"node": "hills", "uri": "hills.glb", "translation_m": [0, 0.1, 0]}}])
}

#[test]
fn what_was_on_its_way_to_a_lost_device_gets_to_the_next_one() {
    let mut bench = Bench::with_hills();
    let before = bench.pictures();
    apply(&mut bench, hills()).unwrap();
    let there = bench.pictures();
    assert!(there != before);
    for (nth, failure) in [(2, LOST), (4, LOST), (3, HUNG)] {
        apply(&mut bench, json!([{"remove": {"node": "hills"}}])).unwrap();
        assert!(bench.pictures() == before);
        let losses = bench.lost();
        let call = if failure == LOST { "vkQueueSubmit2" } else { "vkWaitSemaphores" };
        bench.faults.arm(&Fault::once(call, nth, failure)).unwrap();
        apply(&mut bench, hills()).unwrap();
        assert_eq!((bench.faults.clear().unwrap().fired, bench.lost()), (1, losses + 1), "{call} {nth}");
        assert!(bench.pictures() == there, "{call} {nth}");
    }
}

#[test]
fn an_edit_beyond_the_devices_memory_is_refused_with_its_cost() {
    let mut bench = Bench::with_hills();
    let everything = lab::everything(&mut bench.client, "left").unwrap();
    let before = bench.client.status().unwrap();
    bench.faults.arm(&Fault::from_then_on("vkAllocateMemory", 1, NO_DEVICE_MEMORY)).unwrap();
    let refused = apply(&mut bench, hills()).unwrap_err();
    assert_eq!(refused.code, "out-of-memory");
    for words in ["this adds ", " MiB of meshes and images", " free of ", "out of device memory", "hint:"] {
        assert!(refused.message.contains(words), "`{words}` in {refused}");
    }
    assert_eq!(lab::everything(&mut bench.client, "left").unwrap(), everything);
    // What needs no more memory goes on, while the device still has none.
    apply(&mut bench, json!([{"set": {"node": "ball", "translation_m": [0.1, 0.4, 0]}}])).unwrap();
    bench.faults.clear().unwrap();
    apply(&mut bench, hills()).unwrap();
    assert_eq!(bench.client.status().unwrap()["device"]["lost"], before["device"]["lost"]);
}
