//! Windows of X11 and Wayland servers, each with a thread of its own that hears what the server says.
//!
//! They stand in this crate because a Vulkan surface points into the window and its connection: here one owns the other, and nobody
//! else can take a window from under its surface.

mod wayland;
mod x11;

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

pub(crate) use wayland::WaylandWindow;
pub(crate) use x11::X11Window;

/// How long a window's thread sleeps at most. The driver reads from the same connection, so that what has come may wait in memory
/// with nothing left to wake for.
const NAP: Duration = Duration::from_millis(100);

/// What goes wrong with windows.
#[derive(Debug, thiserror::Error)]
pub enum WindowError {
    /// Nothing says which server shows windows.
    #[error(
        "window {window:?}: neither WAYLAND_DISPLAY nor DISPLAY is set; hint: name the server in the output (server = \":0\")"
    )]
    NoServer {
        /// The window.
        window: String,
    },
    /// The server does not answer, or refuses.
    #[error("window {window:?}: {server}: {detail}")]
    Server {
        /// The window.
        window: String,
        /// The server.
        server: String,
        /// What it, or the library, says.
        detail: String,
    },
    /// There is no monitor of that name.
    #[error("window {window:?}: there is no monitor {monitor:?}; hint: there are {have}")]
    NoMonitor {
        /// The window.
        window: String,
        /// What was asked for.
        monitor: String,
        /// The monitors' names.
        have: String,
    },
}

/// Where on the screen a window stands.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Placement {
    /// As the server, or its window manager, likes.
    Anywhere,
    /// All over a monitor, of this name or else of the server's choice.
    Fullscreen(Option<String>),
}

/// What a window is to be.
#[derive(Clone)]
pub struct WindowDesc {
    /// Its title, and its name in messages.
    pub name: String,
    /// Columns and rows that it should have.
    pub size_px: [u32; 2],
    /// Where it stands.
    pub placement: Placement,
    /// An X11 display (`:0`) or a Wayland socket (`wayland-1`); None: what the environment names, Wayland first.
    pub server: Option<String>,
    /// Called from the window's thread when it has another size, shows less than it should, or is gone.
    pub wake: Arc<dyn Fn() + Send + Sync>,
}

impl std::fmt::Debug for WindowDesc {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "WindowDesc({:?}, {:?}, {:?}, {:?})", self.name, self.size_px, self.placement, self.server)
    }
}

/// What a window's thread has heard.
pub(crate) struct Heard {
    size_px: Mutex<[u32; 2]>,
    exposed: AtomicBool,
    /// Why it is gone, once it is.
    gone: Mutex<Option<String>>,
    stop: AtomicBool,
    wake: Arc<dyn Fn() + Send + Sync>,
}

impl Heard {
    fn new(desc: &WindowDesc) -> Arc<Heard> {
        Arc::new(Heard {
            size_px: Mutex::new(desc.size_px),
            exposed: AtomicBool::new(false),
            gone: Mutex::default(),
            stop: AtomicBool::new(false),
            wake: Arc::clone(&desc.wake),
        })
    }

    fn resize(&self, size_px: [u32; 2]) {
        let mut size = self.size_px.lock().unwrap_or_else(PoisonError::into_inner);
        if std::mem::replace(&mut *size, size_px) != size_px {
            drop(size);
            (self.wake)();
        }
    }

    fn expose(&self) {
        self.exposed.store(true, Ordering::Release);
        (self.wake)();
    }

    fn lose(&self, why: impl std::fmt::Display) {
        let mut gone = self.gone.lock().unwrap_or_else(PoisonError::into_inner);
        gone.get_or_insert_with(|| why.to_string());
        drop(gone);
        (self.wake)();
    }

    fn is_stopping(&self) -> bool {
        self.stop.load(Ordering::Acquire)
    }
}

/// The thread of a window, which ends soon after it: its server may be stopped, and nobody waits for that.
struct Listener {
    heard: Arc<Heard>,
}

impl Listener {
    fn start(
        desc: &WindowDesc,
        heard: &Arc<Heard>,
        listen: impl FnOnce(Arc<Heard>) + Send + 'static,
    ) -> std::io::Result<Listener> {
        let own = Arc::clone(heard);
        let name = format!("window {}", desc.name);
        std::thread::Builder::new().name(name).spawn(move || listen(own))?;
        Ok(Listener { heard: Arc::clone(heard) })
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        self.heard.stop.store(true, Ordering::Release);
    }
}

/// The window system's side of a window.
pub(crate) enum System {
    X11(X11Window),
    Wayland(WaylandWindow),
}

/// A window, shown from the moment that it is opened until it is dropped.
pub struct Window {
    pub(crate) system: System,
    heard: Arc<Heard>,
    refresh_hz: Option<f64>,
    server: String,
    name: String,
}

impl std::fmt::Debug for Window {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Window({:?} on {})", self.name, self.server)
    }
}

impl Window {
    /// Opens a window.
    ///
    /// # Errors
    /// [`WindowError`], each with the window's name.
    pub fn open(desc: &WindowDesc) -> Result<Arc<Window>, WindowError> {
        let variable = |name| std::env::var(name).ok().filter(|value| !value.is_empty());
        let (server, is_wayland) = match &desc.server {
            Some(server) => (server.clone(), !server.contains(':')),
            None => match (variable("WAYLAND_DISPLAY"), variable("DISPLAY")) {
                (Some(server), _) => (server, true),
                (None, Some(server)) => (server, false),
                (None, None) => return Err(WindowError::NoServer { window: desc.name.clone() }),
            },
        };
        let heard = Heard::new(desc);
        let (system, refresh_hz) = if is_wayland {
            let (window, refresh_hz) = WaylandWindow::open(desc, &server, &heard)?;
            (System::Wayland(window), refresh_hz)
        } else {
            let (window, refresh_hz) = X11Window::open(desc, &server, &heard)?;
            (System::X11(window), refresh_hz)
        };
        Ok(Arc::new(Window { system, heard, refresh_hz, server, name: desc.name.clone() }))
    }

    /// Takes it from sight for good, without the device: one that hangs keeps the window's surface, and with it the window.
    pub fn hide(&self) {
        self.heard.stop.store(true, Ordering::Release);
        match &self.system {
            System::X11(window) => window.hide(),
            System::Wayland(window) => window.hide(),
        }
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The server that shows it.
    pub fn server(&self) -> &str {
        &self.server
    }

    /// Columns and rows that it has now.
    pub fn size_px(&self) -> [u32; 2] {
        *self.heard.size_px.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether some of it was covered and is not any more, since this was last asked.
    pub fn take_exposed(&self) -> bool {
        self.heard.exposed.swap(false, Ordering::AcqRel)
    }

    /// Why it is gone, if it is: closed by somebody, or its server has gone.
    pub fn gone(&self) -> Option<String> {
        self.heard.gone.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// How often its monitor shows another image, Hz, where the server says so.
    pub fn refresh_hz(&self) -> Option<f64> {
        self.refresh_hz
    }
}
