//! The frame thread: it alone talks to the device, sleeps while nothing changes, and shows one snapshot on all projectors.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::Instant;

use glam::DVec3;
use lantern_config::Drives;
use lantern_gpu::Device;
use lantern_render::{FrameReport, Pattern, ProjectorSpec, RenderError, Renderer, Settings};
use lantern_scene::{Editor, Place, Scene};
use lantern_tracking::Bodies;

use super::shared::{Lease, Request, Shared, Turn};
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

/// Hears once, when the first frame stands or cannot.
pub type FirstFrame = Receiver<Result<(), String>>;

/// Starts the thread.
///
/// # Errors
/// When the system has no thread to give.
pub fn start(
    device: Arc<Device>,
    setup: Setup,
    links: Links,
    frames: Option<u64>,
) -> std::io::Result<(JoinHandle<Ended>, FirstFrame)> {
    let (first, ready) = sync_channel(1);
    let thread = std::thread::Builder::new().name("frames".into()).spawn(move || {
        let shared = links.shared.clone();
        let ended = FrameThread::new(device, setup, links, frames).and_then(|mut t| t.run(&first));
        // However it ended, nobody is to wait for it.
        shared.stop();
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
    /// The last refresh that counted as a picture that stayed.
    counted_refresh: u64,
    /// Whether bodies have yet to move their nodes, because an edit in the making has the editor.
    behind: bool,
    /// What is brought to the device ahead of revisions made of it.
    prepared: Vec<Prepared>,
}

/// A scene that is to be on the device before a revision is made of it.
struct Prepared {
    scene: Arc<Scene>,
    lease: Weak<Lease>,
    /// Who waits for it; nobody once it is there.
    reply: Option<SyncSender<Result<(), String>>>,
}

fn clock_of(refresh_hz: &[f64]) -> Headless {
    Headless::new(refresh_hz.iter().copied().fold(1.0, f64::max), Instant::now())
}

impl FrameThread {
    fn new(device: Arc<Device>, setup: Setup, links: Links, frames: Option<u64>) -> Result<Self, RenderError> {
        let clock = clock_of(&setup.refresh_hz);
        let renderer = Renderer::new(&device, setup.projectors, setup.settings, setup.scene)?;
        links.stats.set_projectors(&renderer);
        Ok(Self {
            device,
            renderer,
            links,
            clock,
            frames,
            frame: 0,
            counted_refresh: 0,
            behind: false,
            prepared: Vec::new(),
        })
    }

    fn run(&mut self, first: &SyncSender<Result<(), String>>) -> Ended {
        loop {
            // Asleep until something changes; where frames are counted, or a node has yet to follow its body, until the next
            // refresh at the latest; and not at all while something is on its way to the device.
            let wakes = self.frames.is_some() || self.behind;
            let until = if self.renderer.is_uploading() {
                Some(Instant::now())
            } else {
                wakes.then(|| self.clock.next_refresh(Instant::now()))
            };
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
        let scene = self.place_bodies().unwrap_or(turn.scene);
        let revision = scene.revision;
        let before = self.renderer.scene().clone();
        self.renderer.set_scene(scene);
        let began = Instant::now();
        let rendered = match self.show() {
            Ok(rendered) => {
                // Perhaps still the one before: then whoever waits for this one goes on doing so.
                self.links.shared.shown(self.renderer.scene().revision, Ok(self.frame));
                rendered
            }
            Err(error) => {
                // A scene that the device cannot take is its client's to hear of; what was shown before it stays.
                self.links.shared.shown(revision, Err(error.to_string()));
                if is_fatal(&error) || self.frame == 0 {
                    return Err(error);
                }
                tracing::warn!(revision, %error, "this revision cannot be shown; the one before stays");
                self.renderer.set_scene(before);
                for prepared in self.prepared.drain(..).filter_map(|prepared| prepared.reply) {
                    let _ = prepared.send(Err(error.to_string()));
                }
                self.renderer.prepare(Vec::new())?;
                self.show()?
            }
        };
        self.attend_to_prepared()?;
        for request in turn.requests {
            self.serve(request);
        }

        // No picture stands for less than a refresh.
        if rendered {
            self.links.shared.pause(self.clock.next_refresh(began));
        }
        Ok(())
    }

    /// Answers for what has come to the device, and lets go of what nobody needs there any more.
    fn attend_to_prepared(&mut self) -> Ended {
        for prepared in &mut self.prepared {
            if let Some(reply) = prepared.reply.take_if(|_| self.renderer.is_prepared(&prepared.scene)) {
                let _ = reply.send(Ok(()));
            }
        }
        let before = self.prepared.len();
        self.prepared.retain(|prepared| prepared.lease.strong_count() > 0);
        if self.prepared.len() < before {
            self.renderer.prepare(self.prepared.iter().map(|prepared| prepared.scene.clone()).collect())?;
        }
        Ok(())
    }

    /// Renders what is stale, and counts it; false where nothing was.
    fn show(&mut self) -> Result<bool, RenderError> {
        let began = Instant::now();
        let report = self.renderer.render(|| eyes(&self.links.bodies))?;
        if let Some(report) = &report {
            self.frame += 1;
            self.count(report, began);
        } else {
            // A picture that stays counts as shown once a refresh, however often the thread is woken meanwhile.
            let refresh = self.clock.refreshes(began);
            let counts = self.frames.is_some() && refresh > self.counted_refresh;
            self.counted_refresh = self.counted_refresh.max(refresh);
            self.links.stats.unchanged(self.renderer.scene().revision, counts);
        }
        Ok(report.is_some())
    }

    /// Moves the nodes that bodies drive, and gives the revision in which they stand there. Where an edit in the making has the
    /// editor, the nodes follow at a later refresh.
    fn place_bodies(&mut self) -> Option<Arc<Scene>> {
        let placed: Vec<_> = (self.links.bodies.driven().into_iter())
            .filter_map(|(drives, pose)| match drives {
                Drives::Node(node) => Some((node, pose)),
                Drives::Viewer => None,
            })
            .collect();
        self.behind = false;
        if placed.is_empty() {
            return None;
        }
        let mut editor = match self.links.editor.try_lock() {
            Ok(editor) => editor,
            Err(std::sync::TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(std::sync::TryLockError::WouldBlock) => {
                self.behind = true;
                return None;
            }
        };
        let places: Vec<_> = (placed.iter())
            .map(|(node, pose)| Place { node, translation_m: pose.driven_m(), rotation: pose.orientation })
            .collect();
        let scene = editor.place_all(&places);
        drop(editor);
        self.links.shared.publish_shown(&scene);
        Some(scene)
    }

    fn count(&self, report: &FrameReport, began: Instant) {
        // Refreshes that passed while the frame was made, but for the one that it was made for.
        let passed = self.clock.refreshes(Instant::now()).saturating_sub(self.clock.refreshes(began));
        let names: Vec<_> = self.renderer.projectors().map(|p| p.name.as_str()).collect();
        let reports: Vec<_> = report.projectors.iter().map(|p| (names[p.projector], p)).collect();
        self.links.stats.rendered(&reports, self.frame, report.revision, passed.saturating_sub(1));
        tracing::trace!(frame = self.frame, revision = report.revision, "frame");
    }

    fn serve(&mut self, request: Request) {
        // Whoever asked may have gone.
        match request {
            Request::Read { projector, layer, reply } => {
                let index = self.renderer.projectors().position(|p| p.name == projector);
                let _ = reply.send(match index {
                    Some(index) => self.renderer.read(index, layer).map_err(|e| e.to_string()),
                    None => Err(format!("the projector `{projector}` has gone")),
                });
            }
            Request::Room { projector, reply } => {
                let of = self.renderer.projectors().find(|p| p.name == projector);
                let size_px = of.map(|p| p.calibration.resolution_px().to_array());
                let room = match (eyes(&self.links.bodies).first(), size_px) {
                    (Some(eye), Some(size_px)) => self.renderer.room(*eye, size_px).map_err(|e| e.to_string()),
                    (None, _) => Err("no body drives the viewer any more".into()),
                    (_, None) => Err(format!("the projector `{projector}` has gone")),
                };
                let _ = reply.send(room);
            }
            Request::Pattern { projector, pattern, reply } => {
                let _ = reply.send(self.set_pattern(projector.as_deref(), pattern).map_err(|e| e.to_string()));
            }
            Request::Prepare { scene, lease, reply } => {
                let others = self.prepared.iter().map(|prepared| prepared.scene.clone());
                match self.renderer.prepare(others.chain([scene.clone()]).collect()) {
                    Ok(()) => self.prepared.push(Prepared { scene, lease, reply: Some(reply) }),
                    Err(error) => drop(reply.send(Err(error.to_string()))),
                }
            }
            Request::Reconfigure { setup, reply } => {
                let _ = reply.send(self.reconfigure(*setup).map_err(|e| e.to_string()));
            }
        }
    }

    /// Shows a pattern on one projector, or on all.
    fn set_pattern(&mut self, projector: Option<&str>, pattern: Pattern) -> Ended {
        let names: Vec<_> = self.renderer.projectors().map(|p| p.name.clone()).collect();
        for (index, name) in names.iter().enumerate() {
            if projector.is_none_or(|wanted| wanted == name) {
                self.renderer.set_pattern(index, pattern)?;
            }
        }
        self.show().map(drop)
    }

    /// Takes another setup and shows it, or keeps the old one where the new one cannot be made or shown.
    fn reconfigure(&mut self, setup: Setup) -> Ended {
        let began = Instant::now();
        let report = if setup.settings == *self.renderer.settings() {
            let before = (self.renderer.projectors().cloned().collect(), self.renderer.scene().clone());
            let taken = self.take(setup.projectors, setup.scene);
            if taken.as_ref().is_err_and(|error| !is_fatal(error)) {
                self.take(before.0, before.1)?;
            }
            taken?
        } else {
            let mut renderer = Renderer::new(&self.device, setup.projectors, setup.settings, setup.scene)?;
            let report = renderer.render(|| eyes(&self.links.bodies))?;
            self.renderer = renderer;
            // What was brought to the device for others has gone with the old one.
            self.renderer.prepare(self.prepared.iter().map(|prepared| prepared.scene.clone()).collect())?;
            report
        };
        self.links.shared.publish_shown(self.renderer.scene());
        self.links.stats.set_projectors(&self.renderer);
        self.clock = clock_of(&setup.refresh_hz);
        self.counted_refresh = 0;
        if let Some(report) = report {
            self.frame += 1;
            self.count(&report, began);
        }
        Ok(())
    }

    /// Shows a scene on these projectors.
    fn take(&mut self, projectors: Vec<ProjectorSpec>, scene: Arc<Scene>) -> Result<Option<FrameReport>, RenderError> {
        self.renderer.set_projectors(projectors)?;
        self.renderer.set_scene(scene);
        let mut report = self.renderer.render(|| eyes(&self.links.bodies))?;
        while self.renderer.is_pending() {
            report = self.renderer.render(|| eyes(&self.links.bodies))?.or(report);
        }
        Ok(report)
    }
}

/// Whether nothing can be shown any more, whatever the scene.
fn is_fatal(error: &RenderError) -> bool {
    use lantern_gpu::GpuError::{DeviceLost, Timeout};
    matches!(error, RenderError::Gpu(DeviceLost { .. } | Timeout { .. }))
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
