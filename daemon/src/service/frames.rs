//! The frame thread: it alone talks to the device, sleeps while nothing changes, and shows one snapshot on all projectors.

use std::cell::RefCell;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use glam::DVec3;
use lantern_config::Drives;
use lantern_gpu::Device;
use lantern_render::{FrameReport, Pattern, ProjectorSpec, RenderError, Renderer, Settings};
use lantern_scene::{Editor, Place, Scene};
use lantern_tracking::{Bodies, Placed};

use super::lead::Lead;
use super::shared::{Lease, Request, Shared, Turn};
use super::stats::Stats;
use crate::output::Headless;

/// What the frame thread renders, and for whom.
pub struct Setup {
    /// The projectors, in order.
    pub projectors: Vec<ProjectorSpec>,
    /// Refreshes a second of each.
    pub refresh_hz: Vec<f64>,
    /// From the completion of a frame to its light, where that takes longest.
    pub output_latency: Duration,
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
    /// When the light of frames leaves.
    lead: Lead,
    /// Stop when every projector has shown so many.
    frames: Option<u64>,
    /// Frames of the whole set so far.
    frame: u64,
    /// The last refresh that counted as a picture that stayed.
    counted_refresh: u64,
    /// Whether bodies have yet to move their nodes, because an edit in the making has the editor.
    behind: bool,
    /// Whether a body was predicted to move on by itself when that was last asked.
    moving: bool,
    /// What is brought to the device ahead of revisions made of it.
    prepared: Vec<Prepared>,
}

