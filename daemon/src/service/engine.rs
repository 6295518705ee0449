//! The control socket's operations.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use glam::{DQuat, DVec3};
use lantern_config::{Config, OutputKind};
use lantern_gpu::Instance;
use lantern_proto::status::{DeviceStatus, ProjectorStatus, SceneStatus, TrackerStatus};
use lantern_proto::{
    Applied, Edit, ErrorBody, ExportOpen, Hello, Layer, PROTOCOL, Pattern, PatternRequest, Pose, Reloaded, SceneGet,
    Status,
};
use lantern_render::{LayerImage, ProjectorSpec};
use lantern_scene::{EditError, Editor, Scene, SceneProblem, may_take_long};
use lantern_tracking::Trackers;

use super::background::Background;
use super::frames::{Links, lock_editor};
use super::origin::{self, Origin};
use super::refusal::Refusal;
use super::setup;
use super::shared::{Lease, Request};
use super::state::Store;
use crate::control::{Engine, Events, Picture};
use crate::encode;
use crate::feed::Lent;
use crate::output::LendError;

/// Longer than any frame: an answer that does not come by then never will.
const PATIENCE: Duration = Duration::from_secs(120);

/// Answers requests from what the frame thread, the editor and the trackers know.
pub struct DaemonEngine {
    start: Instant,
    instance: Arc<Instance>,
    links: Links,
    trackers: Mutex<Trackers>,
    store: Option<Store>,
    origin: Origin,
    config: Mutex<Config>,
    /// The configuration's projectors, with what their calibration files held when they were read.
    projectors: Mutex<Vec<ProjectorSpec>>,
    /// Held while a revision is made, shown and kept, so that what is kept is never older than what was acknowledged. What takes
    /// long is made ready before.
    applying: Mutex<()>,
    background: Background,
}

impl DaemonEngine {
    /// Over everything that is running.
    pub fn new(
        instance: Arc<Instance>,
        links: Links,
        trackers: Trackers,
        store: Option<Store>,
        background: Background,
        origin: Origin,
        (config, projectors): (Config, Vec<ProjectorSpec>),
    ) -> Self {
        Self {
            start: Instant::now(),
            instance,
            links,
            trackers: Mutex::new(trackers),
            store,
            origin,
            config: Mutex::new(config),
            projectors: Mutex::new(projectors),
            applying: Mutex::new(()),
            background,
        }
    }

