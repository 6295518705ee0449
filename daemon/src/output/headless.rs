//! An output that goes nowhere: the image stays on the device for snapshots.

use lantern_render::Renderer;

use super::{Output, OutputError, Picture, Showing};

/// An output that is always there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Headless;

impl Output for Headless {
    fn show(&mut self, _: &mut Renderer, _: Picture) -> Result<Showing, OutputError> {
        Ok(Showing::Shown)
    }
}
