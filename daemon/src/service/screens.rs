//! Where frames are shown, and when they begin: the outputs with their common clock, the pace, and how coarse frames may be.

use std::sync::Arc;
use std::time::{Duration, Instant};

use lantern_config::OutputKind;
use lantern_gpu::{Device, GpuError};
use lantern_proto::ExportHandle;
use lantern_proto::event::OutputEvent;
use lantern_proto::status::OutputStatus;
use lantern_render::Renderer;

use super::coarseness::Coarseness;
use super::pace::{Pace, Plan};
use super::shared::Shared;
use super::sight::Frame;
use crate::feed::Lent;
use crate::output::{Clock, LendError, OutputSpec, Outputs};

/// How long the start waits for outputs that are not there; after that it goes on with those that are.
const OUTPUT_PATIENCE: Duration = Duration::from_secs(10);

/// How long a coarse picture stays after the last move, before it is made whole.
const REST: Duration = Duration::from_millis(100);

/// The outputs of all projectors, and the time that they keep.
pub(super) struct Screens {
    outputs: Outputs,
    specs: Vec<OutputSpec>,
    degrade: Option<bool>,
    /// The clock of the fastest: all projectors of a frame share one.
    clock: Clock,
    pace: Pace,
    /// The frame in the making.
    plan: Plan,
    /// The refresh that the last frame was to be seen at.
    shown_for: Instant,
    coarseness: Coarseness,
    /// When the last coarse picture was begun.
    last_coarse: Instant,
}

impl Screens {
    /// Opens what can be opened. Whatever comes or goes later wakes the frame thread.
    pub(super) fn open(
        device: &Arc<Device>,
        specs: Vec<OutputSpec>,
        degrade: Option<bool>,
        renderer: &Renderer,
        shared: &Arc<Shared>,
    ) -> Self {
        let waker = shared.clone();
        let outputs = Outputs::open(device, specs.clone(), Arc::new(move || waker.stir()));
        let now = Instant::now();
        Self {
            coarseness: coarseness(degrade, &outputs, renderer),
            clock: outputs.clock(),
            outputs,
            specs,
            degrade,
            pace: Pace::default(),
            plan: Plan { start: now, refresh: now },
            shown_for: now,
            last_coarse: now,
        }
    }

    /// Takes other outputs; those of which nothing has changed stay as they are.
    pub(super) fn reconfigure(&mut self, specs: Vec<OutputSpec>, degrade: Option<bool>, renderer: &Renderer) {
        (self.specs, self.degrade) = (specs.clone(), degrade);
        self.outputs.reconfigure(specs);
        self.coarseness = coarseness(degrade, &self.outputs, renderer);
        self.clock = self.outputs.clock();
        self.pace.restart();
        self.plan();
    }

    /// Lets go of all of them, whose device is lost; gives what is to be opened on the next one.
    pub(super) fn give_up(mut self) -> (Vec<OutputSpec>, Option<bool>) {
        self.outputs.abandon();
        (self.specs, self.degrade)
    }

    /// Whether any is a display, which is this process's alone.
    pub(super) fn have_displays(&self) -> bool {
        self.specs.iter().any(|spec| matches!(spec.output.kind, OutputKind::Display { .. }))
    }

    /// The clock of the fastest.
    pub(super) fn clock(&self) -> &Clock {
        &self.clock
    }

    /// What the slowest takes from a frame's completion to its light.
    pub(super) fn latency(&self) -> Duration {
        self.outputs.latency()
    }

    /// When they want to be looked after, though nothing is rendered.
    pub(super) fn next_look(&self, now: Instant) -> Option<Instant> {
        self.outputs.next_look(now)
    }

    /// Whether the start is over, after so long: every output is there, or, after a while, any.
    ///
    /// # Errors
    /// Where none is, with why.
    pub(super) fn are_ready(&self, after: Duration) -> Result<bool, String> {
        let (lost, up) = self.outputs.lost();
        let waits = after < OUTPUT_PATIENCE;
        if up == 0 && !waits { Err(lost.join("; ")) } else { Ok(lost.is_empty() || !waits) }
    }