    fn config(&self) -> MutexGuard<'_, Config> {
        lock(&self.config)
    }

    /// Puts a request to the frame thread and waits for its answer.
    fn ask<T>(&self, request: Request, answer: &Receiver<Result<T, Refusal>>) -> Result<T, ErrorBody> {
        if !self.links.shared.request(request) {
            if self.links.shared.stopping() {
                return Err(stopping());
            }
            return Err(ErrorBody::new("busy", "too many requests wait for the frame thread; hint: ask again later"));
        }
        heard(answer.recv_timeout(PATIENCE))
    }

    /// Makes a revision durable, where anything is kept.
    fn keep(&self, scene: &Scene) -> Result<bool, ErrorBody> {
        let Some(store) = &self.store else { return Ok(false) };
        let configured = self.config().scene.clone();
        store.save(&configured, scene.revision, scene.edits()).map(|()| true).map_err(|e| {
            ErrorBody::new("not-durable", format!("the edits cannot be kept, and so are not applied: {e}"))
        })
    }

    fn read(&self, projector: &str, layer: lantern_render::Layer) -> Result<LayerImage, ErrorBody> {
        self.must_have(projector)?;
        let (reply, answer) = sync_channel(1);
        self.ask(Request::Read { projector: projector.to_owned(), layer, reply }, &answer)
    }

    fn must_have(&self, projector: &str) -> Result<(), ErrorBody> {
        let config = self.config();
        let known: Vec<_> = config.projectors.iter().map(|p| p.name.as_str()).collect();
        if known.contains(&projector) {
            return Ok(());
        }
        let message = format!("there is no projector `{projector}`; hint: there are {}", known.join(", "));
        Err(ErrorBody::new("unknown-projector", message).at("projector"))
    }

    /// Does what may take long of some edits before any revision is made of them: on a copy of the editor, in the background, so
    /// that nobody else's edits wait for it, nor bodies that move their nodes; and what they hold is brought to the device, so
    /// that a revision of them can be shown at once. A refusal here is that of the scene as it was when the edits came.
    fn prepare(&self, edits: &[Edit]) -> Result<Option<Prepared>, ErrorBody> {
        if !may_take_long(edits) {
            return Ok(None);
        }
        let mut copy = lock_editor(&self.links.editor).clone();
        let now = copy.current();
        let edits = edits.to_vec();
        let applied = self.background.run(move || copy.apply(&edits).map(|_| copy)).map_err(|_| stopping())?;
        let editor = applied.map_err(refused)?;
        let lease = self.bring(&now, editor.current())?;
        Ok(Some(Prepared { editor, _lease: lease }))
    }

    /// Makes a revision out of what was prepared; gives the one before as well.
    fn edit(&self, edits: &[Edit], prepared: Option<&Editor>) -> Result<(Arc<Scene>, Arc<Scene>), ErrorBody> {
        let mut copy = lock_editor(&self.links.editor).clone();
        if let Some(prepared) = prepared {
            copy.learn_from(prepared);
        }
        let read_from = copy.current();
        let mut scene = copy.apply(edits).map_err(refused)?;

        // Where a body has moved its node since, the edits go on top of that; what they need is kept by `scene` now, so that the
        // editor is held for a moment only.
        let mut editor = lock_editor(&self.links.editor);
        let before = editor.current();
        if Arc::ptr_eq(&before, &read_from) {
            *editor = copy;
        } else {
            editor.learn_from(&copy);
            scene = editor.apply(edits).map_err(refused)?;
        }
        Ok((before, scene))
    }

    /// Waits until what a draft holds is on the device, where that is more than one frame takes along. It stays there as long as
    /// the lease.
    fn bring(&self, now: &Scene, draft: Arc<Scene>) -> Result<Option<Arc<Lease>>, ErrorBody> {
        if lantern_render::bytes_beyond(now, &draft) <= lantern_render::UPLOAD_BYTES_A_FRAME {
            return Ok(None);
        }
        let lease = self.links.shared.lease();
        let (reply, answer) = sync_channel(1);
        self.ask(Request::Prepare { scene: draft, lease: Arc::downgrade(&lease), reply }, &answer)?;
        Ok(Some(lease))
    }

    /// Publishes a revision and waits until it is shown; gives the frame.
    fn show(&self, scene: &Arc<Scene>) -> Result<u64, ErrorBody> {
        heard(self.links.shared.publish(scene.clone()).recv_timeout(PATIENCE))
    }

    /// Takes a revision back that could not be shown or kept: the one before is shown again, under a new number.
    fn take_back(&self, editor: &mut Editor, refused: &Scene, before: &Scene) {
        let scene = editor.go_back(before, refused.revision);
        if let Err(error) = self.show(&scene) {
            tracing::error!(revision = scene.revision, "the scene before cannot be shown again: {error}");
        }
    }
}

/// What some edits need, before a revision is made of them.
struct Prepared {
    /// Knows all that was loaded.
    editor: Editor,
    /// Keeps on the device what was brought there, until the revision is shown or refused.
    _lease: Option<Arc<Lease>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // What is under these locks is replaced whole, never changed half way.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn refused(error: EditError) -> ErrorBody {
    ErrorBody::new(error.code, error.message).at(error.at)
}

fn stopping() -> ErrorBody {
    ErrorBody::new("stopping", "the daemon is stopping")
}

/// What the frame thread answered.
fn heard<T>(answer: Result<Result<T, Refusal>, RecvTimeoutError>) -> Result<T, ErrorBody> {
    match answer {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(refusal)) => Err(refusal.into()),
        Err(RecvTimeoutError::Disconnected) => Err(stopping()),
        Err(RecvTimeoutError::Timeout) => Err(ErrorBody::new("render-failed", "the frame thread does not answer")),
    }
}

impl Engine for DaemonEngine {
    fn hello(&self) -> Hello {
        Hello {
            protocol: PROTOCOL,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            projectors: self.config().projectors.iter().map(|p| p.name.clone()).collect(),
        }
    }

    fn status(&self) -> Status {
        let scene = self.links.shared.newest();
        let stats = self.links.stats.all();
        let config = self.config();
        let projectors = config.projectors.iter().enumerate().map(|(index, projector)| {
            let seen = stats.get(&projector.name).cloned().unwrap_or_default();
            let status = ProjectorStatus {
                resolution_px: projector.resolution_px,
                output: kind(&projector.output.kind).to_owned(),
                screen: seen.output.clone(),
                coarse: seen.coarse,
                frames: seen.frames,
                missed: seen.missed,
                queue: self.links.hardware.queue(index, config.projectors.len()),
                frame_ms: seen.frame_ms(),
                stages_ms: seen.stages_ms,
                pose_to_submit_ms: seen.pose_to_submit_ms,
                gpu_bytes: seen.gpu_bytes,
                revision: seen.revision,
                frame: seen.frame,
                latency_ms: self.links.ledger.latency(&projector.name),
            };
            (projector.name.clone(), status)
        });
        Status {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            uptime_s: self.start.elapsed().as_secs_f64(),
            config: self.origin.status(),
            device: DeviceStatus {
                validation_messages: self
                    .instance
                    .is_validating()
                    .then(|| self.instance.validation_messages().len() as u64),
                ..self.links.hardware.device()
            },
            scene: SceneStatus {
                revision: scene.revision,
                nodes: scene.nodes.len() as u64,
                triangles: scene.triangle_count() as u64,
                bytes: self.links.stats.scene_bytes(),
                origin_m: scene.origin_m.to_array(),
            },
            bodies: self.links.bodies.status(),
            trackers: self.trackers(),
            projectors: projectors.collect(),
        }
    }

