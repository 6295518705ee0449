//! Where an image goes, and when it is due.
//!
//! - [`Output`]: what all of them are;
//! - `headless`, `window`, `display`, `export`: the kinds; the two in the middle show images on a `screen`;
//! - [`OutputSpec`]: what one is to be;
//! - [`Outputs`]: those of all projectors, opened, lost, and opened again;
//! - [`Clock`]: when a screen shows another image.

mod clock;
mod display;
mod export;
mod headless;
mod screen;
mod set;
mod slot;
mod window;

use std::time::{Duration, Instant};

use crate::feed::Lent;
use lantern_gpu::{DisplayError, GpuError, WindowError};
use lantern_proto::ExportHandle;
use lantern_render::Renderer;

pub use clock::Clock;
pub use export::LendError;
pub use set::Outputs;
pub use slot::OutputSpec;

/// Why an output cannot be opened, or was lost.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// A window.
    #[error(transparent)]
    Window(#[from] WindowError),
    /// A display.
    #[error(transparent)]
    Display(#[from] DisplayError),
    /// What the driver says.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// It went away by itself.
    #[error("{0}")]
    Gone(String),
}

/// A picture that is to be shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Whose, by the projector's place.
    pub projector: usize,
    /// The newest frame's number.
    pub frame: u64,
    /// Whether it was made since the last time, or is only to be shown again.
    pub is_new: bool,
}

/// What came of showing a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Showing {
    /// It is with the screen.
    Shown,
    /// The screen is black: its pixels are not those that the picture was made for.
    Black,
    /// The screen has no room for another picture yet.
    NotYet,
    /// There is nothing to show it on: a minimised window.
    Hidden,
}

/// What an output is, in words for `status`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Description {
    /// The server and monitor, or the connector; empty where there is none.
    pub place: String,
    /// What its pixels are made of; empty where none are shown.
    pub pixels: &'static str,
    /// How often it shows another image by its own word, Hz.
    pub refresh_hz: Option<f64>,
    /// Columns and rows of what it shows.
    pub size_px: Option<[u32; 2]>,
    /// Clients that have its images, where it has any to give.
    pub readers: Option<u64>,
    /// Pictures that these have missed.
    pub readers_missed: Option<u64>,
}

/// Where a projector's image goes.
///
/// The frame thread alone calls it, and between frames: when a picture is shown, the renderer has none in the making. An error
/// means that it is lost, and it is dropped then; opening it again is for whoever holds it.
pub trait Output: Send {
    /// Shows what the renderer made last of a projector. Never waits for longer than the screen needs to take an image that it
    /// has room for.
    ///
    /// # Errors
    /// [`OutputError`]: it is lost.
    fn show(&mut self, renderer: &mut Renderer, picture: Picture) -> Result<Showing, OutputError>;

    /// Whether it has to show its picture again, though that is still the same: it was covered, or has another size.
    fn must_show_again(&mut self) -> bool {
        false
    }

    /// Why it is gone, where that can be known without showing anything. Asked once a second or so.
    fn gone(&mut self) -> Option<String> {
        None
    }

    /// Makes it black, before it is let go, where it is seen.
    fn black(&mut self) {}

    /// Takes it from sight without the device, which is lost or hangs and may keep all that it was given.
    fn hide(&mut self) {}

    /// Waits, until `until` at most, for the last picture to be there; when it was, where that can be known. Of one that was there
    /// before anybody waited it cannot.
    fn wait_shown(&mut self, _until: Instant) -> Option<Instant> {
        None
    }

    /// What it is.
    fn describe(&self) -> Description {
        Description::default()
    }

    /// Images of its own for another client, where its pictures go to clients.
    ///
    /// # Errors
    /// [`LendError`]: they do not, or there is no room for another.
    fn lend(&mut self, _: ExportHandle) -> Result<Lent, LendError> {
        Err(LendError::NoExport)
    }
}

/// How long showing waits for a screen that has no room for another picture: it has by the next turn.
const PATIENCE: Duration = Duration::from_millis(2);
