//! Who may operate a real daemon: other users of this machine try. Needs root, to be them.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]

use std::fs::{self, Permissions};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Arc;

use lantern_tests::client::Client;
use lantern_tests::harness::{self, Daemon};
use lantern_tests::lab;
use serde_json::json;

/// Everything but the projectors, for one group of Debian's: its user `daemon` is a member, its user `nobody` is not.
const GROUP: &str = "daemon";

fn config(group: &str) -> String {
    format!("[daemon]\ngroup = \"{group}\"\n{}", lab::room())
}

/// `lanternctl status` as another: `setpriv` with these arguments, or as we are.
struct Others {
    lanternctl: PathBuf,
    socket: PathBuf,
}

impl Others {
    /// Opens the daemon's folder to all, with a `lanternctl` that all can run.
    fn of(daemon: &Daemon) -> Self {
        let folder = daemon.folder().path();
        fs::set_permissions(folder, Permissions::from_mode(0o755)).unwrap();
        let lanternctl = folder.join("lanternctl");
        fs::copy(harness::program("lanternctl").unwrap(), &lanternctl).unwrap();
        fs::set_permissions(&lanternctl, Permissions::from_mode(0o755)).unwrap();
        Self { lanternctl, socket: daemon.socket().to_owned() }
    }

    fn status(&self, identity: &[&str]) -> Output {
        let mut command = Command::new("setpriv");
        command.args(identity).arg(&self.lanternctl).arg("--socket").arg(&self.socket).arg("status");
        command.current_dir("/").output().unwrap()
    }
}

#[track_caller]
fn served(output: &Output) {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[track_caller]
fn refused(output: &Output, because: &str) {
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && errors.contains(because), "{errors}");
}

fn is_root() -> bool {
    let is_root = rustix::process::geteuid().is_root();
    if !is_root {
        eprintln!("skipped: only root can be other users");
    }
    is_root
}

#[test]
fn a_group_operates_and_others_do_not() {
    if !is_root() {
        return;
    }
    let daemon = Daemon::start(&config(GROUP)).unwrap();
    let others = Others::of(&daemon);
    let file = fs::metadata(daemon.socket()).unwrap();
    let of_group = fs::read_to_string("/etc/group").unwrap();
    let of_group = of_group.lines().find(|line| line.starts_with(&format!("{GROUP}:"))).unwrap();
    assert_eq!(of_group.split(':').nth(2), Some(file.gid().to_string().as_str()), "the file is the group's");
    assert_eq!(file.mode() & 0o777, 0o660);

    let stranger = ["--reuid=nobody", "--regid=nogroup", "--clear-groups"];
    refused(&others.status(&stranger), "Permission denied");

    // Whoever made the file may have given it to all: then each is asked all the same.
    fs::set_permissions(daemon.socket(), Permissions::from_mode(0o666)).unwrap();
    refused(&others.status(&stranger), "not-allowed");
    served(&others.status(&["--reuid=daemon", "--regid=nogroup", "--clear-groups"]));
    served(&others.status(&["--reuid=nobody", "--regid=daemon", "--clear-groups"]));
    // Of the process alone, not of its user: as documented.
    refused(&others.status(&["--reuid=nobody", "--regid=nogroup", "--groups=daemon"]), "not-allowed");
    // Root, which the daemon runs as here.
    served(&others.status(&["--clear-groups"]));

    // Those who were turned away have changed nothing, and each is told in the log.
    assert!(daemon.client().unwrap().status().is_ok());
    let lines = |log: &str, words: &str| -> Vec<String> {
        log.lines().filter(|line| line.contains(words)).map(str::to_owned).collect()
    };
    let turned_away = |log: &str| Some(lines(log, "a client was turned away")).filter(|lines| lines.len() == 2);
    for line in daemon.wait_for_log(turned_away).unwrap() {
        assert!(line.contains("uid=65534") && line.contains("user=\"nobody\"") && line.contains("pid="), "{line}");
    }
    let came = lines(&daemon.log(), "a client has connected");
    assert!(came.iter().any(|line| line.contains("uid=1 ") && line.contains("user=\"daemon\"")), "{came:?}");
}

#[test]
fn every_client_is_told_in_the_log_once() {
    let daemon = Daemon::start(&lab::room()).unwrap();
    let mut client = daemon.client().unwrap();
    for _ in 0..3 {
        client.status().unwrap();
    }
    let own = format!("pid={} uid={} ", std::process::id(), rustix::process::geteuid().as_raw());
    // The harness itself has asked whether the daemon is there.
    let count =
        |log: &str| log.lines().filter(|line| line.contains("a client has connected") && line.contains(&own)).count();
    daemon.wait_for_log(|log| (count(log) >= 2).then_some(())).unwrap();
    daemon.client().unwrap().status().unwrap();
    daemon.wait_for_log(|log| (count(log) >= 3).then_some(())).unwrap();
    assert_eq!(count(&daemon.log()), 3, "{}", daemon.log());
}

#[test]
fn a_socket_that_systemd_hands_over_is_guarded_as_well() {
    if !is_root() {
        return;
    }
    let folder = Arc::new(tempfile::tempdir().unwrap());
    fs::set_permissions(folder.path(), Permissions::from_mode(0o755)).unwrap();
    let (path, config_file) = (folder.path().join("given.sock"), folder.path().join("lantern.toml"));
    fs::write(&config_file, config(GROUP)).unwrap();
    let program = harness::program("lanternd").unwrap();

    // systemd's own little helper for that, and a file that is open to all.
    let mut child = Command::new("systemd-socket-activate")
        .arg("--listen")
        .arg(&path)
        .arg(program)
        .args(["run", "-c"])
        .arg(&config_file)
        .env("CACHE_DIRECTORY", folder.path().join("cache"))
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let outcome = std::panic::catch_unwind(|| activated(&path));
    child.kill().unwrap();
    child.wait().unwrap();
    outcome.unwrap();
}

fn activated(path: &Path) {
    let began = std::time::Instant::now();
    while !path.exists() {
        assert!(began.elapsed().as_secs() < 30, "no socket");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    fs::set_permissions(path, Permissions::from_mode(0o666)).unwrap();
    // Root first, which starts the daemon.
    Client::connect(path).unwrap().ask_ok("hello", json!({})).unwrap();
    let ask =
        "import socket, sys; s = socket.socket(socket.AF_UNIX); s.connect(sys.argv[1]); print(s.makefile().readline())";
    let mut stranger = Command::new("setpriv");
    stranger.args(["--reuid=nobody", "--regid=nogroup", "--clear-groups", "/usr/bin/python3", "-c", ask]).arg(path);
    let told = stranger.output().unwrap();
    assert!(String::from_utf8_lossy(&told.stdout).contains("not-allowed"), "{told:?}");
}
