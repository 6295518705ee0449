//! The control socket's operations.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use glam::{DQuat, DVec3};
use lantern_config::Config;
use lantern_gpu::{Device, Instance};
use lantern_proto::status::{DeviceStatus, ProjectorStatus, QueueStatus, SceneStatus};
use lantern_proto::{Applied, Edit, ErrorBody, Hello, Layer, PROTOCOL, Pose, Reloaded, SceneGet, Status};
use lantern_render::LayerImage;
use lantern_scene::Scene;
use lantern_tracking::Trackers;

use super::frames::{Links, lock_editor};
use super::setup;
use super::shared::Request;
use super::state::Store;
use crate::control::{Engine, Picture};
use crate::encode;

/// Longer than any frame: an answer that does not come by then never will.
const PATIENCE: Duration = Duration::from_secs(120);

/// Answers requests from what the frame thread, the editor and the trackers know.
pub struct DaemonEngine {
    start: Instant,
    instance: Arc<Instance>,
    device: Arc<Device>,
    links: Links,
    trackers: Mutex<Trackers>,
    store: Option<Store>,
    config_path: PathBuf,
    config: Mutex<Config>,
    /// Held while a revision is made, shown and kept, so that what is kept is never older than what was acknowledged.
    applying: Mutex<()>,
}

impl DaemonEngine {
    /// Over everything that is running.
    pub fn new(
        instance: Arc<Instance>,
        device: Arc<Device>,
        links: Links,
        trackers: Trackers,
        store: Option<Store>,
        config_path: PathBuf,
        config: Config,
    ) -> Self {
        Self {
            start: Instant::now(),
            instance,
            device,
            links,
            trackers: Mutex::new(trackers),
            store,
            config_path,
            config: Mutex::new(config),
            applying: Mutex::new(()),
        }
    }

