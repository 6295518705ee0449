//! `lanternd` as one calls it: what it prints, and how it ends (CONTRACT, Programs and Bench).
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
    time::{Duration, Instant},
};

use lantern_tests::{harness, lab, stage::Stand};
use serde_json::{Value, json};
use tempfile::TempDir;

/// A configuration in a folder of its own.
fn written(config: &str) -> (TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("lab.toml");
    fs::write(&file, config).unwrap();
    (folder, file.to_str().unwrap().to_owned())
}

/// What a program said and how it ended; any word of the validation layer, or of a panic, is a failure.
#[track_caller]
fn told(output: Output) -> (Option<i32>, String, String) {
    let [stdout, stderr] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
    assert!(!stderr.contains("vulkan::validation") && !stderr.contains("panicked"), "{stderr}");
    (output.status.code(), stdout, stderr)
}

#[track_caller]
fn lanternd(arguments: &[&str]) -> (Option<i32>, String, String) {
    told(harness::run("lanternd", arguments).unwrap())
}

#[test]
fn run_ends_after_its_frames_even_where_nothing_moves() {
    let (folder, file) = written(&lab::room());
    let socket = folder.path().join("deep/er/s");
    let mut command = harness::command("lanternd").unwrap();
    command.args(["run", "-c", &file, "--socket", socket.to_str().unwrap(), "--frames", "40"]);
    let started = Instant::now();
    let (code, stdout, stderr) = told(command.output().unwrap());
    assert_eq!((code, stdout.as_str()), (Some(0), ""), "{stderr}");
    assert!(!socket.exists() && started.elapsed() < Duration::from_secs(60), "{stderr}");
    assert!(!stderr.contains('\x1b'), "colours in what is no terminal: {stderr}");
}

#[test]
fn the_socket_is_the_first_that_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    let in_config = place("config.sock");
    let file = place("lab.toml");
    fs::write(&file, lab::room_with(&format!("[daemon]\nsocket = {:?}\n", in_config.to_str().unwrap()))).unwrap();

    // A file that is no socket stops a daemon before it renders, with its name.
    let stops_at = |path: &Path, command: &mut Command| {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, "").unwrap();
        let (code, _, stderr) = told(command.output().unwrap());
        assert!(
            code == Some(1) && stderr.contains(&format!("{} is there and is no socket", path.display())),
            "{stderr}"
        );
    };
    let run = || {
        let mut command = harness::command("lanternd").unwrap();
        command.args(["run", "--frames", "1", "-c"]).arg(&file).env_remove("XDG_RUNTIME_DIR");
        command
    };
    stops_at(
        &place("argument.sock"),
        run().env("LANTERN_SOCKET", place("env.sock")).arg("--socket").arg(place("argument.sock")),
    );
    stops_at(&place("env.sock"), run().env("LANTERN_SOCKET", place("env.sock")));
    stops_at(&in_config, run().env("XDG_RUNTIME_DIR", folder.path()));
}

#[test]
fn check_says_what_each_projector_sees() {
    // 60 cm over a quad of 0.4 m × 0.4 m, with the lens shifted: known shares and angles.
    let stand = Stand { fov_y_rad: std::f64::consts::FRAC_PI_2, ..lab::stand(0.0) };
    let straight = stand
        .toml("left")
        .replace(&format!("view = {:?}", stand.view()), "view = [[1,0,0,-0.1],[0,0,-1,0.2],[0,1,0,-1],[0,0,0,1]]");
    let scene = "[scene]\n[[scene.node]]\nname = \"sheet\"\nuri = \"lantern:quad\"\ntranslation_m = [0.1, 0, 0.2]\n\
                 [[scene.node]]\nname = \"cover\"\nuri = \"lantern:quad\"\nrole = \"mask\"\nscale = [9, 1, 9]\ntranslation_m = [5.6, 0, 0]\n";
    let (_folder, file) = written(&[scene, lab::TRACKED, &straight].join("\n"));
    let (code, text, stderr) = lanternd(&["check", "-c", &file]);
    assert_eq!((code, stderr.as_str()), (Some(0), ""));
    for words in [
        "projector \"left\"",
        "96 × 64 pixels",
        "stands at (0.100, 1.000, 0.200) m",
        "looks along (0.000, -1.000, 0.000)",
        "112.62° across",
        "90.00° from top to bottom",
        "lens shift 0.0 %",
        "hit a prop",
    ] {
        assert!(text.contains(words), "`{words}` is not said:\n{text}");
    }

    let (code, text, _) = lanternd(&["check", "-c", &file, "--json"]);
    let all: Value = serde_json::from_str(&text).unwrap();
    let left = &all["projectors"][0];
    assert_eq!(
        (code, &all["ok"], &left["name"], &left["resolution_px"]),
        (Some(0), &json!(true), &json!("left"), &json!([96, 64]))
    );
    // At 1 m the image is 3 m × 2 m, and the sheet 1 m × 1 m: 32 × 32 of its pixels.
    assert_eq!(left["share_on_props"].as_f64(), Some(1024.0 / (96.0 * 64.0)), "{left}");
    assert_eq!(left["share_on_masks"].as_f64(), Some(16.0 / 96.0), "{left}");
    let number = |key: &str, at: usize| left[key][at].as_f64().unwrap();
    assert!((number("position_m", 1) - 1.0).abs() < 1e-9 && (number("direction", 1) + 1.0).abs() < 1e-9, "{left}");
    assert!((number("field_of_view_deg", 1) - 90.0).abs() < 1e-9 && number("lens_shift", 0).abs() < 1e-9, "{left}");

    // Good, and still worth a word.
    let away = lab::room().replace("[3, 1, 3]", "[0.01, 1, 0.01]").replace("[0, 0.4, 0]", "[0, -9, 0]");
    let (_folder, file) = written(&away);
    let (code, text, _) = lanternd(&["check", "-c", &file]);
    assert!(code == Some(0) && text.contains("sees no prop"), "{text}");
    let (code, _, stderr) = lanternd(&["check", "-c", "/nowhere/lab.toml"]);
    assert!(code == Some(1) && stderr.contains("/nowhere/lab.toml: cannot be read"), "{stderr}");
}

