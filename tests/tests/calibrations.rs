//! Calibration files from outside: what `check` says of them, and a daemon that reads them again.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{fs, path::Path, sync::Arc, time::Duration};

use lantern_tests::{
    client::Client,
    harness::{self, Daemon},
    lab,
};
use serde_json::{Value, json};

const SOON: Duration = Duration::from_secs(30);

/// Files of the calibration's own tests.
const FORMATS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../daemon/calibration/tests/formats");

/// A projector by a file, in the room.
fn room(resolution_px: [u32; 2], keys: &str) -> String {
    let projector =
        format!("[[projector]]\nname = \"left\"\nresolution_px = {resolution_px:?}\n[projector.calibration]\n{keys}\n");
    [lab::RENDER, lab::SCENE, lab::TRACKED, &projector].join("\n")
}

/// A frustum that stands so high over the room, looking down.
fn mpcdi(height_m: f64) -> String {
    let text = fs::read_to_string(Path::new(FORMATS).join("shaded.mpcdi.xml")).unwrap();
    let frame =
        [("posx", "-1.2", "0".to_owned()), ("posy", "1.8", height_m.to_string()), ("posz", "2.4", "0".to_owned())];
    let turn = [("yaw", "25.0", "0".to_owned()), ("pitch", "-20.0", "-90".to_owned()), ("roll", "1.5", "0".to_owned())];
    let text = frame.into_iter().chain(turn).fold(text, |text, (name, old, new)| {
        let old = format!("<{name}>{old}<");
        assert!(text.contains(&old));
        text.replace(&old, &format!("<{name}>{new}<"))
    });
    text.replace("1280", "96").replace("720", "64")
}

fn check(config: &str) -> (Option<i32>, String, String) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("lab.toml");
    fs::write(&file, config).unwrap();
    let output = harness::run("lanternd", &["check", "-c", file.to_str().unwrap()]).unwrap();
    let [stdout, stderr] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
    (output.status.code(), stdout, stderr)
}

#[test]
fn check_says_where_the_projectors_of_files_stand() {
    for (file, keys, size, words) in [
        ("sample-4.yml", "format = \"opencv\"\nunit = \"mm\"", [1280, 720], "stands at (0.224, 0.087, -0.168) m"),
        ("shaded.mpcdi.xml", "format = \"mpcdi\"\nunit = \"m\"", [1280, 720], "stands at (-1.200, 1.800, 2.400) m"),
        ("office.xml", "format = \"roomalive\"", [1280, 720], "stands at (0.500, -0.100, 0.250) m"),
        (
            "stage.json",
            "format = \"splash\"\nunit = \"cm\"\nentry = \"cam1\"",
            [1280, 720],
            "stands at (0.010, 0.020, 0.015) m",
        ),
    ] {
        let path = Path::new(FORMATS).join(file);
        let (code, text, stderr) = check(&room(size, &format!("file = {path:?}\n{keys}")));
        assert_eq!((code, stderr.as_str()), (Some(0), ""), "{file}");
        assert!(text.contains(words), "{file}: `{words}` is not said:\n{text}");
    }
    let path = Path::new(FORMATS).join("shaded.mpcdi.xml");
    let (code, _, stderr) = check(&room([1280, 720], &format!("file = {path:?}\nformat = \"mpcdi\"")));
    assert_eq!(code, Some(1));
    // At the line of the key, with the file's name, what is missing and how to say it.
    assert!(stderr.contains("lab.toml:") && stderr.contains("shaded.mpcdi.xml does not say in what unit"), "{stderr}");
    assert!(stderr.contains("hint: add unit = \"mm\""), "{stderr}");
    assert!(!stderr.contains(":0:"), "{stderr}");
}

/// What is suspicious is told with its place, as what is wrong is.
#[test]
fn check_says_where_something_suspicious_stands() {
    let beside = "convention = \"opengl\"\nprojection = [[1.5, 0, 0, 0], [0, 2.4, 0, 0], [0, 0, -1.02, -0.2], [0, 0, -1, 0]]\n\
                  view = [[1, 0, 0, -50], [0, 1, 0, 0], [0, 0, 1, -3], [0, 0, 0, 1]]";
    let config = room([96, 64], beside);
    let line = config.lines().position(|line| line == "[projector.calibration]").unwrap() + 1;
    let (code, text, stderr) = check(&config);
    assert_eq!(code, Some(0), "{stderr}");
    let warning = text.lines().find(|line| line.contains("nothing in view")).unwrap();
    assert!(warning.contains(&format!(".toml:{line}:")), "{warning} is not of line {line}");
}

