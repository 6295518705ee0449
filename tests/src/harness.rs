//! A real `lanternd` for a test: built, started on a configuration of its own, spoken to, and ended with its pid.

use std::{
    env, fs,
    io::{BufRead, BufReader, ErrorKind},
    path::{Path, PathBuf},
    process::{Child, Command, ExitStatus, Output, Stdio},
    sync::{Arc, Mutex, OnceLock, PoisonError},
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use anyhow::{Context, Result, anyhow, bail, ensure};
use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;

use crate::client::Client;

/// A first start compiles every shader under the validation layer, perhaps beside other tests.
const START_LIMIT: Duration = Duration::from_secs(120);
/// How long a daemon may take to end when it is asked to.
const STOP_LIMIT: Duration = Duration::from_secs(30);
/// What is logged is there by then.
const LOG_LIMIT: Duration = Duration::from_secs(30);
/// What no line of a healthy daemon's log contains.
const ILLS: [&str; 2] = ["vulkan::validation", "panicked"];

/// One of our programs, as just built. cargo builds no program of another package for a test, so this does, once a process.
///
/// # Errors
/// Where it cannot be built, or is not there and no cargo is either.
pub fn program(name: &str) -> Result<PathBuf> {
    static BUILT: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    let folder = BUILT.get_or_init(|| build().map_err(|error| format!("{error:#}")));
    let path = folder.as_ref().map_err(|error| anyhow!("{error}"))?.join(name);
    ensure!(path.is_file(), "no program {}; hint: cargo build -p lantern --bins", path.display());
    Ok(path)
}

/// Builds the programs, in the test's own profile, and gives their folder: the one above `deps`, where this test lies.
fn build() -> Result<PathBuf> {
    let test = env::current_exe().context("finding the test's own program")?;
    let folder = test.ancestors().nth(2).context("finding the target folder")?.to_owned();
    let Some(cargo) = env::var_os("CARGO") else { return Ok(folder) };
    let mut command = Command::new(cargo);
    command.args(["build", "--quiet", "--package", "lantern", "--bins"]);
    command.arg("--manifest-path").arg(concat!(env!("CARGO_MANIFEST_DIR"), "/../Cargo.toml"));
    match folder.file_name().and_then(|profile| profile.to_str()) {
        Some("debug") | None => {}
        Some(profile) => drop(command.args(["--profile", profile])),
    }
    let status = command.status().context("starting cargo")?;
    ensure!(status.success(), "cargo build -p lantern --bins: {status}");
    Ok(folder)
}

/// Runs one of our programs to its end. It sees no socket and no configuration but what the arguments name.
///
/// # Errors
/// Where it cannot be started; not where it fails, which is what the answer tells.
pub fn run(name: &str, arguments: &[&str]) -> Result<Output> {
    command(name)?.args(arguments).output().with_context(|| format!("running {name}"))
}

/// One of our programs, not started yet: its standard input is empty, and nothing around it names a socket.
///
/// # Errors
/// Where it cannot be built.
pub fn command(name: &str) -> Result<Command> {
    let mut command = Command::new(program(name)?);
    command.env_remove("LANTERN_SOCKET").env("LANTERN_VALIDATION", "1").env("NO_COLOR", "1").stdin(Stdio::null());
    Ok(command)
}

/// A daemon that did not come up.
#[derive(Debug)]
pub struct Ended {
    /// How it ended.
    pub status: ExitStatus,
    /// All that it wrote.
    pub stderr: String,
}

/// A running daemon. Dropping it ends it, and fails the test if its log tells of a validation message or of a panic.
#[derive(Debug)]
pub struct Daemon {
    child: Child,
    log: Arc<Mutex<String>>,
    reader: Option<JoinHandle<()>>,
    socket: PathBuf,
    folder: Arc<TempDir>,
}

impl Daemon {
    /// Starts one on a configuration, in a folder of its own, and waits until it answers.
    ///
    /// # Errors
    /// Where it cannot be started, or ends before it answers.
    pub fn start(config: &str) -> Result<Self> {
        Self::start_in(&Arc::new(tempfile::tempdir().context("making a folder")?), config)
    }

    /// The same in a folder that is there already, such as that of an earlier daemon.
    ///
    /// # Errors
    /// As [`Daemon::start`].
    pub fn start_in(folder: &Arc<TempDir>, config: &str) -> Result<Self> {
        match Self::try_start_in(folder, config)? {
            Ok(daemon) => Ok(daemon),
            Err(Ended { status, stderr }) => bail!("lanternd ended with {status} before it answered:\n{stderr}"),
        }
    }

    /// The same, for one that may well refuse its configuration.
    ///
    /// # Errors
    /// Where it cannot be started, or neither answers nor ends in time.
    pub fn try_start_in(folder: &Arc<TempDir>, config: &str) -> Result<Result<Self, Ended>> {
        fs::write(folder.path().join("lantern.toml"), config).context("writing the configuration")?;
        Self::try_start_as_is(folder, &[])
    }

    /// The same on the configuration that is there or is not, with more in its environment.
    ///
    /// # Errors
    /// As [`Daemon::try_start_in`].
    pub fn try_start_as_is(folder: &Arc<TempDir>, environment: &[(&str, &Path)]) -> Result<Result<Self, Ended>> {
        let config_file = folder.path().join("lantern.toml");
        let socket = folder.path().join("lanternd.sock");
        let mut child = command("lanternd")?
            .args(["run".as_ref(), "-c".as_ref(), config_file.as_os_str(), "--socket".as_ref(), socket.as_os_str()])
            // What another test's daemon has kept is not this one's.
            .env("CACHE_DIRECTORY", folder.path().join("cache"))
            .env_remove("STATE_DIRECTORY")
            .envs(environment.iter().copied())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .context("starting lanternd")?;

        // A pipe that nobody reads would stop the daemon when it is full.
        let log = Arc::new(Mutex::new(String::new()));
        let pipe = child.stderr.take().context("taking lanternd's stderr")?;
        let into = log.clone();
        let reader = thread::spawn(move || {
            for line in BufReader::new(pipe).lines().map_while(Result::ok) {
                let mut log = into.lock().unwrap_or_else(PoisonError::into_inner);
                log.push_str(&line);
                log.push('\n');
            }
        });
        let mut daemon = Self { child, log, reader: Some(reader), socket, folder: folder.clone() };

        let started = Instant::now();
        loop {
            if let Some(status) = daemon.child.try_wait().context("waiting for lanternd")? {
                daemon.join_reader();
                return Ok(Err(Ended { status, stderr: daemon.log() }));
            }
            // One that ends before it is up closes the connections that wait for it.
            let greeted =
                Client::connect(&daemon.socket).and_then(|mut client| client.ask_ok("hello", serde_json::json!({})));
            if greeted.is_ok() {
                return Ok(Ok(daemon));
            }
            ensure!(started.elapsed() < START_LIMIT, "lanternd does not answer:\n{}", daemon.log());
            thread::sleep(Duration::from_millis(20));
        }
    }

    /// A new connection.
    ///
    /// # Errors
    /// Where the socket is gone.
    pub fn client(&self) -> Result<Client> {
        Client::connect(&self.socket)
    }

    /// Its control socket.
    pub fn socket(&self) -> &Path {
        &self.socket
    }

    /// The folder of its configuration, `lantern.toml`, and its socket.
    pub fn folder(&self) -> &Arc<TempDir> {
        &self.folder
    }

    /// Its process.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// How many of its threads have this name, of which the system keeps fifteen letters.
    ///
    /// # Errors
    /// Where it has gone.
    pub fn threads_named(&self, name: &str) -> Result<usize> {
        let threads = std::fs::read_dir(format!("/proc/{}/task", self.pid())).context("listing its threads")?;
        let names = threads.flatten().filter_map(|thread| std::fs::read_to_string(thread.path().join("comm")).ok());
        Ok(names.filter(|comm| comm.trim_end() == name).count())
    }

    /// All that it has written so far.
    pub fn log(&self) -> String {
        self.log.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Waits until something can be found in the log, which is read a moment after it is written.
    ///
    /// # Errors
    /// Where it is not there in time.
    pub fn wait_for_log<T>(&self, find: impl Fn(&str) -> Option<T>) -> Result<T> {
        let started = Instant::now();
        loop {
            let log = self.log();
            if let Some(found) = find(&log) {
                return Ok(found);
            }
            ensure!(started.elapsed() < LOG_LIMIT, "lanternd's log does not tell:\n{log}");
            thread::sleep(Duration::from_millis(10));
        }
    }

    /// The log's lines of which a healthy daemon has none.
    pub fn ills(&self) -> Vec<String> {
        self.log().lines().filter(|line| ILLS.iter().any(|ill| line.contains(ill))).map(str::to_owned).collect()
    }

    /// Runs `lanternctl` on this daemon's socket.
    ///
    /// # Errors
    /// Where it cannot be started.
    pub fn control(&self, arguments: &[&str]) -> Result<Output> {
        let mut command = command("lanternctl")?;
        command.arg("--socket").arg(&self.socket).args(arguments).output().context("running lanternctl")
    }

    /// Sends it a signal.
    ///
    /// # Errors
    /// Where it is gone.
    pub fn signal(&self, signal: Signal) -> Result<()> {
        kill_process(Pid::from_child(&self.child), signal).context("signalling lanternd")
    }

    /// Asks it to end, and gives how it did.
    ///
    /// # Errors
    /// Where it does not end in time.
    pub fn stop(&mut self) -> Result<ExitStatus> {
        self.signal(Signal::TERM)?;
        self.wait(STOP_LIMIT)
    }

    /// Waits for its own end.
    ///
    /// # Errors
    /// Where it has not ended by then.
    pub fn wait(&mut self, limit: Duration) -> Result<ExitStatus> {
        let started = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().context("waiting for lanternd")? {
                self.join_reader();
                return Ok(status);
            }
            ensure!(started.elapsed() < limit, "lanternd has not ended after {limit:?}:\n{}", self.log());
            thread::sleep(Duration::from_millis(10));
        }
    }

    fn join_reader(&mut self) {
        if let Some(reader) = self.reader.take() {
            // It panics nowhere; were it to, its part of the log would be missing, and the test says so by other means.
            let _ = reader.join();
        }
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // It has ended already, or ends now; either way its pid is ours until it has been waited for.
        match self.child.kill() {
            Ok(()) => {}
            Err(error) if error.kind() == ErrorKind::InvalidInput => {}
            Err(error) => eprintln!("lanternd {} cannot be ended: {error}", self.child.id()),
        }
        let _ = self.child.wait();
        self.join_reader();
        if thread::panicking() {
            eprintln!("lanternd's log:\n{}", self.log());
        } else {
            let ills = self.ills();
            assert!(ills.is_empty(), "lanternd's log tells of {} ills:\n{}", ills.len(), ills.join("\n"));
        }
    }
}
