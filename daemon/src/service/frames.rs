//! The frame thread: it alone talks to the device, sleeps while nothing changes, and shows one snapshot on all projectors.

use std::collections::{BTreeMap, VecDeque};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use glam::DVec3;
use lantern_gpu::Device;
use lantern_proto::EventKind;
use lantern_proto::event::{Event, FrameEvent, SceneEvent};
use lantern_render::{ProjectorSpec, RenderError, Renderer, Settings};
use lantern_scene::{Editor, Scene};
use lantern_tracking::Bodies;

use super::carried::Carried;
use super::hardware::Hardware;
use super::ledger::{Ledger, shown_poses};
use super::monotonic;
use super::recovery::Attempts;
use super::refusal::{Refusal, is_loss};
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
    /// What the device is.
    pub hardware: Arc<Hardware>,
    /// How old the poses of frames were.
    pub ledger: Arc<Ledger>,
    /// Who wants to hear of frames and revisions.
    pub events: Arc<Events>,
    /// Makes revisions; the frame thread uses it only when nobody else does.
    pub editor: Arc<Mutex<Editor>>,
}

/// What ends the frame thread before it is told to.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// The first frame cannot be made.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The device was lost, and cannot be had again.
    #[error("{loss}, and {attempts} attempts to open the device again have failed; the last one: {last}")]
    GaveUp {
        /// How many there were.
        attempts: u32,
        /// What the loss looked like.
        loss: String,
        /// Why the last attempt failed.
        last: String,
    },
}

/// How the frame thread ended.
pub type Ended = Result<(), FrameError>;

/// Opens the device: the first time, and whenever it was lost.
pub type Open = Box<dyn Fn() -> anyhow::Result<Arc<Device>> + Send>;

/// Hears once, when the first frame stands or cannot.
pub type FirstFrame = Receiver<Result<(), String>>;

/// Starts the thread on an open device, and with the means to open it again.
///
/// # Errors
/// When the system has no thread to give.
pub fn start(
    (device, open): (Arc<Device>, Open),
    setup: Setup,
    links: Links,
    frames: Option<u64>,
) -> std::io::Result<(JoinHandle<Ended>, FirstFrame)> {
    let (first, ready) = sync_channel(1);
    let thread = std::thread::Builder::new().name("frames".into()).spawn(move || {
        let shared = links.shared.clone();
        let ended = work((device, open), setup, links, frames, &first);
        // However it ended, nobody is to wait for it.
        shared.stop();
        if let Err(error) = &ended {
            let _ = first.try_send(Err(error.to_string()));
        }
        ended
    })?;
    Ok((thread, ready))
}

/// Shows frames until it is told to stop, on one device after the other where they are lost.
fn work(
    on: (Arc<Device>, Open),
    setup: Setup,
    links: Links,
    frames: Option<u64>,
    first: &SyncSender<Result<(), String>>,
) -> Ended {
    let mut thread = FrameThread::new(on, setup, links, frames)?;
    loop {
        match thread.run(first) {
            // What cannot be shown at all is for whoever starts the daemon to hear.
            Err(error) if thread.frame > 0 => match thread.recover(&error)? {
                Some(again) => thread = again,
                None => return Ok(()),
            },
            ended => return Ok(ended?),
        }
    }
}

/// What the thread has.
pub(super) struct FrameThread {
    pub(super) device: Arc<Device>,
    pub(super) renderer: Renderer,
    pub(super) open: Open,
    pub(super) attempts: Attempts,
    pub(super) links: Links,
    /// The clock of the fastest projector: all projectors of a frame share one.
    pub(super) clock: Headless,
    /// How frames see the bodies.
    pub(super) sight: Sight,
    pub(super) carried: Carried,
    /// The scene that is shown; the renderer's may be on its way.
    pub(super) shown: Arc<Scene>,
    /// A revision that cannot be shown, while it is the newest.
    pub(super) refused: Option<u64>,
    /// What was asked and is not answered yet.
    pub(super) requests: VecDeque<Request>,
    /// Stop when every projector has shown so many.
    pub(super) frames: Option<u64>,
    /// Frames of the whole set so far.
    pub(super) frame: u64,
    /// The last refresh that counted as a picture that stayed.
    pub(super) counted_refresh: u64,
    /// The last revision that subscribers were told of.
    pub(super) told_revision: u64,
    /// What is brought to the device ahead of revisions made of it.
    pub(super) prepared: Vec<Prepared>,
    pub(super) watchdog: Watchdog,
}

/// A scene that is to be on the device before a revision is made of it.
pub(super) struct Prepared {
    pub(super) scene: Arc<Scene>,
    pub(super) lease: Weak<Lease>,
    /// Who waits for it; nobody once it is there.
    pub(super) reply: Option<SyncSender<Result<(), Refusal>>>,
}

