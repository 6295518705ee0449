//! A daemon whose Vulkan calls fail when a test wants them to, by the layer in `tests/faults`.

use std::{
    collections::{BTreeMap, BTreeSet},
    env, fs,
    io::{BufRead, BufReader, Write},
    os::unix::net::UnixStream,
    path::Path,
    sync::Arc,
    time::Duration,
};

use anyhow::{Context, Result, bail, ensure};
use lantern_faults::{ARM_VARIABLE, CALLS, LAYER, SOCKET_VARIABLE};
use tempfile::TempDir;

use crate::harness::{Daemon, Ended};

/// The layer answers at once, whatever the daemon does.
const ANSWER_LIMIT: Duration = Duration::from_secs(30);
/// Where Debian keeps the manifests of layers: the loader looks nowhere else once it is told of ours.
const SYSTEM_LAYERS: &str = "/usr/share/vulkan/explicit_layer.d:/etc/vulkan/explicit_layer.d";

/// A result of Vulkan, by name and number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Failure {
    /// Without `VK_`.
    pub name: &'static str,
    number: i32,
}

/// `VK_ERROR_OUT_OF_HOST_MEMORY`.
pub const NO_HOST_MEMORY: Failure = Failure { name: "ERROR_OUT_OF_HOST_MEMORY", number: -1 };
/// `VK_ERROR_OUT_OF_DEVICE_MEMORY`.
pub const NO_DEVICE_MEMORY: Failure = Failure { name: "ERROR_OUT_OF_DEVICE_MEMORY", number: -2 };
/// `VK_ERROR_DEVICE_LOST`: the device is lost from then on.
pub const LOST: Failure = Failure { name: "ERROR_DEVICE_LOST", number: -4 };
/// `VK_TIMEOUT`: the device hangs from then on.
pub const HUNG: Failure = Failure { name: "TIMEOUT", number: 2 };

/// `VK_ERROR_SURFACE_LOST_KHR`.
pub const NO_SURFACE: Failure = Failure { name: "ERROR_SURFACE_LOST_KHR", number: -1_000_000_000 };
/// `VK_ERROR_OUT_OF_DATE_KHR`.
pub const OUTDATED: Failure = Failure { name: "ERROR_OUT_OF_DATE_KHR", number: -1_000_001_004 };

/// `VK_SUBOPTIMAL_KHR`: the call does what it should.
pub const SUBOPTIMAL: Failure = Failure { name: "SUBOPTIMAL_KHR", number: 1_000_001_003 };

/// A call that is to fail.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// `vkCreateBuffer`.
    pub call: String,
    /// Which one of that name, from 1.
    pub nth: u64,
    /// How.
    pub failure: Failure,
    /// Whether all later ones of that name fail as well.
    pub stays: bool,
}

impl Fault {
    /// The call fails once.
    pub fn once(call: &str, nth: u64, failure: Failure) -> Self {
        Self { call: call.to_owned(), nth, failure, stays: false }
    }

    /// The call fails from then on.
    pub fn from_then_on(call: &str, nth: u64, failure: Failure) -> Self {
        Self { stays: true, ..Self::once(call, nth, failure) }
    }

    fn words(&self) -> String {
        let lasts = if self.stays { "on" } else { "once" };
        format!("{} {} {} {lasts}", self.call, self.nth, self.failure.number)
    }
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let lasts = if self.stays { " from then on" } else { "" };
        write!(f, "{} {}{lasts} answers {}", self.call, self.nth, self.failure.name)
    }
}

/// What the layer saw since it was last armed or cleared.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Calls that were made to fail.
    pub fired: u64,
    /// Extensions and calls that the layer does not know, since the start.
    pub strangers: Vec<String>,
    /// By name, how often each was called.
    pub counts: BTreeMap<String, u64>,
}

/// Starts a daemon with the layer in it, and a fault armed from its first call on, or none.
///
/// # Errors
/// As [`Daemon::try_start_in`], and where the layer cannot be prepared.
pub fn start(folder: &Arc<TempDir>, config: &str, armed: Option<&Fault>) -> Result<Result<Daemon, Ended>> {
    fs::write(folder.path().join("lantern.toml"), config).context("writing the configuration")?;
    let environment = environment(folder.path(), armed)?;
    let paths: Vec<_> = environment.iter().map(|(name, value)| (*name, Path::new(value))).collect();
    Daemon::try_start_as_is(folder, &paths)
}

