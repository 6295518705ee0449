//! The frame thread: it alone talks to the device, sleeps while nothing changes, and shows one snapshot on all projectors.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use glam::DVec3;
use lantern_gpu::Device;
use lantern_proto::EventKind;
use lantern_proto::event::{Event, FrameEvent, SceneEvent};
use lantern_render::{Pattern, ProjectorSpec, RenderError, Renderer, Settings};
use lantern_scene::{Editor, Scene};
use lantern_tracking::Bodies;

use super::carried::Carried;
use super::ledger::{Ledger, shown_poses};
use super::monotonic;
use super::shared::{Lease, Request, Shared, Turn};
use super::sight::{Frame, Sight};
use super::stats::Stats;
use super::systemd::Watchdog;
use crate::control::Events;
use crate::output::Headless;

/// What the frame thread renders, and for whom.
pub struct Setup {
    /// The projectors, in order.
    pub projectors: Vec<ProjectorSpec>,
    /// Where the bodies stood that carry projectors, by projector, m.
    pub homes_m: BTreeMap<String, DVec3>,
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
    /// How old the poses of frames were.
    pub ledger: Arc<Ledger>,
    /// Who wants to hear of frames and revisions.
    pub events: Arc<Events>,
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
    /// How frames see the bodies.
    sight: Sight,
    carried: Carried,
    /// Stop when every projector has shown so many.
    frames: Option<u64>,
    /// Frames of the whole set so far.
    frame: u64,
    /// The last refresh that counted as a picture that stayed.
    counted_refresh: u64,
    /// The last revision that subscribers were told of.
    told_revision: u64,
    /// What is brought to the device ahead of revisions made of it.
    prepared: Vec<Prepared>,
    watchdog: Watchdog,
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
        let (clock, sight) = (clock_of(&setup.refresh_hz), Sight::new(links.bodies.clone(), setup.output_latency));
        let carried = Carried::new(setup.projectors.clone(), setup.homes_m);
        let renderer = Renderer::new(&device, setup.projectors, setup.settings, setup.scene)?;
        links.stats.set_projectors(&renderer);
        Ok(Self {
            device,
            renderer,
            links,
            clock,
            sight,
            carried,
            frames,
            frame: 0,
            counted_refresh: 0,
            told_revision: 0,
            prepared: Vec::new(),
            watchdog: Watchdog::from_environment(),
        })
    }

    fn run(&mut self, first: &SyncSender<Result<(), String>>) -> Ended {
        loop {
            // Asleep until something changes; where frames are counted or bodies go on moving, until the next refresh at the latest;
            // and not at all while something is on its way to the device. The watchdog wants to hear of it now and then all the same.
            let now = Instant::now();
            let wakes = self.sight.is_restless(now) || self.frames.is_some();
            let until =
                if self.renderer.is_uploading() { Some(now) } else { wakes.then(|| self.clock.next_refresh(now)) };
            let turn = self.links.shared.wait(until.into_iter().chain(self.watchdog.due()).min());
            if turn.stop {
                return Ok(());
            }
            self.turn(turn)?;
            self.watchdog.feed(Instant::now());
            let _ = first.try_send(Ok(()));
            if self.frames.is_some_and(|n| self.links.stats.fewest_frames() >= n) {
                return Ok(());
            }
        }
    }

    /// One frame, where anything is stale, and then the requests.
    fn turn(&mut self, turn: Turn) -> Ended {
        let began = Instant::now();
        let moved = self.sight.place_nodes(&self.links.editor, began);
        if let Some(scene) = &moved {
            self.links.shared.publish_shown(scene);
        }
        if self.carried.any() {
            self.renderer.set_projectors(self.carried.at(self.sight.carrying(began)))?;
        } else {
            self.sight.carry_nothing();
        }
        let scene = moved.unwrap_or(turn.scene);
        let revision = scene.revision;
        let before = self.renderer.scene().clone();
        self.renderer.set_scene(scene);
        let rendered = match self.show(began) {
            Ok(rendered) => {
                // Perhaps still the one before: then whoever waits for this one goes on doing so.
                self.links.shared.shown(self.renderer.scene().revision, Ok(self.frame));
                self.tell_of_revision();
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
            // Each may take seconds, and all of them longer than the watchdog waits.
            self.watchdog.feed(Instant::now());
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
        let frame = self.sight.render(&mut self.renderer, began)?;
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

    fn count(&mut self, frame: &Frame, began: Instant) {
        let report = &frame.report;
        self.frame += 1;
        // Refreshes that passed while the frame was made, but for the one that it was made for.
        let passed = self.clock.refreshes(Instant::now()).saturating_sub(self.clock.refreshes(began));
        let names: Vec<_> = self.renderer.projectors().map(|p| p.name.as_str()).collect();
        let reports: Vec<_> = report.projectors.iter().map(|p| (names[p.projector], p)).collect();
        let missed = passed.saturating_sub(1);
        self.links.stats.rendered(&reports, self.frame, report.revision, missed);
        for (projector, of) in reports {
            let poses = shown_poses(&frame.placed, report.submitted, of.completed);
            self.links.ledger.record(projector, &poses);
            self.tell(EventKind::Frame, || {
                Event::Frame(FrameEvent {
                    projector: projector.to_owned(),
                    frame: self.frame,
                    revision: report.revision,
                    missed,
                    frame_ms: of.frame_ms,
                    submitted_s: monotonic::seconds(report.submitted),
                    completed_s: monotonic::seconds(of.completed),
                    light_s: monotonic::seconds(frame.light),
                    poses,
                })
            });
        }
        tracing::trace!(frame = self.frame, revision = report.revision, "frame");
    }

    /// Tells of the revision that is shown, once of each.
    fn tell_of_revision(&mut self) {
        let scene = self.renderer.scene();
        let (revision, nodes) = (scene.revision, scene.nodes.len() as u64);
        if std::mem::replace(&mut self.told_revision, revision) != revision {
            self.tell(EventKind::Scene, || Event::Scene(SceneEvent { revision, frame: self.frame, nodes }));
        }
    }

    /// Tells subscribers, if there are any.
    fn tell(&self, kind: EventKind, event: impl FnOnce() -> Event) {
        if self.links.events.are_wanted(kind) {
            self.links.events.tell(kind, event());
        }
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
                let room = match (self.sight.eyes().first(), size_px) {
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
        let carried = Carried::new(setup.projectors, setup.homes_m);
        let projectors = carried.at(self.sight.carrying(began));
        let frame = if setup.settings == *self.renderer.settings() {
            let before = (self.renderer.projectors().cloned().collect(), self.renderer.scene().clone());
            let taken = self.take(projectors, setup.scene, began);
            if taken.as_ref().is_err_and(|error| !is_fatal(error)) {
                self.take(before.0, before.1, began)?;
            }
            taken?
        } else {
            let mut renderer = Renderer::new(&self.device, projectors, setup.settings, setup.scene)?;
            let frame = self.sight.render(&mut renderer, began)?;
            self.renderer = renderer;
            // What was brought to the device for others has gone with the old one.
            self.renderer.prepare(self.prepared.iter().map(|prepared| prepared.scene.clone()).collect())?;
            frame
        };
        self.carried = carried;
        self.sight.set_output_latency(setup.output_latency);
        self.links.shared.publish_shown(self.renderer.scene());
        self.links.stats.set_projectors(&self.renderer);
        self.clock = clock_of(&setup.refresh_hz);
        self.counted_refresh = 0;
        if let Some(frame) = frame {
            self.count(&frame, began);
        }
        self.tell_of_revision();
        Ok(())
    }

    /// Shows a scene on these projectors.
    fn take(
        &mut self,
        projectors: Vec<ProjectorSpec>,
        scene: Arc<Scene>,
        began: Instant,
    ) -> Result<Option<Frame>, RenderError> {
        self.renderer.set_projectors(projectors)?;
        self.renderer.set_scene(scene);
        let mut frame = self.sight.render(&mut self.renderer, began)?;
        while self.renderer.is_pending() {
            self.watchdog.feed(Instant::now());
            frame = self.sight.render(&mut self.renderer, began)?.or(frame);
        }
        Ok(frame)
    }
}

/// Whether nothing can be shown any more, whatever the scene.
fn is_fatal(error: &RenderError) -> bool {
    use lantern_gpu::GpuError::{DeviceLost, Timeout};
    matches!(error, RenderError::Gpu(DeviceLost { .. } | Timeout { .. }))
}

/// Locks the editor; what a panicking edit left is the last published revision.
pub fn lock_editor(editor: &Mutex<Editor>) -> std::sync::MutexGuard<'_, Editor> {
    editor.lock().unwrap_or_else(PoisonError::into_inner)
}
