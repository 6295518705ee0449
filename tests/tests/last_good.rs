//! A start on a configuration that has come to be wrong: what it last was is shown, and said to be.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{fs, path::Path, sync::Arc, time::Duration};

use lantern_tests::{
    client::Client,
    harness::{self, Daemon, Ended},
    lab,
};
use rustix::process::Signal;
use serde_json::{Value, json};
use tempfile::TempDir;

const SOON: Duration = Duration::from_secs(30);

/// A projector's matrices.
const OPENCV: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../daemon/calibration/tests/formats/sample-4.yml");

/// A folder with a calibration, and a configuration that names it.
fn folder() -> (Arc<TempDir>, String) {
    let folder = Arc::new(tempfile::tempdir().unwrap());
    fs::copy(OPENCV, folder.path().join("top.yml")).unwrap();
    let by_file = "[[projector]]\nname = \"top\"\nresolution_px = [128, 72]\n[projector.calibration]\nfile = \"top.yml\"\n\
                   format = \"opencv\"\nunit = \"mm\"\nresolution_px = [1280, 720]\n";
    (folder, lab::room_with("[daemon]\nstate_dir = \"state\"\n") + by_file)
}

fn kill(daemon: &mut Daemon) {
    daemon.signal(Signal::KILL).unwrap();
    assert!(!daemon.wait(SOON).unwrap().success());
}

/// What there is to see.
fn seen(client: &mut Client) -> (Value, Vec<(String, Vec<u8>)>) {
    let pictures = ["left", "right", "top"].map(|projector| client.snapshot(projector, "color").unwrap());
    (client.ask_ok("scene.get", json!({})).unwrap(), pictures.into())
}

fn starts(folder: &Arc<TempDir>, environment: &[(&str, &Path)]) -> Daemon {
    match Daemon::try_start_as_is(folder, environment).unwrap() {
        Ok(daemon) => daemon,
        Err(Ended { status, stderr }) => panic!("lanternd ended with {status}:\n{stderr}"),
    }
}

#[test]
fn what_a_configuration_last_was_is_shown_when_it_breaks() {
    let (folder, config) = folder();
    let (file, calibration) = (folder.path().join("lantern.toml"), folder.path().join("top.yml"));
    let mut daemon = Daemon::start_in(&folder, &config).unwrap();
    let mut client = daemon.client().unwrap();
    assert_eq!(client.status().unwrap()["config"], json!({"path": file, "good": true, "problem": null}));
    client.ask_ok("scene.apply", json!({"edits": [lab::mirror()]})).unwrap();
    let mut before = seen(&mut client);
    kill(&mut daemon);

    let good = fs::read(&calibration).unwrap();
    // Cut short in the middle of a table, as an editor's crash leaves it; a number that cannot be; a calibration that is damaged; one that
    // has gone; and a configuration that has gone, where the service manager says where state is kept.
    let breakages: [(&str, &dyn Fn()); 5] = [
        ("TOML", &|| fs::write(&file, &config[..config.len() - 30]).unwrap()),
        ("no square number", &|| fs::write(&file, config.replace("samples = 1", "samples = 3")).unwrap()),
        ("top.yml is not readable", &|| fs::write(&calibration, &good[..good.len() / 2]).unwrap()),
        ("top.yml cannot be read", &|| fs::remove_file(&calibration).unwrap()),
        ("lantern.toml: cannot be read", &|| fs::remove_file(&file).unwrap()),
    ];
    for (round, (words, break_it)) in breakages.into_iter().enumerate() {
        fs::write(&file, &config).unwrap();
        fs::write(&calibration, &good).unwrap();
        break_it();
        let state = folder.path().join("state");
        let mut daemon = starts(&folder, &[("STATE_DIRECTORY", &state)]);
        let mut client = daemon.client().unwrap();
        assert!(seen(&mut client) == before, "{words}: something else is shown");
        let told = client.status().unwrap()["config"].clone();
        let problem = told["problem"].as_str().unwrap();
        assert!(told["good"] == false && problem.contains("lantern.toml") && problem.contains("hint:"), "{told}");
        assert!(words == "TOML" || problem.contains(words), "{told}");
        assert!(daemon.log().contains("ERROR") && daemon.log().contains(problem), "{}", daemon.log());
        let table = String::from_utf8(daemon.control(&["status"]).unwrap().stdout).unwrap();
        assert!(table.contains("config  wrong, and an earlier one is in use: "), "{table}");

        // `check` says the same as ever, and a reload is refused as ever; neither changes what is shown.
        let check = harness::run("lanternd", &["check", "-c", file.to_str().unwrap()]).unwrap();
        assert_eq!(check.status.code(), Some(1));
        assert_eq!(client.ask("config.reload", json!({})).unwrap().unwrap_err().code, "bad-config");
        // What is durable is, also now.
        let edits = json!({"edits": [{"set": {"node": "ball", "translation_m": [0.1 * round as f64, 0.4, 0]}}]});
        assert_eq!(client.ask_ok("scene.apply", edits).unwrap()["durable"], true);
        before = seen(&mut client);

        // Mended, it is taken over, with what clients have made of its scene.
        fs::write(&file, &config).unwrap();
        fs::write(&calibration, &good).unwrap();
        client.ask_ok("config.reload", json!({})).unwrap();
        assert!(seen(&mut client) == before, "{words}: something else is shown once it is mended");
        assert_eq!(client.status().unwrap()["config"]["good"], true);
        kill(&mut daemon);
    }
}

