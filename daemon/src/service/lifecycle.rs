//! From start to stop: what comes up in which order, signals, and the end.

use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use anyhow::{Context, anyhow};
use lantern_gpu::{Device, Instance};
use lantern_scene::{Counts, EditError, Editor};
use lantern_tracking::{Bodies, Trackers};
use tokio::runtime::Runtime;
use tokio::signal::unix::{Signal, SignalKind, signal};

use super::background::Background;
use super::engine::DaemonEngine;
use super::frames::{self, Links, Open};
use super::hearsay;
use super::origin::{LoadedFrom, Origin};
use super::panics;
use super::setup::{self, Loaded};
use super::shared::Shared;
use super::state::{Found, State, Store};
use super::stats::Stats;
use super::systemd;
use super::vulkan::{open_device, open_vulkan_for};
use crate::control;
use crate::metrics;
use crate::socket_path;

/// How long requests that are being served may hold up the end.
const STOP_PATIENCE: Duration = Duration::from_secs(2);

/// How `lanternd run` was called.
#[derive(Clone, Debug)]
pub struct Options {
    /// The configuration.
    pub config: PathBuf,
    /// The socket, where the command line names it.
    pub socket: Option<PathBuf>,
    /// Stop when every projector has shown so many frames.
    pub frames: Option<u64>,
}

/// Runs the daemon until SIGTERM, SIGINT or the last frame.
///
/// # Errors
/// Whatever keeps it from starting, or ends it.
pub fn run(options: &Options) -> anyhow::Result<()> {
    panics::abort();
    let handed_over = systemd::control_socket().context("the socket that systemd handed over")?;
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
    let signals = {
        let _guard = runtime.enter();
        Signals::listen()?
    };
    let (origin, (mut loaded, sources)) = Origin::start(&options.config)?;
    loaded.warn();

    // The socket first: a second daemon must be refused before it touches anything that the first one uses.
    let door = loaded.config.daemon.group.as_deref().map_or(Ok(control::Door::open()), control::Door::for_group)?;
    let listener = match handed_over {
        Some(socket) => control::Listener::handed_over(socket)?,
        None => {
            let path = socket_path::resolve(options.socket.as_deref(), loaded.config.daemon.socket.as_deref())?;
            control::Listener::bind(&path, door.gid())?
        }
    };

    let store = loaded.config.daemon.state_dir.as_deref().map(Store::open).transpose()?;
    if let Some(store) = &store {
        restore(store, &mut loaded);
    }
    let Counts { built, cached } = loaded.editor.structures().counts();
    tracing::info!("structures built={built} cached={cached}");
    let instance = open_vulkan_for(&loaded.config)?;
    // Opened once more where it is lost; as the configuration has it now, since a reload leaves `[device]` alone.
    let again = (instance.clone(), loaded.config.clone());
    let open: Open = Box::new(move || open_device(&again.0, &again.1));
    let device = open()?;
    tracing::info!(device = device.info().name, driver = device.info().driver_info, "rendering");
    let served = serve(
        &runtime,
        signals,
        options,
        (loaded, sources),
        (listener, door),
        (origin, store),
        (instance, device, open),
    );

    // A request that still reads a large file is nobody's any more.
    runtime.shutdown_timeout(STOP_PATIENCE);
    served
}

/// The signals that mean something to the daemon. One that comes while it starts is heard as soon as it runs.
struct Signals {
    terminate: Signal,
    interrupt: Signal,
    hang_up: Signal,
}

impl Signals {
    fn listen() -> std::io::Result<Self> {
        Ok(Self {
            terminate: signal(SignalKind::terminate())?,
            interrupt: signal(SignalKind::interrupt())?,
            hang_up: signal(SignalKind::hangup())?,
        })
    }
}

/// Brings back the revision that was kept, if it belongs to this configuration's scene.
fn restore(store: &Store, loaded: &mut Loaded) {
    let found = match store.load(&loaded.config.scene) {
        Found::Scene(state) => match rebuild(&state, loaded) {
            Ok(editor) => {
                tracing::info!(revision = state.revision, "restored the scene that was kept");
                loaded.editor = editor;
                return;
            }
            Err(error) => store.unshowable(&state, error.to_string()),
        },
        found => found,
    };
    let Found::Unusable { reason, revision, aside } = found else { return };
    // Numbers count on all the same.
    loaded.editor.continue_after(revision.map_or(0, |revision| revision + 1));
    match aside {
        Ok(aside) => tracing::warn!(
            aside = %aside.display(),
            "the scene that was kept is not used, and was set aside; the configuration's is shown: {reason}"
        ),
        Err(error) => tracing::error!(
            "the scene that was kept is not used, and cannot be set aside, so that nothing new can be kept: {reason}; {error}"
        ),
    }
}