    /// Plans the next frame; gives when it is to begin.
    pub(super) fn plan(&mut self) -> Instant {
        self.plan = self.pace.plan(&self.clock, Instant::now());
        self.plan.start
    }

    /// Waits, until `until` at most, for the last pictures to be seen; those whose screens tell when that was, by the projector's
    /// place.
    pub(super) fn wait_shown(&mut self, until: Instant) -> Vec<(usize, Instant)> {
        let seen = self.outputs.wait_shown(until);
        if !seen.is_empty() {
            self.clock = self.outputs.clock();
        }
        // A screen knows better than we whether a frame was in time.
        if seen.iter().any(|(_, at)| *at > self.shown_for + self.clock.period() / 2) {
            self.pace.was_late(&self.clock);
        }
        seen
    }

    /// Tells the renderer which projectors' screens are due at the planned refresh, and how closely to look.
    pub(super) fn before_frame(&self, renderer: &mut Renderer, began: Instant) {
        renderer.set_due(&self.outputs.due(self.plan.refresh));
        renderer.set_coarse(self.coarseness.wants(began));
    }

    /// Whether nothing has moved for long enough to make a coarse picture whole.
    pub(super) fn wants_whole(&self, renderer: &Renderer, now: Instant) -> bool {
        renderer.is_coarse() && self.last_coarse + REST <= now
    }

    /// Shows what was rendered as the frame of that number, and looks after the outputs; what has happened to them.
    ///
    /// # Errors
    /// Where not an output is lost but the device.
    pub(super) fn present(
        &mut self,
        renderer: &mut Renderer,
        frame: Option<&Frame>,
        number: u64,
    ) -> Result<Vec<OutputEvent>, GpuError> {
        let rendered = |index| frame.is_some_and(|frame| frame.report.projectors.iter().any(|p| p.projector == index));
        self.outputs.tend(renderer, rendered, number, Instant::now())?;
        let events = self.outputs.take_events();
        if !events.is_empty() {
            // Another screen may have another rate.
            self.clock = self.outputs.clock();
            self.pace.restart();
        }
        Ok(events)
    }

    /// Images for another client of a projector's pictures.
    ///
    /// # Errors
    /// [`LendError`].
    pub(super) fn lend(&mut self, projector: &str, handle: ExportHandle) -> Result<Lent, LendError> {
        self.outputs.lend(projector, handle)
    }

    /// How each of them is, with its projector.
    pub(super) fn status(&self) -> impl Iterator<Item = (&str, OutputStatus)> {
        self.outputs.status()
    }

    /// The planned frame is whole, and with the screens.
    pub(super) fn completed(&mut self, was_coarse: bool, began: Instant, completed: Instant) {
        if was_coarse {
            self.last_coarse = began;
        }
        let took = completed.saturating_duration_since(began);
        if self.coarseness.completed(was_coarse, took, self.clock.period(), completed) {
            let coarse = self.coarseness.wants(completed);
            let what =
                if coarse { "reflections are coarser while anything moves" } else { "reflections are whole again" };
            let ms = |time: Duration| time.as_secs_f64() * 1e3;
            tracing::warn!(took_ms = ms(took), period_ms = ms(self.clock.period()), "{what}");
        }
        self.pace.completed(&self.clock, self.plan, began, completed);
        self.shown_for = self.plan.refresh;
    }

    /// The refreshes of a projector's own screen at which the planned frame was due and not ready.
    pub(super) fn missed(&self, projector: usize, completed: Instant) -> u64 {
        self.outputs.missed(projector, self.plan.refresh, completed)
    }
}

/// Frames that nobody sees may take as long as they need.
fn coarseness(degrade: Option<bool>, outputs: &Outputs, renderer: &Renderer) -> Coarseness {
    Coarseness::new(degrade.unwrap_or_else(|| outputs.any_shows()) && renderer.can_be_coarse())
}
