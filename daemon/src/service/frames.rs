//! The frame thread: it alone talks to the device, sleeps while nothing changes, and shows one snapshot on all projectors.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use glam::DVec3;
use lantern_config::Drives;
use lantern_gpu::Device;
use lantern_render::{FrameReport, ProjectorSpec, RenderError, Renderer, Settings};
use lantern_scene::{Editor, Scene};
use lantern_tracking::Bodies;

use super::shared::{Request, Shared, Turn};
use super::stats::Stats;
use crate::output::Headless;

/// What the frame thread renders, and for whom.
pub struct Setup {
    /// The projectors, in order.
    pub projectors: Vec<ProjectorSpec>,
    /// Refreshes a second of each.
    pub refresh_hz: Vec<f64>,
    /// How to render.
    pub settings: Settings,
    /// The first revision.
    pub scene: Arc<Scene>,
}

/// What the frame thread shares with the others.
#[derive(Clone)]
pub struct Links {
    /// Requests and wake-ups.
    pub shared: Arc<Shared>,
    /// The bodies' newest poses.
    pub bodies: Arc<Bodies>,
    /// Where frames are counted.
    pub stats: Arc<Stats>,
    /// Makes revisions; the frame thread uses it only when nobody else does.
    pub editor: Arc<Mutex<Editor>>,
}

/// Why the frame thread ended.
pub type Ended = Result<(), RenderError>;

/// Starts the thread. The receiver hears once, when the first frame stands or cannot.
///
/// # Errors
/// When the system has no thread to give.
pub fn start(
    device: Arc<Device>,
    setup: Setup,
    links: Links,
    frames: Option<u64>,
) -> std::io::Result<(JoinHandle<Ended>, Receiver<Result<(), String>>)> {
    let (first, ready) = sync_channel(1);
    let thread = std::thread::Builder::new().name("frames".into()).spawn(move || {
        let ended = FrameThread::new(device, setup, links, frames).and_then(|mut t| t.run(&first));
        if let Err(error) = &ended {
            let _ = first.try_send(Err(error.to_string()));
        }
        ended
    })?;
    Ok((thread, ready))
}

struct FrameThread {
    device: Arc<Device>,
    renderer: Renderer,
    links: Links,
    /// The clock of the fastest projector: all projectors of a frame share one.
    clock: Headless,
    /// Stop when every projector has shown so many.
    frames: Option<u64>,
    /// Frames of the whole set so far.
    frame: u64,
}

fn clock_of(refresh_hz: &[f64]) -> Headless {
    Headless::new(refresh_hz.iter().copied().fold(1.0, f64::max), Instant::now())
}

impl FrameThread {
    fn new(device: Arc<Device>, setup: Setup, links: Links, frames: Option<u64>) -> Result<Self, RenderError> {
        let clock = clock_of(&setup.refresh_hz);
        let renderer = Renderer::new(&device, setup.projectors, setup.settings, setup.scene)?;
        links.stats.set_projectors(renderer.projectors().map(|p| p.name.as_str()));
        Ok(Self { device, renderer, links, clock, frames, frame: 0 })
    }

    fn run(&mut self, first: &SyncSender<Result<(), String>>) -> Ended {
        loop {
            // Asleep until something changes; where frames are counted, until the next refresh at the latest.
            let until = self.frames.map(|_| self.clock.next_refresh(Instant::now()));
            let turn = self.links.shared.wait(until);
            if turn.stop {
                return Ok(());
            }
            self.turn(turn)?;
            let _ = first.try_send(Ok(()));
            if self.frames.is_some_and(|n| self.links.stats.fewest_frames() >= n) {
                return Ok(());
            }
        }
    }

    /// One frame, where anything is stale, and then the requests.
    fn turn(&mut self, turn: Turn) -> Ended {
        let began = Instant::now();
        let scene = self.place_bodies().unwrap_or(turn.scene);
        self.renderer.set_scene(scene);
        let revision = self.renderer.scene().revision;
        match self.render() {
            Ok(Some(report)) => {
                self.frame += 1;
                self.count(&report, began);
                self.links.shared.shown(revision, Ok(self.frame));

                // No picture stands for less than a refresh.
                self.links.shared.pause(self.clock.next_refresh(began));
            }
            Ok(None) => {
                let counts = self.frames.is_some();
                for projector in self.renderer.projectors() {
                    self.links.stats.unchanged(&projector.name, revision, counts);
                }
                self.links.shared.shown(revision, Ok(self.frame));
            }
            Err(error) => {
                self.links.shared.shown(revision, Err(error.to_string()));
                return Err(error);
            }
        }
        for request in turn.requests {
            self.serve(request)?;
        }
        Ok(())
    }