#[test]
fn devices_are_listed() {
    let (code, text, _) = lanternd(&["devices", "--json"]);
    assert_eq!(code, Some(0));
    let all: Value = serde_json::from_str(&text).unwrap();
    let device = &all["devices"][0];
    for key in ["name", "kind", "uuid", "driver", "api_version", "queue_families", "displays", "abilities", "usable"] {
        assert!(!device[key].is_null(), "{key} in {device}");
    }
    assert!(device["queue_families"][0]["count"].as_u64().unwrap() >= 1);
    assert!(device["abilities"]["ray_query"].is_boolean());
    let (code, text, _) = lanternd(&["devices"]);
    assert!(
        code == Some(0) && text.contains(device["name"].as_str().unwrap()) && text.contains("queue family 0"),
        "{text}"
    );
}

#[test]
fn bench_times_every_case() {
    let (_folder, file) = written(&lab::room().replace("\"lantern:sphere\"", "\"lantern:cube\""));
    let (code, text, stderr) = lanternd(&["bench", "-c", &file, "--frames", "2", "--json"]);
    assert_eq!(code, Some(0), "{stderr}");
    let all: Value = serde_json::from_str(&text).unwrap();
    for key in ["device", "scene", "resolution_px", "samples", "gpu_bytes"] {
        assert!(!all[key].is_null(), "{key} in {all}");
    }
    assert!(all["device"]["driver"].is_string() && all["gpu_bytes"].as_u64().unwrap() > 100_000, "{all}");
    for case in ["static", "viewer", "node", "full"] {
        for projector in ["left", "right"] {
            let found = &all["cases"][case]["projectors"][projector];
            for key in ["p50", "p95"] {
                assert!(found["frame_ms"][key].as_f64().is_some_and(|ms| ms > 0.0), "{case} {projector} {found}");
            }
            for stage in ["primary", "secondary", "composite"] {
                let ms = found["stages_ms"][stage]["p50"].as_f64().unwrap_or_else(|| panic!("{case} {stage}: {found}"));
                assert!((case == "full") <= (ms > 0.0), "{case} {stage}: {found}");
            }
            for kind in ["primary", "secondary", "shadow"] {
                assert!(found["rays"][kind].is_u64(), "{case} {kind}: {found}");
            }
            assert!(found["mray_s"].is_object());
            // One sample a pixel: 12 bytes for the plane and 108 once.
            assert!((120..130).contains(&(found["gpu_bytes"].as_u64().unwrap() / (96 * 64))), "{found}");
        }
    }
    let full = &all["cases"]["full"]["projectors"]["left"];
    assert_eq!(full["rays"]["primary"], 96 * 64);
    assert!(
        full["rays"]["shadow"].as_u64().unwrap() > 0 && full["mray_s"]["primary"].as_f64().unwrap() > 0.0,
        "{full}"
    );
    assert_eq!(all["cases"]["static"]["projectors"]["left"]["rays"]["primary"], 0);

    // One case alone, and a dump that has nowhere to go.
    let nowhere = format!("{file}/dump");
    let (code, text, stderr) = lanternd(&["bench", "-c", &file, "--frames", "1", "--case", "static", "--json"]);
    let all: Value = serde_json::from_str(&text).unwrap();
    assert_eq!((code, all["cases"].as_object().unwrap().len()), (Some(0), 1), "{stderr}");
    let (code, _, stderr) = lanternd(&["bench", "-c", &file, "--frames", "1", "--case", "static", "--dump", &nowhere]);
    assert!(code == Some(1) && stderr.contains(&format!("writing {nowhere}")), "{stderr}");
}

