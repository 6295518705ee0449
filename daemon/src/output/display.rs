//! An output that is a display of its own, without a desktop.

use std::sync::Arc;
use std::time::Instant;

use lantern_gpu::{Connector, Device, DisplayDesc, SwapchainDesc};
use lantern_render::Renderer;

use super::screen::Screen;
use super::{Description, Output, OutputError, Picture, Showing};

/// A display with its picture.
pub(super) struct DisplayOutput {
    screen: Screen,
    connector: Option<Connector>,
    refresh_hz: f64,
}

impl DisplayOutput {
    pub(super) fn open(device: &Arc<Device>, desc: &DisplayDesc, chain: SwapchainDesc) -> Result<Self, OutputError> {
        let opened = device.open_display(desc)?;
        Ok(Self {
            screen: Screen::new(device, opened.surface, chain),
            connector: opened.connector,
            refresh_hz: opened.refresh_hz,
        })
    }
}

impl Output for DisplayOutput {
    fn show(&mut self, renderer: &mut Renderer, picture: Picture) -> Result<Showing, OutputError> {
        Ok(self.screen.show(renderer, picture.projector)?)
    }

    fn gone(&mut self) -> Option<String> {
        // Not every driver says by itself that a plug was pulled; the kernel does. Another screen at the same connector is not
        // the one that was calibrated.
        let own = self.connector.as_ref()?;
        let now = own.now();
        let same = now.as_ref().is_some_and(|now| now.connected && now.identity == own.identity);
        (!same).then(|| format!("{} was unplugged", own.name))
    }

    fn black(&mut self) {
        // It is let go in any case.
        let _ = self.screen.black();
    }

    fn wait_shown(&mut self, until: Instant) -> Option<Instant> {
        self.screen.wait_shown(until)
    }

    fn describe(&self) -> Description {
        let place = self.connector.as_ref().map(|connector| match &connector.identity {
            Some(identity) => format!("{} ({})", connector.name, identity.id),
            None => connector.name.clone(),
        });
        Description {
            place: place.unwrap_or_default(),
            pixels: self.screen.pixels(),
            refresh_hz: Some(self.refresh_hz),
            size_px: self.screen.size_px(),
            ..Description::default()
        }
    }
}