    fn render(&mut self) -> Result<Option<FrameReport>, RenderError> {
        self.renderer.render(|| eyes(&self.links.bodies))
    }

    /// Moves the nodes that bodies drive. An edit in the making has the editor; then the node follows a frame later.
    fn place_bodies(&self) -> Option<Arc<Scene>> {
        let placed: Vec<_> = (self.links.bodies.driven().into_iter())
            .filter_map(|(drives, pose)| match drives {
                Drives::Node(node) => Some((node, pose)),
                Drives::Viewer => None,
            })
            .collect();
        if placed.is_empty() {
            return None;
        }
        let mut editor = match self.links.editor.try_lock() {
            Ok(editor) => editor,
            Err(std::sync::TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(std::sync::TryLockError::WouldBlock) => {
                self.links.shared.stir();
                return None;
            }
        };
        for (node, pose) in &placed {
            // A node that a client has removed is nobody's to move.
            if let Err(error) = editor.place(node, pose.driven_m(), pose.orientation) {
                tracing::trace!(node, %error, "the body drives nothing");
            }
        }
        let scene = editor.current();
        drop(editor);
        drop(self.links.shared.publish(scene.clone()));
        Some(scene)
    }

    fn count(&self, report: &FrameReport, began: Instant) {
        // Refreshes that passed while the frame was made, but for the one that it was made for.
        let passed = self.clock.refreshes(Instant::now()) - self.clock.refreshes(began);
        let names: Vec<_> = self.renderer.projectors().map(|p| p.name.clone()).collect();
        for projector in &report.projectors {
            let missed = passed.saturating_sub(1);
            self.links.stats.rendered(&names[projector.projector], projector, self.frame, report.revision, missed);
        }
        tracing::trace!(frame = self.frame, revision = report.revision, "frame");
    }

    fn serve(&mut self, request: Request) -> Ended {
        // Whoever asked may have gone.
        match request {
            Request::Read { projector, layer, reply } => {
                let _ = reply.send(self.renderer.read(projector, layer).map_err(|e| e.to_string()));
            }
            Request::Room { reply } => {
                let size_px = self.renderer.projectors().next().map(|p| p.calibration.resolution_px().to_array());
                let eye = eyes(&self.links.bodies).first().copied();
                let room = match (eye, size_px) {
                    (Some(eye), Some(size_px)) => self.renderer.room(eye, size_px).map_err(|e| e.to_string()),
                    _ => Err("no body drives the viewer, so nobody sees the room".into()),
                };
                let _ = reply.send(room);
            }
            Request::Reconfigure { setup, reply } => {
                let _ = reply.send(self.reconfigure(*setup).map_err(|e| e.to_string()));
                // The new projectors show something before anybody asks for it.
                self.links.shared.stir();
            }
        }
        Ok(())
    }

    /// Takes another setup, or keeps the old one where the new one cannot be made.
    fn reconfigure(&mut self, setup: Setup) -> Result<(), RenderError> {
        self.renderer = Renderer::new(&self.device, setup.projectors, setup.settings, setup.scene)?;
        self.links.stats.set_projectors(self.renderer.projectors().map(|p| p.name.as_str()));
        self.clock = clock_of(&setup.refresh_hz);
        Ok(())
    }
}

/// Where the eyes are now, world frame, m.
fn eyes(bodies: &Bodies) -> Vec<DVec3> {
    let driven = bodies.driven().into_iter();
    driven.filter(|(drives, _)| *drives == Drives::Viewer).map(|(_, pose)| pose.driven_m()).collect()
}

/// Locks the editor; what a panicking edit left is the last published revision.
pub fn lock_editor(editor: &Mutex<Editor>) -> std::sync::MutexGuard<'_, Editor> {
    editor.lock().unwrap_or_else(PoisonError::into_inner)
}