    fn trackers(&self) -> BTreeMap<String, TrackerStatus> {
        lock(&self.trackers).status()
    }

    fn events(&self) -> &Arc<Events> {
        &self.links.events
    }

    fn scene_get(&self) -> SceneGet {
        let scene = self.links.shared.newest();
        SceneGet { revision: scene.revision, edits: scene.edits() }
    }

    fn apply(&self, edits: &[Edit], durable: bool) -> Result<Applied, ErrorBody> {
        let prepared = self.prepare(edits)?;
        let _turn = lock(&self.applying);
        let (before, scene) = self.edit(edits, prepared.as_ref().map(|prepared| &prepared.editor))?;
        let done = self.show(&scene).and_then(|frame| {
            let durable = durable && self.keep(&scene)?;
            Ok(Applied { revision: scene.revision, frame, durable })
        });
        done.inspect_err(|_| self.take_back(&mut lock_editor(&self.links.editor), &scene, &before))
    }

    fn pose(&self, pose: &Pose) -> Result<(), ErrorBody> {
        let orientation = pose.orientation.map(DQuat::from_array);
        let placed = self.links.bodies.set_pose(&pose.body, DVec3::from_array(pose.position_m), orientation, "socket");
        placed.map_err(|e| {
            use lantern_tracking::PoseError;
            let (code, at) = match e {
                PoseError::UnknownBody { .. } => ("unknown-body", "body"),
                PoseError::Position { .. } => ("bad-value", "position_m"),
                PoseError::Orientation { .. } => ("bad-value", "orientation"),
            };
            ErrorBody::new(code, e.to_string()).at(at)
        })
    }

    fn snapshot(&self, projector: &str, layer: Layer) -> Result<Picture, ErrorBody> {
        let layer = match layer {
            Layer::Color => lantern_render::Layer::Color,
            Layer::Radiance => lantern_render::Layer::Radiance,
            Layer::Distance => lantern_render::Layer::Distance,
            Layer::Depth => lantern_render::Layer::Depth,
            Layer::Node => lantern_render::Layer::Node,
            Layer::Weight => lantern_render::Layer::Weight,
            Layer::Room => {
                self.must_have(projector)?;
                let (reply, answer) = sync_channel(1);
                if self.links.bodies.eye_m().is_none() {
                    let message = "no body drives the viewer, so nobody sees the room; hint: add a [[body]] with \
                                   drives = \"viewer\" to the configuration";
                    return Err(ErrorBody::new("no-viewer", message).at("layer"));
                }
                let room = self.ask(Request::Room { projector: projector.to_owned(), reply }, &answer)?;
                return file(encode::encode_seen(&room));
            }
        };
        file(encode::encode(&self.read(projector, layer)?))
    }

    fn pattern(&self, request: &PatternRequest) -> Result<(), ErrorBody> {
        if let Some(projector) = &request.projector {
            self.must_have(projector)?;
        }
        let pattern = match request.name {
            Pattern::Off => lantern_render::Pattern::Off,
            Pattern::Grid => lantern_render::Pattern::Grid,
            Pattern::White => lantern_render::Pattern::White,
            Pattern::Black => lantern_render::Pattern::Black,
            Pattern::Checker => lantern_render::Pattern::Checker,
            Pattern::Identify => lantern_render::Pattern::Identify,
        };
        let (reply, answer) = sync_channel(1);
        self.ask(Request::Pattern { projector: request.projector.clone(), pattern, reply }, &answer)
    }

    fn export(&self, open: &ExportOpen) -> Result<Lent, ErrorBody> {
        self.must_have(&open.projector)?;
        let (reply, answer) = sync_channel(1);
        let lent =
            self.ask(Request::Lend { projector: open.projector.clone(), handle: open.handle, reply }, &answer)?;
        lent.map_err(|error| match error {
            LendError::Taken => ErrorBody::new("busy", error.to_string()),
            error => ErrorBody::new("no-export", format!("projector `{}`: {error}", open.projector)).at("projector"),
        })
    }

