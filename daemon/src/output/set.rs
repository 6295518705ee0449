//! The outputs of all projectors: opened, watched, lost and opened again, each for itself.

use std::sync::Arc;
use std::time::{Duration, Instant};

use lantern_gpu::{Device, GpuError};
use lantern_proto::ExportHandle;
use lantern_proto::event::OutputEvent;
use lantern_proto::status::OutputStatus;
use lantern_render::Renderer;

use super::export::LendError;
use super::slot::{Opened, OutputSpec, Slot, State, USUAL_HZ};
use super::window::WindowOutput;
use super::{Clock, Output, OutputError, Picture, Showing};
use crate::feed::{Lent, Wake};

/// How often outputs are looked at that may have gone, or may have come back.
const LOOK: Duration = Duration::from_secs(1);

/// How soon one is looked at again that has no room for a picture; and, once it has had none for long, how soon then.
const SOON: Duration = Duration::from_millis(4);
const LATER: Duration = Duration::from_millis(50);

/// All of them, in the projectors' order.
pub struct Outputs {
    device: Arc<Device>,
    wake: Wake,
    slots: Vec<Slot>,
    /// What has happened to them and was not told yet.
    events: Vec<OutputEvent>,
    next_look: Instant,
    /// Whose last picture is waited for before the others'.
    first_waited: usize,
}

impl Outputs {
    /// Opens those that can be; the others are tried again as long as they are wanted.
    pub fn open(device: &Arc<Device>, specs: Vec<OutputSpec>, wake: Wake) -> Self {
        let now = Instant::now();
        let mut outputs = Self {
            device: device.clone(),
            wake,
            slots: Vec::new(),
            events: Vec::new(),
            next_look: now,
            first_waited: 0,
        };
        outputs.reconfigure(specs);
        outputs
    }

    /// Takes others; those of which nothing has changed stay as they are.
    pub fn reconfigure(&mut self, specs: Vec<OutputSpec>) {
        // What is not kept goes before anything is opened: the new ones may want the same screens. A place further up or down
        // has another queue, which a swapchain would not know.
        let now = Instant::now();
        let mut before: Vec<_> = std::mem::take(&mut self.slots).into_iter().map(Some).collect();
        let keep = |(index, spec): (usize, &OutputSpec)| before.get_mut(index)?.take_if(|slot| slot.spec == *spec);
        let kept: Vec<_> = specs.iter().enumerate().map(keep).collect();
        before.clear();
        for (index, (spec, kept)) in specs.into_iter().zip(kept).enumerate() {
            let is_new = kept.is_none();
            self.slots.push(kept.map_or_else(|| Slot::closed(spec, now), |slot| Slot { behind: true, ..slot }));
            if is_new {
                self.try_open(index, now);
            }
        }
    }

    /// Opens one that is lost, or asks for it where that was not done yet.
    fn try_open(&mut self, index: usize, now: Instant) {
        let slot = &mut self.slots[index];
        let State::Lost { opening: opening @ None, .. } = &mut slot.state else { return };
        match slot.spec.open(&self.device, index, &self.wake) {
            Ok(Opened::Now(output)) => self.came(index, output, now),
            Ok(Opened::Later(later)) => *opening = Some(later),
            Err(error) => self.lose(index, &error),
        }
    }

    /// Whether one that was asked for has come, or will not.
    fn hear(&mut self, index: usize, now: Instant) {
        let State::Lost { opening, .. } = &mut self.slots[index].state else { return };
        let Some(asked) = opening else { return };
        match asked.answer() {
            Some(answer) => {
                *opening = None;
                let chain = self.slots[index].spec.chain(index);
                match answer.and_then(|window| WindowOutput::in_window(&self.device, window, chain)) {
                    Ok(output) => self.came(index, Box::new(output), now),
                    Err(error) => self.lose(index, &error),
                }
            }
            None => {
                if let Some(complaint) = asked.complaint(now) {
                    self.lose(index, &OutputError::Gone(complaint));
                }
            }
        }
    }