#[test]
fn check_says_where_the_projectors_of_real_files_stand() {
    let shared = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/calibrations"));
    if !shared.is_dir() {
        println!("skipped, since there is no folder shared/data beside the checkout: real calibration files");
        return;
    }
    for (file, keys, size, words) in [
        ("opencv-procam.xml", "format = \"opencv\"\nunit = \"mm\"", [1280, 800], "stands at (-0.091, 0.620, 0.150) m"),
        ("roomalive-office.xml", "format = \"roomalive\"", [1280, 720], "stands at (-0.017, -0.099, 0.041) m"),
        (
            "cube.mpcdi.xml",
            "format = \"mpcdi\"\nunit = \"m\"\nentry = \"Top\"",
            [1920, 1080],
            "stands at (0.000, 3.000, 0.000) m",
        ),
    ] {
        let (code, text, stderr) = check(&room(size, &format!("file = {:?}\n{keys}", shared.join(file))));
        assert_eq!((code, stderr.as_str()), (Some(0), ""), "{file}");
        assert!(text.contains(words), "{file}: `{words}` is not said:\n{text}");
    }
}

#[test]
fn a_reload_reads_calibration_files_again_and_a_bad_one_never_replaces_a_good_one() {
    let folder = Arc::new(tempfile::tempdir().unwrap());
    let file = folder.path().join("left.mpcdi.xml");
    let write = |text: &str| fs::write(&file, text).unwrap();
    write(&mpcdi(3.0));
    // A path that starts from the configuration's folder.
    let keys = "file = \"left.mpcdi.xml\"\nformat = \"mpcdi\"\nunit = \"m\"";
    let daemon = Daemon::start_in(&folder, &room([96, 64], keys)).unwrap();
    let mut client = daemon.client().unwrap();
    let farthest = |client: &mut Client| {
        let distance = client.layer("left", "distance").unwrap();
        distance.values.into_iter().filter(|value| value.is_finite()).fold(0.0, f32::max)
    };
    let before = lab::everything(&mut client, "left").unwrap();
    let high = farthest(&mut client);

    // Whatever is wrong with it, it is said, and what is shown stays, to the bit.
    let good = mpcdi(3.0);
    for (bad, words) in [
        ("", "not readable as MPCDI"),
        (&good[..good.len() / 2], "not readable as MPCDI"),
        (&good.replace("\"sl\"", "\"2d\""), "its profile is"),
        (&good.replace("\"64\"", "\"100\""), "wrong resolution"),
        (&good.replace("<rollz>-1.0<", "<rollz>1.0<"), "left-handed"),
    ] {
        write(bad);
        let refused = client.ask("config.reload", json!({})).unwrap().unwrap_err();
        assert!(refused.code == "bad-config" && refused.message.contains(words), "{refused}");
        assert!(lab::everything(&mut client, "left").unwrap() == before, "{words}: another picture is shown");
    }
    fs::remove_file(&file).unwrap();
    assert!(client.ask("config.reload", json!({})).unwrap().unwrap_err().message.contains("cannot be read"));
    assert!(lab::everything(&mut client, "left").unwrap() == before);

    // A good one is shown, though the configuration is the same as before.
    write(&mpcdi(2.0));
    daemon.signal(rustix::process::Signal::HUP).unwrap();
    let started = std::time::Instant::now();
    while lab::everything(&mut client, "left").unwrap() == before {
        assert!(started.elapsed() < SOON, "nothing changes:\n{}", daemon.log());
    }
    let low = farthest(&mut client);
    assert!((high - low - 1.0).abs() < 0.1, "{high} then {low}");
    let status: Value = client.status().unwrap();
    assert_eq!(status["projectors"]["left"]["resolution_px"], json!([96, 64]));
}