/// What a daemon's environment holds so that the layer is in it. Its socket is `faults.sock` in the folder.
fn environment(folder: &Path, armed: Option<&Fault>) -> Result<Vec<(&'static str, String)>> {
    // Cargo has built it beside this very program, since the tests depend on it.
    let test = env::current_exe().context("finding the test's own program")?;
    let library = test.with_file_name("liblantern_faults.so");
    ensure!(library.is_file(), "there is no layer {}", library.display());
    let manifest = serde_json::json!({
        "file_format_version": "1.2.0",
        "layer": {
            "name": LAYER, "type": "GLOBAL", "library_path": library, "api_version": "1.3.0",
            "implementation_version": "1", "description": "fails the calls that a test names",
        },
    });
    fs::write(folder.join("faults.json"), manifest.to_string()).context("writing the layer's manifest")?;
    let socket = folder.join("faults.sock");
    if socket.exists() {
        fs::remove_file(&socket).context("removing the socket of an earlier daemon")?;
    }
    let mut variables = vec![
        ("VK_LAYER_PATH", format!("{}:{SYSTEM_LAYERS}", folder.display())),
        ("VK_INSTANCE_LAYERS", LAYER.to_owned()),
        (SOCKET_VARIABLE, socket.display().to_string()),
        // A layer of Mesa's that stands above this one reads what a failed call has not written.
        ("NODEVICE_SELECT", "1".to_owned()),
    ];
    variables.extend(armed.map(|fault| (ARM_VARIABLE, fault.words())));
    Ok(variables)
}

/// A connection to the layer in a running daemon.
#[derive(Debug)]
pub struct Faults(BufReader<UnixStream>);

impl Faults {
    /// Connects to that of a daemon in this folder.
    ///
    /// # Errors
    /// Where there is none.
    pub fn connect(folder: &Path) -> Result<Self> {
        let stream = UnixStream::connect(folder.join("faults.sock")).context("connecting to the layer")?;
        stream.set_read_timeout(Some(ANSWER_LIMIT)).context("limiting the wait")?;
        Ok(Self(BufReader::new(stream)))
    }

    /// Counts anew, and fails a call from now on.
    ///
    /// # Errors
    /// Where the connection breaks.
    pub fn arm(&mut self, fault: &Fault) -> Result<Report> {
        self.ask(&format!("arm {}", fault.words()))
    }

    /// Counts anew, and fails nothing.
    ///
    /// # Errors
    /// Where the connection breaks.
    pub fn clear(&mut self) -> Result<Report> {
        self.ask("clear")
    }

    /// What was called so far.
    ///
    /// # Errors
    /// Where the connection breaks.
    pub fn report(&mut self) -> Result<Report> {
        self.ask("report")
    }

    fn ask(&mut self, line: &str) -> Result<Report> {
        writeln!(self.0.get_mut(), "{line}").context("writing to the layer")?;
        let mut answer = String::new();
        self.0.read_line(&mut answer).context("reading from the layer")?;
        let mut report = Report::default();
        for (key, value) in answer.split_whitespace().filter_map(|word| word.split_once('=')) {
            let items = || value.split(',').filter(|item| !item.is_empty());
            match key {
                "fired" => report.fired = value.parse()?,
                "strangers" => report.strangers = items().map(str::to_owned).collect(),
                "counts" => {
                    let count = |item: &str| {
                        let (name, count) = item.split_once(':').context("a count without its number")?;
                        Ok((name.to_owned(), count.parse()?))
                    };
                    report.counts = items().map(count).collect::<Result<_>>()?;
                }
                _ => bail!("the layer answers {answer:?}"),
            }
        }
        ensure!(answer.starts_with("fired="), "the layer answers {answer:?}");
        Ok(report)
    }
}

/// Names of the calls that can fail and that `daemon/gpu` makes, by its sources: through crate `ash`, or by the allocator.
///
/// # Errors
/// Where the sources cannot be read.
pub fn calls_in_sources() -> Result<BTreeSet<String>> {
    let mut places = vec![Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../daemon/gpu/src")).to_owned()];
    let mut calls: BTreeSet<String> = ["vkAllocateMemory", "vkMapMemory"].map(str::to_owned).into();
    while let Some(place) = places.pop() {
        if place.is_dir() {
            for entry in fs::read_dir(&place).context("listing sources")? {
                places.push(entry.context("listing sources")?.path());
            }
            continue;
        }
        let code = fs::read_to_string(&place).with_context(|| format!("reading {}", place.display()))?;
        // `.create_buffer(` is vkCreateBuffer, and `.create_swapchain(` vkCreateSwapchainKHR.
        for (at, _) in code.match_indices('.') {
            let rest = &code[at + 1..];
            let word: String = rest.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '_').collect();
            if rest[word.len()..].starts_with('(') {
                let upper = |part: &str| part[..1].to_ascii_uppercase() + &part[1..];
                let camel: String = word.split('_').filter(|part| !part.is_empty()).map(upper).collect();
                let is_it = |call: &&str| {
                    let name = call.trim_start_matches("vk");
                    name == camel || name.trim_end_matches(char::is_uppercase) == camel
                };
                calls.extend(CALLS.iter().map(|call| call.name()).filter(is_it).map(str::to_owned));
            }
        }
    }
    Ok(calls)
}