    fn came(&mut self, index: usize, output: Box<dyn Output>, now: Instant) {
        let slot = &mut self.slots[index];
        slot.state = State::Up(output);
        (slot.behind, slot.showing, slot.stuck) = (true, Showing::NotYet, None);
        slot.clock = Clock::new(slot.refresh_hz(), now);
        if slot.spec.may_be_lost() {
            let place = slot.status().place;
            tracing::info!(projector = slot.spec.projector, place, "output is there");
            self.tell(index);
        }
    }

    fn lose(&mut self, index: usize, error: &OutputError) {
        let (slot, why) = (&mut self.slots[index], error.to_string());
        let (news, opening) = match &mut slot.state {
            State::Lost { why: before, opening } => (*before != why, opening.take()),
            State::Up(_) => (true, None),
        };
        slot.state = State::Lost { why, opening };
        if news {
            tracing::warn!(projector = slot.spec.projector, "output is lost: {error}");
            self.tell(index);
        }
    }

    fn tell(&mut self, index: usize) {
        let slot = &self.slots[index];
        let OutputStatus { state, detail, .. } = slot.status();
        self.events.push(OutputEvent { projector: slot.spec.projector.clone(), state, detail });
    }

    /// Looks after all of them: shows what was `rendered` since, by the projector's place, in `frame`, and what has to be shown again; opens
    /// again those that were lost.
    ///
    /// # Errors
    /// Where not an output is lost but the device.
    pub fn tend(
        &mut self,
        renderer: &mut Renderer,
        rendered: impl Fn(usize) -> bool,
        frame: u64,
        now: Instant,
    ) -> Result<(), GpuError> {
        let look = now >= self.next_look;
        if look {
            self.next_look = now + LOOK;
        }
        for index in 0..self.slots.len() {
            self.slots[index].behind |= rendered(index);
            if look {
                self.try_open(index, now);
            }
            self.hear(index, now);
            let slot = &mut self.slots[index];
            let State::Up(output) = &mut slot.state else { continue };
            let gone = if look { output.gone() } else { None };
            if let Some(why) = gone {
                self.lose(index, &OutputError::Gone(why));
                continue;
            }
            let is_new = slot.behind;
            slot.behind |= output.must_show_again();
            if !slot.behind {
                continue;
            }
            match output.show(renderer, Picture { projector: index, frame, is_new }) {
                Ok(showing) => {
                    slot.behind = showing == Showing::NotYet;
                    let was_stuck = slot.is_stuck(now);
                    slot.stuck = slot.behind.then(|| slot.stuck.unwrap_or(now));
                    let was = std::mem::replace(&mut slot.showing, showing);
                    let changed = was != showing && [was, showing].contains(&Showing::Black);
                    if slot.spec.may_be_lost() && (changed || slot.is_stuck(now) != was_stuck) {
                        self.tell(index);
                        if showing == Showing::Black && renderer.has_shown() {
                            let detail = self.slots[index].status().detail.unwrap_or_default();
                            tracing::warn!(
                                projector = self.slots[index].spec.projector,
                                "output stays black: {detail}"
                            );
                        }
                    }
                }
                Err(OutputError::Gpu(error @ (GpuError::DeviceLost { .. } | GpuError::Timeout { .. }))) => {
                    return Err(error);
                }
                Err(error) => self.lose(index, &error),
            }
        }
        Ok(())
    }

    /// Images for another client of a projector's pictures, by its name. It has the newest one at the next turn.
    ///
    /// # Errors
    /// [`LendError`].
    pub fn lend(&mut self, projector: &str, handle: ExportHandle) -> Result<Lent, LendError> {
        let slot = self.slots.iter_mut().find(|slot| slot.spec.projector == projector);
        match slot.map(|slot| &mut slot.state) {
            Some(State::Up(output)) => output.lend(handle),
            Some(State::Lost { why, .. }) => Err(LendError::Lost(why.clone())),
            None => Err(LendError::NoExport),
        }
    }

    /// When they want to be looked after next, though nothing is rendered: soon where one is behind, now and then where one may
    /// have come or gone, and never where all are headless.
    pub fn next_look(&self, now: Instant) -> Option<Instant> {
        let waits = self.slots.iter().filter(|slot| slot.behind && matches!(slot.state, State::Up(_)));
        let soonest = waits.map(|slot| if slot.is_stuck(now) { LATER } else { SOON }).min();
        let look = self.slots.iter().any(|slot| slot.spec.may_be_lost()).then_some(self.next_look);
        soonest.map(|soon| now + soon).into_iter().chain(look).min()
    }

