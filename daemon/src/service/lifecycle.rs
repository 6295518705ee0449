//! From start to stop: what comes up in which order, signals, and the end.

use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use anyhow::{Context, anyhow};
use lantern_gpu::{Device, Instance};
use lantern_scene::Editor;
use lantern_tracking::{Bodies, Trackers};
use tokio::runtime::Runtime;
use tokio::signal::unix::{SignalKind, signal};

use super::engine::DaemonEngine;
use super::frames::{self, Links};
use super::setup::{self, Loaded};
use super::shared::Shared;
use super::state::Store;
use super::stats::Stats;
use super::vulkan::{open_device, open_vulkan};
use crate::control;
use crate::socket_path;

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
    let mut loaded = setup::load(&options.config)?;
    for node in &loaded.editor.current().nodes {
        for warning in node.warnings() {
            tracing::warn!(node = node.name, "{warning}");
        }
    }
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;

    // The socket first: a second daemon must be refused before it touches anything that the first one uses.
    let path = socket_path::resolve(options.socket.as_deref(), loaded.config.daemon.socket.as_deref())?;
    let listener = control::Listener::bind(&path)?;

    let store = loaded.config.daemon.state_dir.as_deref().map(Store::open).transpose()?;
    if let Some(store) = &store {
        restore(store, &mut loaded);
    }
    let instance = open_vulkan()?;
    let device = open_device(&instance, &loaded.config)?;
    tracing::info!(device = device.info().name, driver = device.info().driver_info, "rendering");
    serve(&runtime, options, loaded, listener, store, (instance, device))
}

/// Brings back the revision that was kept, if it belongs to this configuration's scene.
fn restore(store: &Store, loaded: &mut Loaded) {
    let state = match store.load(&loaded.config.scene.fingerprint()) {
        Ok(Some(state)) => state,
        Ok(None) => return,
        Err(error) => {
            tracing::warn!("{error}");
            return;
        }
    };
    let mut editor = Editor::new((&loaded.config.limits).into(), loaded.config.daemon.asset_roots.clone());
    match editor.restore(&state.edits) {
        Ok(_) => {
            editor.continue_after(state.revision);
            tracing::info!(revision = state.revision, "restored the scene that was kept");
            loaded.editor = editor;
        }
        Err(error) => tracing::warn!("the scene that was kept cannot be shown: {error}; the configuration's is"),
    }
}

fn serve(
    runtime: &Runtime,
    options: &Options,
    loaded: Loaded,
    listener: control::Listener,
    store: Option<Store>,
    vulkan: (Arc<Instance>, Arc<Device>),
) -> anyhow::Result<()> {
    let (instance, device) = vulkan;
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
        editor: Arc::new(Mutex::new(loaded.editor)),
    };

    // The first picture stands before anybody is told that the daemon is there.
    let setup = setup::setup(&loaded.config, loaded.projectors, scene);
    let (thread, ready) = frames::start(device.clone(), setup, links.clone(), options.frames)?;
    ready
        .recv()
        .map_err(|_| anyhow!("the frame thread has gone"))?
        .map_err(|e| anyhow!(e))
        .context("the first frame")?;
    let max_clients = loaded.config.limits.max_clients as usize;
    let engine =
        Arc::new(DaemonEngine::new(instance, device, links, trackers, store, options.config.clone(), loaded.config));
    let server = control::Server::start(runtime.handle(), listener, engine.clone(), max_clients)?;
    tracing::info!(socket = %server.path().display(), "ready");

    let mut frame_thread = Some(thread);
    runtime.block_on(async {
        let mut terminate = signal(SignalKind::terminate())?;
        let mut interrupt = signal(SignalKind::interrupt())?;
        let mut hang_up = signal(SignalKind::hangup())?;
        let mut look = tokio::time::interval(std::time::Duration::from_millis(100));
        loop {
            tokio::select! {
                _ = terminate.recv() => break,
                _ = interrupt.recv() => break,
                _ = hang_up.recv() => {
                    let engine = engine.clone();
                    tokio::task::spawn_blocking(move || {
                        use control::Engine as _;
                        if let Err(error) = engine.reload() {
                            tracing::warn!("reload: {}", error.message);
                        }
                    });
                }
                _ = look.tick() => if frame_thread.as_ref().is_none_or(|t| t.is_finished()) { break },
            }
        }
        Ok::<_, std::io::Error>(())
    })?;
    tracing::info!("stopping");
    drop(server);
    shared.stop();
    match frame_thread.take().map(std::thread::JoinHandle::join) {
        Some(Ok(ended)) => ended.context("the frame thread"),
        Some(Err(_)) => Err(anyhow!("the frame thread panicked")),
        None => Ok(()),
    }
}
