//! The frame thread: it alone talks to the device, sleeps while nothing changes, and shows one snapshot on all projectors.

use std::collections::{BTreeMap, VecDeque};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::Instant;

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
use super::screens::Screens;
use super::shared::{Lease, Request, Shared, Turn};
use super::sight::{Frame, Sight};
use super::stats::Stats;
use super::systemd::Watchdog;
use crate::control::Events;
use crate::output::OutputSpec;

/// What the frame thread renders, and for whom.
pub struct Setup {
    /// The projectors, in order.
    pub projectors: Vec<ProjectorSpec>,
    /// Where the bodies stood that carry projectors, by projector, m.
    pub homes_m: BTreeMap<String, DVec3>,
    /// Where their images go, in the same order.
    pub outputs: Vec<OutputSpec>,
    /// Whether frames may be coarser rather than late; `None`: where anybody sees them.
    pub degrade: Option<bool>,
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
    /// Nothing can be shown.
    #[error("no output is there: {0}")]
    NoOutput(String),
    /// The device hangs with displays that no other process can have before this one ends, nor can this one again.
    #[error("{0}; its displays come back with another process")]
    Hangs(String),
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
            Err(FrameError::Render(error)) if thread.frame > 0 => match thread.recover(&error)? {
                Some(again) => thread = again,
                None => return Ok(()),
            },
            ended => return ended,
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
    /// Where the pictures go, and when frames begin.
    pub(super) screens: Screens,
    /// Whether the last turn rendered anything.
    pub(super) rendered: bool,
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
    /// When a picture that stayed was last counted.
    pub(super) counted: Option<Instant>,
    /// Whether the start is over.
    pub(super) is_ready: bool,
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

impl FrameThread {
    fn new(
        (device, open): (Arc<Device>, Open),
        setup: Setup,
        links: Links,
        frames: Option<u64>,
    ) -> Result<Self, RenderError> {
        links.hardware.opened(&device);
        let carried = Carried::new(setup.projectors.clone(), setup.homes_m);
        let shown = setup.scene.clone();
        let renderer = Renderer::new(&device, setup.projectors, setup.settings, setup.scene)?;
        links.stats.set_projectors(&renderer);
        let screens = Screens::open(&device, setup.outputs, setup.degrade, &renderer, &links.shared);
        let sight = Sight::new(links.bodies.clone(), screens.latency());
        Ok(Self {
            device,
            renderer,
            open,
            attempts: Attempts::default(),
            links,
            screens,
            rendered: false,
            sight,
            carried,
            shown,
            refused: None,
            requests: VecDeque::new(),
            frames,
            frame: 0,
            counted: None,
            is_ready: false,
            told_revision: 0,
            prepared: Vec::new(),
            watchdog: Watchdog::from_environment(),
        })
    }

    fn run(&mut self, first: &SyncSender<Result<(), String>>) -> Ended {
        let opened = Instant::now();
        loop {
            // Asleep until something changes; where frames are counted or bodies go on moving, until the next refresh at the latest;
            // and not at all while something is on its way to the device. The watchdog wants to hear of it now and then all the same.
            let now = Instant::now();
            let unfinished = self.renderer.is_behind() || self.renderer.is_coarse();
            let wakes = self.sight.is_restless(now) || self.frames.is_some() || unfinished;
            let refresh = || self.screens.clock().next_refresh(now);
            let until = if self.renderer.is_uploading() { Some(now) } else { wakes.then(refresh) };
            let looks = [until, self.screens.next_look(now), self.watchdog.due()];
            let turn = self.links.shared.wait(looks.into_iter().flatten().min());
            if turn.stop {
                return Ok(());
            }
            self.turn(turn)?;
            self.watchdog.feed(Instant::now());
            if !self.is_ready && self.screens.are_ready(opened.elapsed()).map_err(FrameError::NoOutput)? {
                self.is_ready = true;
                let _ = first.try_send(Ok(()));
                // The next start has them, however this one ends.
                self.device.keep_pipelines();
            }
            if self.frames.is_some_and(|n| self.links.stats.fewest_frames() >= n) {
                return Ok(());
            }
        }
    }