    /// Lets go of all of them, and takes them from sight: their device is lost, and shows nothing any more.
    pub fn abandon(&mut self) {
        for slot in self.slots.drain(..) {
            if let State::Up(mut output) = slot.state {
                output.hide();
            }
        }
    }

    /// What has happened to them since this was last asked.
    pub fn take_events(&mut self) -> Vec<OutputEvent> {
        std::mem::take(&mut self.events)
    }

    /// How each of them is, with its projector.
    pub fn status(&self) -> impl Iterator<Item = (&str, OutputStatus)> {
        self.slots.iter().map(|slot| (slot.spec.projector.as_str(), slot.status()))
    }

    /// Those that are lost, with why; and how many are not.
    pub fn lost(&self) -> (Vec<String>, usize) {
        let words = |slot: &Slot| match &slot.state {
            State::Lost { why, .. } => Some(format!("output of {}: {why}", slot.spec.projector)),
            State::Up(_) => None,
        };
        let lost: Vec<_> = self.slots.iter().filter_map(words).collect();
        let up = self.slots.len() - lost.len();
        (lost, up)
    }

    /// Whether any shows its picture to people.
    pub fn any_shows(&self) -> bool {
        self.slots.iter().any(|slot| slot.spec.shows())
    }

    /// The clock of the fastest that people see now, or where there is none, of the fastest: all projectors of a frame share it.
    pub fn clock(&self) -> Clock {
        let fastest = |slots: &mut dyn Iterator<Item = &Slot>| slots.map(|slot| slot.clock).min_by_key(Clock::period);
        let seen = |slot: &&Slot| slot.spec.shows() && matches!(slot.state, State::Up(_));
        fastest(&mut self.slots.iter().filter(seen))
            .or_else(|| fastest(&mut self.slots.iter()))
            .unwrap_or_else(|| Clock::new(USUAL_HZ, self.next_look))
    }

    /// At how many refreshes of a projector's own screen what was due at `refresh` was not there yet.
    pub fn missed(&self, projector: usize, refresh: Instant, completed: Instant) -> u64 {
        self.slots.get(projector).map_or(0, |slot| {
            // Its own refresh is the first from that one on.
            let clock = &slot.clock;
            let just_before = refresh.checked_sub(clock.period() / 1000).unwrap_or(refresh);
            clock.missed(clock.next_refresh(just_before), completed)
        })
    }

    /// Which are due at a refresh of the fastest: those whose own next refresh comes before its next one.
    pub fn due(&self, refresh: Instant) -> Vec<bool> {
        let period = self.clock().period();
        self.slots.iter().map(|slot| slot.clock.next_refresh(refresh) <= refresh + period.mul_f64(1.001)).collect()
    }

    /// What the slowest takes from a frame's completion to its light.
    pub fn latency(&self) -> Duration {
        let slowest_ms = self.slots.iter().map(|slot| slot.spec.output.latency_ms).fold(0.0, f64::max);
        Duration::from_secs_f64(slowest_ms / 1e3)
    }

    /// Waits, until `until` at most, for the last pictures to be there; those that can tell when that was, by the projector's
    /// place. Their clocks follow. They are waited for one after the other, and each has its turn to be the first.
    pub fn wait_shown(&mut self, until: Instant) -> Vec<(usize, Instant)> {
        let (mut shown, count) = (Vec::new(), self.slots.len());
        self.first_waited = (self.first_waited + 1) % count.max(1);
        for index in (0..count).map(|turn| (turn + self.first_waited) % count) {
            let slot = &mut self.slots[index];
            let State::Up(output) = &mut slot.state else { continue };
            if let Some(at) = output.wait_shown(until) {
                slot.clock.saw(at);
                shown.push((index, at));
            }
        }
        shown
    }
}

impl Drop for Outputs {
    fn drop(&mut self) {
        for slot in &mut self.slots {
            if let State::Up(output) = &mut slot.state {
                output.black();
            }
        }
    }
}