#[test]
fn a_reload_makes_another_one_the_last_good_one() {
    let (folder, config) = folder();
    let file = folder.path().join("lantern.toml");
    let mut daemon = Daemon::start_in(&folder, &config).unwrap();
    let mut client = daemon.client().unwrap();
    fs::write(&file, config.replace("name = \"right\"", "name = \"other\"")).unwrap();
    client.ask_ok("config.reload", json!({})).unwrap();
    fs::write(&file, "[[projector]]\nname = 1").unwrap();
    client.ask("config.reload", json!({})).unwrap().unwrap_err();
    assert_eq!(client.status().unwrap()["config"]["good"], false);
    kill(&mut daemon);
    // Nothing in the file says any more where state is kept.
    let daemon = starts(&folder, &[("STATE_DIRECTORY", &folder.path().join("state"))]);
    let projectors = daemon.client().unwrap().ask_ok("hello", json!({})).unwrap()["projectors"].clone();
    assert_eq!(projectors, json!(["left", "other", "top"]));
}

#[test]
fn without_anything_to_go_back_to_a_wrong_configuration_is_refused() {
    let (folder, config) = folder();
    let wrong = config.replace("samples = 1", "samples = 3");
    // Nothing was ever kept; what was is another configuration's; what was is damaged.
    let refused = |folder: &Arc<TempDir>| {
        let Ended { status, stderr } = Daemon::try_start_in(folder, &wrong).unwrap().unwrap_err();
        assert!(status.code() == Some(1) && stderr.contains("no square number"), "{stderr}");
        stderr
    };
    refused(&folder);
    assert!(!folder.path().join("state").exists(), "a start that is refused leaves nothing behind");

    let mut daemon = Daemon::start_in(&folder, &config).unwrap();
    assert!(daemon.stop().unwrap().success());
    let kept = folder.path().join("state/last-good/configuration.json");
    let text = fs::read_to_string(&kept).unwrap();
    fs::write(&kept, text.replace("samples = 1", "samples = 4")).unwrap();
    let said = refused(&folder);
    assert!(said.contains("no earlier configuration to go back to") && said.contains("damaged"), "{said}");

    fs::write(&kept, &text).unwrap();
    let other = Arc::new(tempfile::tempdir().unwrap());
    fs::create_dir(other.path().join("state")).unwrap();
    let status = std::process::Command::new("cp").arg("-r").arg(folder.path().join("state")).arg(other.path()).status();
    assert!(status.unwrap().success());
    let said = refused(&other);
    assert!(said.contains("was kept of the configuration file"), "{said}");
}
