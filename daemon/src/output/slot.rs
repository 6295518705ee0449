//! A projector's output: what it is to be, and how it is.

use std::sync::Arc;
use std::time::{Duration, Instant};

use lantern_config::{Fullscreen, OutputKind};
use lantern_gpu::{Device, DisplayDesc, Pixels, Placement, SwapchainDesc, WindowDesc};
use lantern_proto::event::OutputState;
use lantern_proto::status::OutputStatus;

use super::display::DisplayOutput;
use super::export::ExportOutput;
use super::headless::Headless;
use super::window::Opening;
use super::{Clock, Output, OutputError, Showing};
use crate::feed::Wake;

/// A screen that takes no picture for so long shows none.
const STUCK: Duration = Duration::from_secs(1);

/// Where screens say no rate of their own, Hz.
pub(super) const USUAL_HZ: f64 = 60.0;

/// What a projector's output is to be.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputSpec {
    /// The projector's name.
    pub projector: String,
    /// Its columns and rows.
    pub size_px: [u32; 2],
    /// Where its image goes.
    pub output: lantern_config::Output,
}

impl OutputSpec {
    /// Whether it can go: all but headless ones can.
    pub(super) fn may_be_lost(&self) -> bool {
        self.output.kind != OutputKind::Headless
    }

    /// Whether people see it.
    pub(super) fn shows(&self) -> bool {
        matches!(self.output.kind, OutputKind::Window { .. } | OutputKind::Display { .. })
    }

    pub(super) fn chain(&self, queue: usize) -> SwapchainDesc {
        let pixels = match self.output.pixels {
            lantern_config::Pixels::Bits8 => Pixels::Bits8,
            lantern_config::Pixels::Bits10 => Pixels::Bits10,
            lantern_config::Pixels::Hdr10 => Pixels::Hdr10,
        };
        SwapchainDesc { pixels, white_nits: self.output.white_nits as f32, queue }
    }

    /// Opens it, or begins to.
    pub(super) fn open(&self, device: &Arc<Device>, queue: usize, wake: &Wake) -> Result<Opened, OutputError> {
        let name = self.projector.clone();
        Ok(match &self.output.kind {
            OutputKind::Headless => Opened::Now(Box::new(Headless)),
            OutputKind::Window { server, fullscreen } => {
                let placement = match fullscreen {
                    Fullscreen::No => Placement::Anywhere,
                    Fullscreen::Any => Placement::Fullscreen(None),
                    Fullscreen::On(monitor) => Placement::Fullscreen(Some(monitor.clone())),
                };
                let (server, wake) = (server.clone(), wake.clone());
                let desc = WindowDesc { name, size_px: self.size_px, placement, server, wake };
                Opened::Later(Opening::start(desc)?)
            }
            OutputKind::Display { connector, edid } => {
                let (connector, edid, refresh_hz) = (connector.clone(), edid.clone(), self.output.refresh_hz);
                let desc = DisplayDesc { name, connector, edid, size_px: self.size_px, refresh_hz };
                Opened::Now(Box::new(DisplayOutput::open(device, &desc, self.chain(queue))?))
            }
            OutputKind::Export => {
                let (size_px, wake) = (self.size_px, wake.clone());
                Opened::Now(Box::new(ExportOutput::open(device, &name, size_px, queue, wake)?))
            }
        })
    }
}

/// An output that is there, or will be.
pub(super) enum Opened {
    Now(Box<dyn Output>),
    Later(Opening),
}

/// Whether an output is there.
pub(super) enum State {
    Up(Box<dyn Output>),
    /// And perhaps on its way.
    Lost {
        why: String,
        opening: Option<Opening>,
    },
}

/// A projector's output.
pub(super) struct Slot {
    pub(super) spec: OutputSpec,
    pub(super) state: State,
    pub(super) clock: Clock,
    /// What came of its last picture.
    pub(super) showing: Showing,
    /// It has yet to show what was rendered.
    pub(super) behind: bool,
    /// Since when it has had no room for a picture.
    pub(super) stuck: Option<Instant>,
}

impl Slot {
    pub(super) fn closed(spec: OutputSpec, now: Instant) -> Self {
        let state = State::Lost { why: "it was not opened yet".into(), opening: None };
        let clock = Clock::new(spec.output.refresh_hz.unwrap_or(USUAL_HZ), now);
        Self { spec, state, clock, showing: Showing::NotYet, behind: true, stuck: None }
    }

    pub(super) fn refresh_hz(&self) -> f64 {
        let own = || match &self.state {
            State::Up(output) => output.describe().refresh_hz,
            State::Lost { .. } => None,
        };
        // A display has the rate that its mode has; a desktop's word for a window is only a guess.
        let wanted = self.spec.output.refresh_hz;
        let is_display = matches!(self.spec.output.kind, OutputKind::Display { .. });
        let hz = if is_display { own().or(wanted) } else { wanted.or_else(own) };
        hz.unwrap_or(USUAL_HZ)
    }

    /// Whether it has had no room for a picture for long.
    pub(super) fn is_stuck(&self, now: Instant) -> bool {
        self.stuck.is_some_and(|since| now.saturating_duration_since(since) > STUCK)
    }

    pub(super) fn status(&self) -> OutputStatus {
        let of = match &self.state {
            State::Up(output) => output.describe(),
            State::Lost { .. } => Default::default(),
        };
        let (state, detail) = match (&self.state, self.showing) {
            (State::Lost { why, .. }, _) => (OutputState::Lost, Some(why.clone())),
            (_, Showing::NotYet) if self.is_stuck(Instant::now()) => {
                (OutputState::Hidden, Some("its screen takes no pictures".to_owned()))
            }
            (_, Showing::Black) => (OutputState::Black, of.size_px.map(|px| self.misfit(px))),
            (_, Showing::Hidden) => (OutputState::Hidden, Some("its window has no pixels".to_owned())),
            (_, Showing::Shown | Showing::NotYet) => (OutputState::Shown, None),
        };
        OutputStatus {
            state,
            detail,
            place: of.place,
            pixels: of.pixels.to_owned(),
            refresh_hz: self.refresh_hz(),
            readers: of.readers,
            readers_missed: of.readers_missed,
        }
    }

    fn misfit(&self, [width, height]: [u32; 2]) -> String {
        let [columns, rows] = self.spec.size_px;
        format!("it has {width}x{height} px, and the calibration is for {columns}x{rows}")
    }
}
