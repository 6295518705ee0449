//! An output that goes nowhere: the image stays on the device for snapshots.

use std::time::Instant;

use lantern_render::Renderer;

use super::{Description, Output, OutputError, Picture, Showing};

/// An output that is always there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Headless;

impl Output for Headless {
    fn show(&mut self, _: &mut Renderer, _: Picture) -> Result<Showing, OutputError> {
        Ok(Showing::Shown)
    }

    fn must_show_again(&mut self) -> bool {
        false
    }

    fn gone(&mut self) -> Option<String> {
        None
    }

    fn black(&mut self) {}

    fn wait_shown(&mut self, _: Instant) -> Option<Instant> {
        None
    }

    fn describe(&self) -> Description {
        Description::default()
    }
}