/// A frame that was rendered.
struct Frame {
    report: FrameReport,
    /// The bodies as they were read for it.
    placed: Vec<Placed>,
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
        let (clock, lead) = (clock_of(&setup.refresh_hz), Lead::new(setup.output_latency));
        let renderer = Renderer::new(&device, setup.projectors, setup.settings, setup.scene)?;
        links.stats.set_projectors(&renderer);
        Ok(Self {
            device,
            renderer,
            links,
            clock,
            lead,
            frames,
            frame: 0,
            counted_refresh: 0,
            behind: false,
            moving: false,
            prepared: Vec::new(),
        })
    }

    fn run(&mut self, first: &SyncSender<Result<(), String>>) -> Ended {
        loop {
            // Asleep until something changes; where frames are counted, a node has yet to follow its body, or a body is predicted
            // to move on, until the next refresh at the latest; and not at all while something is on its way to the device.
            let now = Instant::now();
            let wakes = self.frames.is_some() || self.behind || self.is_moving(now);
            let until =
                if self.renderer.is_uploading() { Some(now) } else { wakes.then(|| self.clock.next_refresh(now)) };
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
        let scene = self.place_bodies(began).unwrap_or(turn.scene);
        let revision = scene.revision;
        let before = self.renderer.scene().clone();
        self.renderer.set_scene(scene);
        let rendered = match self.show(began) {
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
                self.show(began)?
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
    fn show(&mut self, began: Instant) -> Result<bool, RenderError> {
        let frame = render(&mut self.renderer, &self.links.bodies, &self.lead)?;
        if let Some(frame) = &frame {
            self.count(frame, began);
        } else {
            // A picture that stays counts as shown once a refresh, however often the thread is woken meanwhile.
            let refresh = self.clock.refreshes(began);
            let counts = self.frames.is_some() && refresh > self.counted_refresh;
            self.counted_refresh = self.counted_refresh.max(refresh);
            self.links.stats.unchanged(self.renderer.scene().revision, counts);
        }
        Ok(frame.is_some())
    }

    /// Whether a body is predicted to move on by itself. Once none is, one more frame shows where they rest.
    fn is_moving(&mut self, now: Instant) -> bool {
        let before = std::mem::replace(&mut self.moving, self.links.bodies.are_moving(now));
        before || self.moving
    }

    /// Moves the nodes that bodies drive, and gives the revision in which they stand there. Where an edit in the making has the
    /// editor, the nodes follow at a later refresh.
    fn place_bodies(&mut self, began: Instant) -> Option<Arc<Scene>> {
        let mut placed = self.links.bodies.placed(self.lead.light_of_frame(began), began);
        placed.retain(|placed| place(placed).is_some());
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
        let places: Vec<_> = placed.iter().filter_map(place).collect();
        let scene = editor.place_all(&places);
        drop(editor);
        self.links.shared.publish_shown(&scene);
        Some(scene)
    }

    fn count(&mut self, frame: &Frame, began: Instant) {
        let report = &frame.report;
        self.frame += 1;
        if let Some(completed) = report.projectors.iter().map(|p| p.completed).max() {
            self.lead.completed(began, report.read, completed);
        }
        // Refreshes that passed while the frame was made, but for the one that it was made for.
        let passed = self.clock.refreshes(Instant::now()).saturating_sub(self.clock.refreshes(began));
        let names: Vec<_> = self.renderer.projectors().map(|p| p.name.as_str()).collect();
        let reports: Vec<_> = report.projectors.iter().map(|p| (names[p.projector], p)).collect();
        self.links.stats.rendered(&reports, self.frame, report.revision, passed.saturating_sub(1));
        tracing::trace!(frame = self.frame, revision = report.revision, poses = ?frame.placed, "frame");
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
                let room = match (eyes(&look(&self.links.bodies, &self.lead)).first(), size_px) {
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
        self.show(Instant::now()).map(drop)
    }

    /// Takes another setup and shows it, or keeps the old one where the new one cannot be made or shown.
    fn reconfigure(&mut self, setup: Setup) -> Ended {
        let began = Instant::now();
        self.lead.set_output_latency(setup.output_latency);
        let frame = if setup.settings == *self.renderer.settings() {
            let before = (self.renderer.projectors().cloned().collect(), self.renderer.scene().clone());
            let taken = self.take(setup.projectors, setup.scene);
            if taken.as_ref().is_err_and(|error| !is_fatal(error)) {
                self.take(before.0, before.1)?;
            }
            taken?
        } else {
            let mut renderer = Renderer::new(&self.device, setup.projectors, setup.settings, setup.scene)?;
            let frame = render(&mut renderer, &self.links.bodies, &self.lead)?;
            self.renderer = renderer;
            // What was brought to the device for others has gone with the old one.
            self.renderer.prepare(self.prepared.iter().map(|prepared| prepared.scene.clone()).collect())?;
            frame
        };
        self.links.shared.publish_shown(self.renderer.scene());
        self.links.stats.set_projectors(&self.renderer);
        self.clock = clock_of(&setup.refresh_hz);
        self.counted_refresh = 0;
        if let Some(frame) = frame {
            self.count(&frame, began);
        }
        Ok(())
    }

    /// Shows a scene on these projectors.
    fn take(&mut self, projectors: Vec<ProjectorSpec>, scene: Arc<Scene>) -> Result<Option<Frame>, RenderError> {
        self.renderer.set_projectors(projectors)?;
        self.renderer.set_scene(scene);
        let mut frame = render(&mut self.renderer, &self.links.bodies, &self.lead)?;
        while self.renderer.is_pending() {
            frame = render(&mut self.renderer, &self.links.bodies, &self.lead)?.or(frame);
        }
        Ok(frame)
    }
}

/// Whether nothing can be shown any more, whatever the scene.
fn is_fatal(error: &RenderError) -> bool {
    use lantern_gpu::GpuError::{DeviceLost, Timeout};
    matches!(error, RenderError::Gpu(DeviceLost { .. } | Timeout { .. }))
}

/// Renders what is stale for the bodies as they will be when its light leaves.
fn render(renderer: &mut Renderer, bodies: &Bodies, lead: &Lead) -> Result<Option<Frame>, RenderError> {
    // The renderer looks twice, and shows what it sees last.
    let seen = RefCell::default();
    let report = renderer.render(|| {
        let placed = look(bodies, lead);
        let eyes = eyes(&placed);
        *seen.borrow_mut() = placed;
        eyes
    })?;
    Ok(report.map(|report| Frame { report, placed: seen.into_inner() }))
}

/// Where a body holds its node, if it drives one.
fn place(placed: &Placed) -> Option<Place<'_>> {
    match &placed.drives {
        Drives::Node(node) => {
            Some(Place { node, translation_m: placed.pose.driven_m(), rotation: placed.pose.orientation })
        }
        Drives::Viewer => None,
    }
}

/// The bodies as they will be when the light of what is submitted now leaves.
fn look(bodies: &Bodies, lead: &Lead) -> Vec<Placed> {
    let now = Instant::now();
    bodies.placed(lead.light_of_submission(now), now)
}

/// Where the eyes are, world frame, m.
fn eyes(placed: &[Placed]) -> Vec<DVec3> {
    let viewers = placed.iter().filter(|placed| placed.drives == Drives::Viewer);
    viewers.map(|placed| placed.pose.driven_m()).collect()
}

/// Locks the editor; what a panicking edit left is the last published revision.
pub fn lock_editor(editor: &Mutex<Editor>) -> std::sync::MutexGuard<'_, Editor> {
    editor.lock().unwrap_or_else(PoisonError::into_inner)
}