/// A program's environment in which the loader finds no driver.
const NO_DRIVER: [(&str, &str); 2] =
    [("VK_DRIVER_FILES", "/nonexistent/icd.json"), ("VK_ICD_FILENAMES", "/nonexistent/icd.json")];

#[test]
fn a_machine_without_vulkan_is_told_what_to_install() {
    let (folder, file) = written(&lab::room());
    let socket = folder.path().join("s");
    let socket = socket.to_str().unwrap();
    let out = folder.path().join("out");

    // A file that is no library, found before the system's, is as good as none.
    for name in ["libvulkan.so.1", "libvulkan.so"] {
        fs::write(folder.path().join(name), "no library").unwrap();
    }
    let no_loader = [("LD_LIBRARY_PATH", folder.path().to_str().unwrap())];
    for (variables, package) in [(NO_DRIVER.as_slice(), "mesa-vulkan-drivers"), (no_loader.as_slice(), "libvulkan1")] {
        for validation in ["0", "1"] {
            for arguments in [
                &["run", "-c", &file, "--socket", socket][..],
                &["demo", "--out", out.to_str().unwrap()],
                &["devices"],
                &["bench", "-c", &file],
            ] {
                let mut command = harness::command("lanternd").unwrap();
                command.args(arguments).envs(variables.iter().copied()).env("LANTERN_VALIDATION", validation);
                let (code, _, stderr) = told(command.output().unwrap());
                assert!(code == Some(1) && stderr.contains(&format!("install {package}")), "{arguments:?}: {stderr}");
            }
        }
        // What renders nothing needs none.
        let mut check = harness::command("lanternd").unwrap();
        assert!(check.args(["check", "-c", &file]).envs(variables.iter().copied()).output().unwrap().status.success());
    }
}

#[test]
fn devices_that_are_not_there_are_named() {
    let (folder, file) = written(&lab::room_with("[device]\nselect = \"voodoo\"\n"));
    let socket = folder.path().join("s");
    let (code, _, stderr) = lanternd(&["run", "-c", &file, "--socket", socket.to_str().unwrap()]);
    assert!(code == Some(1) && stderr.contains("voodoo") && stderr.contains("hint: there are 0"), "{stderr}");
}

#[test]
fn an_address_that_is_taken_is_said() {
    let taken = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let listen = taken.local_addr().unwrap().to_string();
    let (folder, file) = written(&lab::room().replace("127.0.0.1:0", &listen));
    let socket = folder.path().join("s");
    let (code, _, stderr) = lanternd(&["run", "-c", &file, "--socket", socket.to_str().unwrap()]);
    assert!(code == Some(1) && stderr.contains("tracker `optitrack`") && stderr.contains(&listen), "{stderr}");
    assert!(stderr.contains("hint:"), "{stderr}");
}

#[test]
fn usage() {
    let (code, help, _) = lanternd(&["--help"]);
    assert_eq!(code, Some(0));
    for command in ["run", "demo", "check", "devices", "bench"] {
        assert!(help.contains(command), "{help}");
        let (code, help, _) = lanternd(&[command, "--help"]);
        assert!(code == Some(0) && help.contains("Usage:"), "{command}: {help}");
    }
    for arguments in
        [&[][..], &["dance"], &["run"], &["check"], &["run", "-c", "x", "--frames", "-1"], &["bench", "--frames", "0"]]
    {
        let (code, stdout, stderr) = lanternd(arguments);
        assert_eq!((code, stdout.as_str()), (Some(2), ""), "{arguments:?}: {stderr}");
    }
}

/// The README's first command, at its full size. Without the validation layer, under which other tests render the same.
#[test]
fn demo() {
    let out = tempfile::tempdir().unwrap();
    let folder: PathBuf = out.path().join("new/folder");
    let mut command = harness::command("lanternd").unwrap();
    command.args(["demo", "--frames", "1", "--out"]).arg(&folder).env_remove("LANTERN_VALIDATION");
    let (code, text, stderr) = told(command.output().unwrap());
    assert_eq!(code, Some(0), "{stderr}");
    let mut files: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    // A picture a projector and eye, one of the room an eye, and all of them on one sheet.
    assert_eq!(files.len(), 2 * 3 + 3 + 1, "{files:?}");
    for file in &files {
        assert!(text.contains(file.to_str().unwrap()), "{} is not said:\n{text}", file.display());
        let picture = image::open(file).unwrap().into_rgb8();
        let colours: std::collections::HashSet<_> = picture.pixels().collect();
        assert!(colours.len() > 500, "{} shows next to nothing", file.display());
    }
    assert!(text.contains("ms a frame") && text.contains("first picture"), "how fast is not said:\n{text}");
    assert!(stderr.contains("eye left"), "no progress is shown where one waits:\n{stderr}");
}