    fn reload(&self) -> Result<Reloaded, ErrorBody> {
        let _turn = lock(&self.applying);
        let refused = |message: String| {
            self.origin.refused(&message);
            ErrorBody::new("bad-config", message)
        };
        let path = self.origin.path().to_owned();
        let loaded = self.background.run(move || origin::load(&path)).map_err(|_| stopping())?;
        let (loaded, sources) = loaded.map_err(|e| refused(e.to_string()))?;
        loaded.warn();
        let old = self.config().clone();
        let config = loaded.config;
        if config.daemon.socket != old.daemon.socket
            || config.daemon.group != old.daemon.group
            || config.daemon.state_dir != old.daemon.state_dir
            || config.device != old.device
            || config.metrics != old.metrics
            || config.limits.max_clients != old.limits.max_clients
            || config.limits.max_requests_per_s != old.limits.max_requests_per_s
        {
            tracing::warn!(
                "daemon.socket, daemon.group, daemon.state_dir, [device], [metrics], limits.max_clients and \
                 limits.max_requests_per_s are read at the start only; everything else was reloaded"
            );
        }

        // All is made ready on a copy, so that whatever fails leaves everything as it was, and bodies go on moving their nodes. A
        // scene section that did not change keeps what clients have made of it.
        let same_scene = config.scene.fingerprint() == old.scene.fingerprint();
        let replaced = if same_scene {
            None
        } else {
            let (mut next, of) = (lock_editor(&self.links.editor).clone(), config.clone());
            let of_config = loaded.editor;
            let replaced = self.background.run(move || {
                next.learn_from(&of_config);
                let (limits, roots) = ((&of.limits).into(), of.daemon.asset_roots.clone());
                next.reconfigure(&of.scene, &of.base_dir, limits, roots).map(|_| next)
            });
            let text = |all: Vec<SceneProblem>| all.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
            Some(replaced.map_err(|_| stopping())?.map_err(|problems| refused(text(problems)))?)
        };
        let mut editor = lock_editor(&self.links.editor);
        let next = match replaced {
            Some(mut next) => {
                next.continue_after(editor.current().revision + 1);
                next
            }
            None => {
                let mut next = editor.clone();
                next.set_access((&config.limits).into(), &config.daemon.asset_roots);
                next
            }
        };
        let scene = next.current();
        lock(&self.trackers).configure(&config.trackers).map_err(|e| refused(e.to_string()))?;

        // Projectors that stay as they are keep their pictures. One that a file describes may change while the configuration
        // does not.
        let same_projectors = config.projectors == old.projectors
            && loaded.projectors == *lock(&self.projectors)
            && setup::homes_m(&config.bodies) == setup::homes_m(&old.bodies);
        let shown = if same_projectors && config.render == old.render {
            let before = editor.current();
            self.show(&scene).map(drop).inspect_err(|_| self.take_back(&mut editor, &scene, &before))
        } else {
            let (reply, answer) = sync_channel(1);
            let setup = Box::new(setup::setup(&config, loaded.projectors.clone(), scene.clone()));
            self.ask(Request::Reconfigure { setup, reply }, &answer)
        };
        if let Err(error) = shown {
            if let Err(error) = lock(&self.trackers).configure(&old.trackers) {
                tracing::error!("the trackers cannot be listened to as before: {error}");
            }
            self.origin.refused(&error.message);
            return Err(error);
        }
        *editor = next;
        drop(editor);
        self.links.bodies.configure(&config.bodies);
        let projectors: Vec<_> = config.projectors.iter().map(|projector| projector.name.as_str()).collect();
        let bodies: Vec<_> = config.bodies.iter().map(|body| body.name.as_str()).collect();
        self.links.ledger.keep(&projectors, &bodies);
        *self.config() = config;
        *lock(&self.projectors) = loaded.projectors;

        // What was kept belongs to the scene section that has gone.
        if !same_scene && let Err(error) = self.keep(&scene) {
            tracing::warn!("reloaded, but a restart will not find this scene: {}", error.message);
        }
        let shows = format!("{} projectors; {} nodes at the reload", self.config().projectors.len(), scene.nodes.len());
        self.origin.reloaded(&sources, &shows);
        tracing::info!(revision = scene.revision, "reloaded");
        Ok(Reloaded { revision: scene.revision })
    }
}

fn kind(output: &OutputKind) -> &'static str {
    match output {
        OutputKind::Headless => "headless",
        OutputKind::Window { .. } => "window",
        OutputKind::Display { .. } => "display",
        OutputKind::Export => "export",
    }
}

fn file(encoded: Result<encode::Encoded, encode::EncodeError>) -> Result<Picture, ErrorBody> {
    let encoded = encoded.map_err(|e| ErrorBody::new("encode-failed", e.to_string()))?;
    Ok(Picture { format: encoded.format, bytes: encoded.bytes })
}
