//! A daemon without a device: the real control socket over an engine that keeps its scene in a list.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]
#![allow(dead_code, reason = "each test program uses its own part")]

use lantern::control::{Door, Engine, Events, Listener, Picture, Rules, Server};
use lantern::feed::Lent;
use lantern_proto::status::{ConfigStatus, DeviceStatus, ProjectorStatus, SceneStatus, TrackerStatus};
use lantern_proto::{
    Applied, Edit, ErrorBody, ExportOpen, Hello, Layer, PatternRequest, Pose, Reloaded, SceneGet, Status,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use tempfile::TempDir;
use tokio::runtime::Runtime;

/// Keeps edits; knows the node `ghost` to be unknown.
#[derive(Default)]
pub(crate) struct FakeEngine {
    pub(crate) edits: Mutex<Vec<Edit>>,
    pub(crate) poses: Mutex<Vec<Pose>>,
    pub(crate) patterns: Mutex<Vec<PatternRequest>>,
    pub(crate) reload_fails: AtomicBool,
    pub(crate) events: Arc<Events>,
}

/// What `snapshot` gives; with newlines and NULs, as pictures have.
pub(crate) fn picture(layer: Layer) -> Vec<u8> {
    format!("\u{89}PNG\r\n\0{}\n", layer.as_str()).into_bytes().repeat(50_000)
}

impl Engine for FakeEngine {
    fn hello(&self) -> Hello {
        Hello { protocol: 1, version: "9.9.9".into(), projectors: vec!["left".into(), "right".into()] }
    }

    fn status(&self) -> Status {
        Status {
            version: "9.9.9".into(),
            uptime_s: 3725.0,
            config: ConfigStatus { path: "lab.toml".into(), good: true, problem: None },
            device: DeviceStatus {
                name: "llvmpipe (fake)".into(),
                driver: "1".into(),
                kind: "cpu".into(),
                lost: 0,
                validation_messages: None,
            },
            scene: SceneStatus {
                revision: self.edits.lock().unwrap().len() as u64,
                triangles: 1_234_567,
                ..SceneStatus::default()
            },
            bodies: [("head".to_owned(), Default::default())].into(),
            trackers: self.trackers(),
            projectors: [(
                "left".to_owned(),
                ProjectorStatus { resolution_px: [1280, 800], ..ProjectorStatus::default() },
            )]
            .into(),
        }
    }

    fn trackers(&self) -> BTreeMap<String, TrackerStatus> {
        let status = TrackerStatus { last_reject: Some("63 bytes".into()), rejected: 1, ..TrackerStatus::default() };
        [("optitrack".to_owned(), status)].into()
    }

    fn events(&self) -> &Arc<Events> {
        &self.events
    }

    fn scene_get(&self) -> SceneGet {
        let edits = self.edits.lock().unwrap().clone();
        SceneGet { revision: edits.len() as u64, edits }
    }

    fn apply(&self, edits: &[Edit], durable: bool) -> Result<Applied, ErrorBody> {
        let unknown = |edit: &Edit| matches!(edit, Edit::Remove(remove) if remove.node == "ghost");
        if let Some(index) = edits.iter().position(unknown) {
            return Err(ErrorBody::new("unknown-node", "there is no node `ghost`").at(format!("edits[{index}].node")));
        }
        let mut kept = self.edits.lock().unwrap();
        kept.extend_from_slice(edits);
        Ok(Applied { revision: kept.len() as u64, frame: 42, durable })
    }

    fn pose(&self, pose: &Pose) -> Result<(), ErrorBody> {
        if pose.body != "head" {
            return Err(ErrorBody::new("unknown-body", format!("there is no body `{}`", pose.body)).at("body"));
        }
        self.poses.lock().unwrap().push(pose.clone());
        Ok(())
    }

    fn snapshot(&self, projector: &str, layer: Layer) -> Result<Picture, ErrorBody> {
        match projector {
            "left" => Ok(Picture { format: "png", bytes: picture(layer) }),
            _ => {
                Err(ErrorBody::new("unknown-projector", format!("there is no projector `{projector}`")).at("projector"))
            }
        }
    }

    fn pattern(&self, request: &PatternRequest) -> Result<(), ErrorBody> {
        match request.projector.as_deref() {
            None | Some("left") => {
                self.patterns.lock().unwrap().push(request.clone());
                Ok(())
            }
            Some(other) => {
                Err(ErrorBody::new("unknown-projector", format!("there is no projector `{other}`")).at("projector"))
            }
        }
    }

    fn export(&self, open: &ExportOpen) -> Result<Lent, ErrorBody> {
        Err(ErrorBody::new("no-export", format!("projector `{}` goes nowhere", open.projector)).at("projector"))
    }

    fn reload(&self) -> Result<Reloaded, ErrorBody> {
        if self.reload_fails.load(Ordering::SeqCst) {
            return Err(ErrorBody::new("bad-config", "lab.toml:3:1: unknown key `x` in [scene]"));
        }
        Ok(Reloaded { revision: 7 })
    }
}

/// A served socket in a folder of its own. Fields are dropped in this order: the server before what it runs on.
pub(crate) struct FakeDaemon {
    server: Option<Server>,
    pub(crate) engine: Arc<FakeEngine>,
    pub(crate) path: PathBuf,
    runtime: Runtime,
    folder: TempDir,
}

/// For so many clients, whoever they are.
fn rules(max_clients: u32) -> Rules {
    Rules::new(Door::open(), max_clients, 1_000_000)
}

impl FakeDaemon {
    pub(crate) fn start() -> Self {
        Self::with_clients(8)
    }

    pub(crate) fn with_clients(max_clients: u32) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/er/lanternd.sock");
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
        let engine = Arc::new(FakeEngine::default());
        let listener = Listener::bind(&path, None).unwrap();
        let server = Server::start(runtime.handle(), listener, engine.clone(), rules(max_clients)).unwrap();
        assert_eq!(server.path(), path);
        Self { server: Some(server), engine, path, runtime, folder }
    }

    pub(crate) fn socket(&self) -> &Path {
        &self.path
    }

    pub(crate) fn stop(&mut self) {
        self.server = None;
    }

    /// At the same socket, with the same engine.
    pub(crate) fn start_again(&mut self) {
        let listener = Listener::bind(&self.path, None).unwrap();
        self.server = Some(Server::start(self.runtime.handle(), listener, self.engine.clone(), rules(8)).unwrap());
    }

    /// A path beside the socket's folder.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}
