//! An output that is a window of a desktop.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};

use lantern_gpu::{Device, Surface, SwapchainDesc, Window, WindowDesc, WindowError};
use lantern_render::Renderer;

use super::screen::Screen;
use super::{Description, Output, OutputError, Picture, Showing};

/// Desktops answer sooner, unless they are stopped.
const ANSWER_PATIENCE: Duration = Duration::from_secs(2);

/// A window with its picture. The picture goes first.
pub(super) struct WindowOutput {
    screen: Screen,
    window: Arc<Window>,
}

impl WindowOutput {
    /// Shows pictures in a window.
    pub(super) fn in_window(
        device: &Arc<Device>,
        window: Arc<Window>,
        chain: SwapchainDesc,
    ) -> Result<Self, OutputError> {
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
        let (exposed, now_px) = (self.window.take_exposed(), self.window.size_px());
        // One without pixels has no swapchain; where it has some again, it wants one.
        exposed || self.screen.size_px().map_or(!now_px.contains(&0), |shown_px| shown_px != now_px)
    }

    fn gone(&mut self) -> Option<String> {
        self.window.gone()
    }

    fn black(&mut self) {
        // It is let go in any case.
        let _ = self.screen.black();
    }

    fn hide(&mut self) {
        self.window.hide();
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

/// A window on its way. Its server may take as long as it likes, or never answer, so it is asked by a thread of its own.
pub(super) struct Opening {
    server: String,
    since: Instant,
    opened: Receiver<Result<Arc<Window>, WindowError>>,
}

impl Opening {
    /// Asks for a window. Whoever is to look after it is woken when there is an answer.
    pub(super) fn start(desc: WindowDesc) -> Result<Self, OutputError> {
        let (answer, opened) = channel();
        let server = desc.server.clone().unwrap_or_else(|| "the desktop".into());
        let name = format!("open {}", desc.name);
        let asked = std::thread::Builder::new().name(name).spawn(move || {
            let window = Window::open(&desc);
            // Nobody may want it any more; then it goes again.
            let _ = answer.send(window);
            (desc.wake)();
        });
        asked.map_err(|error| OutputError::Gone(format!("no thread can open it: {error}")))?;
        Ok(Self { server, since: Instant::now(), opened })
    }

    /// The window, or why there is none; None while nobody knows.
    pub(super) fn answer(&self) -> Option<Result<Arc<Window>, OutputError>> {
        match self.opened.try_recv() {
            Ok(window) => Some(window.map_err(OutputError::from)),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err(OutputError::Gone("its thread has a fault".into()))),
        }
    }

    /// What is to be said of a server that should have answered long ago.
    pub(super) fn complaint(&self, now: Instant) -> Option<String> {
        let waits = now.saturating_duration_since(self.since) > ANSWER_PATIENCE;
        waits.then(|| format!("{} does not answer", self.server))
    }
}