    /// One frame, where anything is stale, and then the requests.
    fn turn(&mut self, mut turn: Turn) -> Result<(), RenderError> {
        // The newest pose is read as late as the frame may begin. Whoever asks for something else is not kept waiting for that.
        let start = self.screens.plan();
        self.requests.extend(turn.requests);
        if self.requests.is_empty() && (self.rendered || !self.renderer.is_uploading()) && start > Instant::now() {
            for (index, at) in self.screens.wait_shown(start) {
                if let Some(projector) = self.renderer.projectors().nth(index) {
                    self.links.ledger.presented(&projector.name, at);
                }
            }
            self.links.shared.pause(start);
            turn.scene = self.links.shared.newest();
        }
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
        let mut scene = moved.unwrap_or(turn.scene);
        if self.refused == Some(scene.revision) {
            scene = self.shown.clone();
        }
        self.renderer.set_scene(scene.clone());
        self.rendered = match self.show(began) {
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
        self.screens.before_frame(&mut self.renderer, began);
        let mut frame = self.sight.render(&mut self.renderer, began)?;
        if frame.is_none() && self.screens.wants_whole(&self.renderer, began) {
            self.renderer.set_coarse(false);
            frame = self.sight.render(&mut self.renderer, began)?;
        }
        self.shown = self.renderer.scene().clone();
        self.present(frame.as_ref())?;
        if let Some(frame) = &frame {
            self.attempts.showed();
            self.count(frame, began);
        } else {
            // A picture that stays counts as shown once a refresh, however often the thread is woken meanwhile.
            let is_due = |at: Instant| self.screens.clock().next_refresh(at) <= began;
            let counts = self.frames.is_some() && self.counted.is_none_or(is_due);
            if counts {
                self.counted = Some(began);
            }
            self.links.stats.unchanged(self.renderer.scene().revision, counts);
        }
        Ok(frame.is_some())
    }

    /// Shows on the outputs what was rendered for them, and looks after them.
    pub(super) fn present(&mut self, frame: Option<&Frame>) -> Result<(), RenderError> {
        // A frame is counted once it is presented.
        let number = self.frame + u64::from(frame.is_some());
        for event in self.screens.present(&mut self.renderer, frame, number)? {
            self.tell(EventKind::Output, || Event::Output(event));
        }
        self.links.stats.set_outputs(self.screens.status(), self.renderer.is_coarse());
        self.links.stats.set_scene_bytes(self.renderer.scene_bytes());
        Ok(())
    }

    /// Makes whole what was shown coarsely, or not at all since its screen is slower: for whoever looks closely.
    pub(super) fn settle(&mut self) -> Result<(), RenderError> {
        if !self.renderer.is_coarse() && !self.renderer.is_behind() {
            return Ok(());
        }
        self.screens.plan();
        let began = Instant::now();
        self.renderer.set_due(&[]);
        self.renderer.set_coarse(false);
        let frame = self.sight.render(&mut self.renderer, began)?;
        self.present(frame.as_ref())?;
        if let Some(frame) = &frame {
            self.count(frame, began);
        }
        Ok(())
    }

    pub(super) fn count(&mut self, frame: &Frame, began: Instant) {
        let report = &frame.report;
        self.frame += 1;
        // It is with the screens now.
        let shown = Instant::now();
        self.screens.completed(self.renderer.is_coarse(), began, shown);
        let names: Vec<_> = self.renderer.projectors().map(|p| p.name.as_str()).collect();
        // Before the first picture nothing was due.
        let missed = |projector| if self.frame > 1 { self.screens.missed(projector, shown) } else { 0 };
        let reports: Vec<_> = report.projectors.iter().map(|p| (names[p.projector], p, missed(p.projector))).collect();
        self.links.stats.rendered(&reports, self.frame, report.revision);
        for (projector, of, missed) in reports {
            let poses = shown_poses(&frame.placed, report.submitted, of.completed);
            self.links.ledger.record(projector, &poses, of.completed);
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
