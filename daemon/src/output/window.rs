//! An output that is a window of a desktop.

use std::sync::Arc;
use std::time::Instant;

use lantern_gpu::{Device, Surface, SwapchainDesc, Window, WindowDesc};
use lantern_render::Renderer;

use super::screen::Screen;
use super::{Description, Output, OutputError, Picture, Showing};

/// A window with its picture. The picture goes first.
pub(super) struct WindowOutput {
    screen: Screen,
    window: Arc<Window>,
}

impl WindowOutput {
    pub(super) fn open(device: &Arc<Device>, desc: &WindowDesc, chain: SwapchainDesc) -> Result<Self, OutputError> {
        let window = Window::open(desc)?;
        let surface = Surface::of_window(device.instance(), &window)?;
        Ok(Self { screen: Screen::new(device, surface, chain), window })
    }
}

impl Output for WindowOutput {
    fn show(&mut self, renderer: &mut Renderer, picture: Picture) -> Result<Showing, OutputError> {
        if let Some(why) = self.gone() {
            return Err(OutputError::Gone(why));
        }
        Ok(self.screen.show(renderer, picture.projector)?)
    }

    fn must_show_again(&mut self) -> bool {
        let exposed = self.window.take_exposed();
        exposed || self.screen.size_px().is_some_and(|size_px| size_px != self.window.size_px())
    }

    fn gone(&mut self) -> Option<String> {
        self.window.gone()
    }

    fn black(&mut self) {
        // It is let go in any case.
        let _ = self.screen.black();
    }

    fn wait_shown(&mut self, until: Instant) -> Option<Instant> {
        self.screen.wait_shown(until)
    }

    fn describe(&self) -> Description {
        Description {
            place: self.window.server().to_owned(),
            pixels: self.screen.pixels(),
            refresh_hz: self.window.refresh_hz(),
            size_px: self.screen.size_px(),
            ..Description::default()
        }
    }
}