pub(super) fn clock_of(refresh_hz: &[f64]) -> Headless {
    Headless::new(refresh_hz.iter().copied().fold(1.0, f64::max), Instant::now())
}

impl FrameThread {
    fn new(
        (device, open): (Arc<Device>, Open),
        setup: Setup,
        links: Links,
        frames: Option<u64>,
    ) -> Result<Self, RenderError> {
        links.hardware.opened(&device);
        let (clock, sight) = (clock_of(&setup.refresh_hz), Sight::new(links.bodies.clone(), setup.output_latency));
        let carried = Carried::new(setup.projectors.clone(), setup.homes_m);
        let shown = setup.scene.clone();
        let renderer = Renderer::new(&device, setup.projectors, setup.settings, setup.scene)?;
        links.stats.set_projectors(&renderer);
        Ok(Self {
            device,
            renderer,
            open,
            attempts: Attempts::default(),
            links,
            clock,
            sight,
            carried,
            shown,
            refused: None,
            requests: VecDeque::new(),
            frames,
            frame: 0,
            counted_refresh: 0,
            told_revision: 0,
            prepared: Vec::new(),
            watchdog: Watchdog::from_environment(),
        })
    }

    fn run(&mut self, first: &SyncSender<Result<(), String>>) -> Result<(), RenderError> {
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
    fn turn(&mut self, turn: Turn) -> Result<(), RenderError> {
        let began = Instant::now();
        self.requests.extend(turn.requests);
        let moved = self.sight.place_nodes(&self.links.editor, began);
        if let Some(scene) = &moved {
            self.links.shared.publish_shown(scene);
        }
        if self.carried.any() {
            self.renderer.set_projectors(self.carried.at(self.sight.carrying(began)))?;
        } else {
            self.sight.carry_nothing();
        }
        let mut scene = moved.unwrap_or(turn.scene);
        if self.refused == Some(scene.revision) {
            scene = self.shown.clone();
        }
        self.renderer.set_scene(scene.clone());
        let rendered = match self.show(began) {
            Ok(rendered) => {
                // Perhaps still the one before: then whoever waits for this one goes on doing so.
                self.links.shared.shown(self.renderer.scene().revision, Ok(self.frame));
                self.tell_of_revision();
                rendered
            }
            Err(error) if is_loss(&error) || self.frame == 0 => return Err(error),
            Err(error) => {
                self.keep_what_is_shown(&scene, &error)?;
                self.show(began)?
            }
        };
        self.attend_to_prepared()?;
        while let Some(request) = self.requests.pop_front() {
            self.serve(request)?;
            // Each may take seconds, and all of them longer than the watchdog waits.
            self.watchdog.feed(Instant::now());
        }

        // No picture stands for less than a refresh.
        if rendered {
            self.links.shared.pause(self.clock.next_refresh(began));
        }
        Ok(())
    }

    /// A scene that the device cannot take is its client's to hear of; what was shown before it stays.
    fn keep_what_is_shown(&mut self, scene: &Arc<Scene>, error: &RenderError) -> Result<(), RenderError> {
        let revision = scene.revision;
        tracing::warn!(revision, %error, "this revision cannot be shown; the one before stays");
        if revision != self.shown.revision {
            let refusal = Refusal::of_scene(error, &self.shown, scene, &self.device);
            self.refuse_revision(revision, refusal);
        }
        self.renderer.set_scene(self.shown.clone());
        for prepared in self.prepared.drain(..) {
            let refusal = || Refusal::of_scene(error, &self.shown, &prepared.scene, &self.device);
            if let Some(reply) = &prepared.reply {
                let _ = reply.send(Err(refusal()));
            }
        }
        self.renderer.prepare(Vec::new())
    }

    /// Whoever made a revision hears that it is not shown, and takes it back; until then it is passed over. One that bodies have made
    /// nobody takes back, and it is tried again.
    fn refuse_revision(&mut self, revision: u64, refusal: Refusal) {
        if self.links.shared.shown(revision, Err(refusal)) {
            self.refused = Some(revision);
        }
    }

    /// Answers for what has come to the device, and lets go of what nobody needs there any more.
    fn attend_to_prepared(&mut self) -> Result<(), RenderError> {
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
    pub(super) fn show(&mut self, began: Instant) -> Result<bool, RenderError> {
        let frame = self.sight.render(&mut self.renderer, began)?;
        self.shown = self.renderer.scene().clone();
        if let Some(frame) = &frame {
            self.attempts.showed();
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

    pub(super) fn count(&mut self, frame: &Frame, began: Instant) {
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
    pub(super) fn tell_of_revision(&mut self) {
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
}

/// Locks the editor; what a panicking edit left is the last published revision.
pub fn lock_editor(editor: &Mutex<Editor>) -> std::sync::MutexGuard<'_, Editor> {
    editor.lock().unwrap_or_else(PoisonError::into_inner)
}