    fn config(&self) -> MutexGuard<'_, Config> {
        lock(&self.config)
    }

    /// Puts a request to the frame thread and waits for its answer.
    fn ask<T>(&self, request: Request, answer: &Receiver<Result<T, String>>) -> Result<T, ErrorBody> {
        if !self.links.shared.request(request) {
            return Err(ErrorBody::new("busy", "too many requests wait for the frame thread; hint: ask again later"));
        }
        heard(answer.recv_timeout(PATIENCE))
    }

    /// Makes a revision durable, where anything is kept.
    fn keep(&self, scene: &Scene) -> Result<bool, ErrorBody> {
        let Some(store) = &self.store else { return Ok(false) };
        let fingerprint = self.config().scene.fingerprint();
        store.save(&fingerprint, scene.revision, scene.edits()).map(|()| true).map_err(|e| {
            ErrorBody::new("not-durable", format!("revision {} is shown but not kept: {e}", scene.revision))
        })
    }

    fn read(&self, projector: &str, layer: lantern_render::Layer) -> Result<LayerImage, ErrorBody> {
        let index = self.projector(projector)?;
        let (reply, answer) = sync_channel(1);
        self.ask(Request::Read { projector: index, layer, reply }, &answer)
    }

    fn projector(&self, name: &str) -> Result<usize, ErrorBody> {
        let config = self.config();
        config.projectors.iter().position(|p| p.name == name).ok_or_else(|| {
            let known: Vec<_> = config.projectors.iter().map(|p| p.name.as_str()).collect();
            let message = format!("there is no projector `{name}`; hint: there are {}", known.join(", "));
            ErrorBody::new("unknown-projector", message).at("projector")
        })
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // What is under these locks is replaced whole, never changed half way.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What the frame thread answered.
fn heard<T>(answer: Result<Result<T, String>, RecvTimeoutError>) -> Result<T, ErrorBody> {
    match answer {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(message)) => Err(ErrorBody::new("render-failed", message)),
        Err(RecvTimeoutError::Disconnected) => Err(ErrorBody::new("stopping", "the daemon is stopping")),
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
        let info = self.device.info();
        let scene = self.links.shared.newest();
        let stats = self.links.stats.all();
        let config = self.config();
        let projectors = config.projectors.iter().enumerate().map(|(index, projector)| {
            let queue = self.device.queue(index);
            let seen = stats.get(&projector.name).cloned().unwrap_or_default();
            let status = ProjectorStatus {
                resolution_px: projector.resolution_px,
                output: "headless".to_owned(),
                frames: seen.frames,
                missed: seen.missed,
                queue: QueueStatus { family: queue.family, index: queue.index, shared: queue.shared },
                frame_ms: seen.frame_ms(),
                stages_ms: seen.stages_ms,
                pose_to_submit_ms: seen.pose_to_submit_ms,
                revision: seen.revision,
                frame: seen.frame,
            };
            (projector.name.clone(), status)
        });
        Status {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            uptime_s: self.start.elapsed().as_secs_f64(),
            device: DeviceStatus {
                name: info.name.clone(),
                driver: format!("{} {}", info.driver_name, info.driver_info),
                kind: info.kind.to_owned(),
                validation_messages: Some(self.instance.validation_messages().len() as u64),
            },
            scene: SceneStatus {
                revision: scene.revision,
                nodes: scene.nodes.len() as u64,
                triangles: scene.triangle_count() as u64,
                bytes: scene.device_bytes(),
                origin_m: scene.origin_m.to_array(),
            },
            bodies: self.links.bodies.status(),
            trackers: lock(&self.trackers).status(),
            projectors: projectors.collect(),
        }
    }

    fn scene_get(&self) -> SceneGet {
        let scene = self.links.shared.newest();
        SceneGet { revision: scene.revision, edits: scene.edits() }
    }

    fn apply(&self, edits: &[Edit], durable: bool) -> Result<Applied, ErrorBody> {
        let _turn = lock(&self.applying);
        let scene = lock_editor(&self.links.editor)
            .apply(edits)
            .map_err(|e| ErrorBody::new(e.code, e.message.clone()).at(e.at.clone()))?;
        let shown = self.links.shared.publish(scene.clone());
        let frame = heard(shown.recv_timeout(PATIENCE))?;
        let kept = durable && self.keep(&scene)?;
        Ok(Applied { revision: scene.revision, frame, durable: kept })
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
                self.projector(projector)?;
                let (reply, answer) = sync_channel(1);
                let room = self.ask(Request::Room { reply }, &answer)?;
                return file(encode::encode_seen(&room));
            }
        };
        file(encode::encode(&self.read(projector, layer)?))
    }

    fn reload(&self) -> Result<Reloaded, ErrorBody> {
        let _turn = lock(&self.applying);
        let refused = |message: String| ErrorBody::new("bad-config", message);
        let loaded = setup::load(&self.config_path).map_err(|e| refused(e.to_string()))?;
        let old = self.config().clone();
        if loaded.config.daemon != old.daemon
            || loaded.config.device != old.device
            || loaded.config.limits != old.limits
        {
            tracing::warn!("[daemon], [device] and [limits] are read at the start only; the others were reloaded");
        }

        // A scene section that did not change keeps what clients have made of it.
        let mut editor = lock_editor(&self.links.editor);
        let same_scene = loaded.config.scene.fingerprint() == old.scene.fingerprint();

        // Addresses first: they are what can still fail.
        lock(&self.trackers).configure(&loaded.config.trackers).map_err(|e| refused(e.to_string()))?;
        let (reply, answer) = sync_channel(1);
        let setup = Box::new(setup::setup(&loaded.config, loaded.projectors, editor.current()));
        if let Err(error) = self.ask(Request::Reconfigure { setup, reply }, &answer) {
            lock(&self.trackers).configure(&old.trackers).map_err(|e| refused(e.to_string()))?;
            return Err(error);
        }
        self.links.bodies.configure(&loaded.config.bodies);
        let config = loaded.config;
        if !same_scene {
            let roots = config.daemon.asset_roots.clone();
            let replaced = editor.reconfigure(&config.scene, &config.base_dir, (&config.limits).into(), roots);
            replaced.map_err(|problems| refused(problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")))?;
        }
        let scene = editor.current();
        drop(editor);
        *self.config() = config;
        let shown = self.links.shared.publish(scene.clone());
        heard(shown.recv_timeout(PATIENCE))?;
        tracing::info!(revision = scene.revision, "reloaded");
        Ok(Reloaded { revision: scene.revision })
    }
}

fn file(encoded: Result<encode::Encoded, encode::EncodeError>) -> Result<Picture, ErrorBody> {
    let encoded = encoded.map_err(|e| ErrorBody::new("encode-failed", e.to_string()))?;
    Ok(Picture { format: encoded.format, bytes: encoded.bytes })
}