/// An editor of a scene that was kept.
fn rebuild(state: &State, loaded: &Loaded) -> Result<Editor, EditError> {
    let mut editor = Editor::new((&loaded.config.limits).into(), loaded.config.daemon.asset_roots.clone())
        .with_structures(loaded.editor.structures().clone());
    editor.learn_from(&loaded.editor);
    editor.restore(&state.edits)?;
    editor.continue_after(state.revision);
    Ok(editor)
}

fn serve(
    runtime: &Runtime,
    signals: Signals,
    options: &Options,
    (loaded, sources): LoadedFrom,
    (listener, door): (control::Listener, control::Door),
    (origin, store): (Origin, Option<Store>),
    vulkan: (Arc<Instance>, Arc<Device>, Open),
) -> anyhow::Result<()> {
    let (instance, device, open) = vulkan;
    let scene = loaded.editor.current();
    let bodies = Arc::new(Bodies::new(&loaded.config.bodies));
    let shared = Shared::new(scene.clone());
    let waker = shared.clone();
    bodies.set_waker(Arc::new(move || waker.stir()));
    let trackers = Trackers::start(runtime.handle().clone(), &loaded.config.trackers, bodies.clone())?;
    let links = Links {
        shared: shared.clone(),
        bodies,
        stats: Arc::new(Stats::default()),
        hardware: Arc::default(),
        ledger: Arc::default(),
        events: Arc::default(),
        editor: Arc::new(Mutex::new(loaded.editor)),
    };

    hearsay::of_bodies(&links.bodies, links.events.clone());

    // The first picture stands before anybody is told that the daemon is there.
    let shows = format!("{} projectors; {} nodes at the start", loaded.projectors.len(), scene.nodes.len());
    let setup = setup::setup(&loaded.config, loaded.projectors.clone(), scene);
    let (thread, ready) = frames::start((device, open), setup, links.clone(), options.frames)?;
    ready
        .recv()
        .map_err(|_| anyhow!("the frame thread has gone"))?
        .map_err(|e| anyhow!(e))
        .context("the first frame")?;
    origin.works(&sources);
    drop(sources);
    let limits = &loaded.config.limits;
    let rules = control::Rules::new(door, limits.max_clients, limits.max_requests_per_s);
    let background = Background::start().context("a thread to build structures on")?;
    let metrics_at = loaded.config.metrics.listen;
    let (shows, configured) = (origin.words(&shows), (loaded.config, loaded.projectors));
    let engine = DaemonEngine::new(instance, links, trackers, store, background, origin, configured);
    let engine = Arc::new(engine);
    let at = |address| metrics::Server::start(runtime.handle(), address, engine.clone());
    let metrics = metrics_at.map(at).transpose()?;
    let server = control::Server::start(runtime.handle(), listener, engine.clone(), rules)?;
    tracing::info!(socket = %server.path().display(), "ready");
    systemd::ready(&shows);

    let watch = runtime.spawn(hearsay::of_trackers(engine.clone()));

    let Signals { mut terminate, mut interrupt, mut hang_up } = signals;
    let reloads = runtime.spawn(async move {
        // One after the other; hang-ups that come meanwhile are one.
        while hang_up.recv().await.is_some() {
            let engine = engine.clone();
            let reload = tokio::task::spawn_blocking(move || control::Engine::reload(&*engine));
            if let Ok(Err(error)) = reload.await {
                tracing::warn!("the configuration was not reloaded: {}", error.message);
            }
        }
    });
    let mut frames_end = runtime.spawn_blocking(move || thread.join());
    let ended = runtime.block_on(async {
        tokio::select! {
            _ = terminate.recv() => None,
            _ = interrupt.recv() => None,
            ended = &mut frames_end => Some(ended),
        }
    });
    tracing::info!("stopping");
    systemd::stopping();
    drop(server);
    drop(metrics);
    reloads.abort();
    watch.abort();
    shared.stop();
    let ended = match ended {
        Some(ended) => ended,
        None => runtime.block_on(frames_end),
    };
    match ended {
        Ok(Ok(ended)) => ended.context("the frame thread"),
        Ok(Err(_)) | Err(_) => Err(anyhow!("the frame thread panicked")),
    }
}
