//! A window of a Wayland compositor, by xdg-shell.

use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::Arc;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use smithay_client_toolkit::compositor::{CompositorHandler, CompositorState};
use smithay_client_toolkit::dispatch2::Dispatch2;
use smithay_client_toolkit::output::{OutputHandler, OutputInfo, OutputState};
use smithay_client_toolkit::registry::{ProvidesRegistryState, RegistryState};
use smithay_client_toolkit::seat::{Capability, SeatHandler, SeatState};
use smithay_client_toolkit::shell::WaylandSurface;
use smithay_client_toolkit::shell::xdg::XdgShell;
use smithay_client_toolkit::shell::xdg::window::{Window, WindowConfigure, WindowDecorations, WindowHandler};
use smithay_client_toolkit::{delegate_dispatch2, delegate_registry, registry_handlers};
use wayland_client::backend::ObjectId;
use wayland_client::globals::registry_queue_init;
use wayland_client::protocol::wl_output::{Transform, WlOutput};
use wayland_client::protocol::wl_pointer::{self, WlPointer};
use wayland_client::protocol::wl_seat::WlSeat;
use wayland_client::protocol::wl_surface::WlSurface;
use wayland_client::{Connection, EventQueue, Proxy, QueueHandle};

use super::{Heard, Listener, NAP, Placement, WindowDesc, WindowError};

/// The connection and the window on it. The listener goes first, then the window, then the connection.
pub(crate) struct WaylandWindow {
    _listener: Listener,
    window: Window,
    pub(crate) connection: Connection,
}

impl WaylandWindow {
    pub(super) fn open(
        desc: &WindowDesc,
        server: &str,
        heard: &Arc<Heard>,
    ) -> Result<(WaylandWindow, Option<f64>), WindowError> {
        let refused = |detail: String| WindowError::Server {
            window: desc.name.clone(),
            server: format!("the Wayland compositor {server}"),
            detail,
        };
        let socket = UnixStream::connect(socket_path(server)).map_err(|error| refused(error.to_string()))?;
        let connection = Connection::from_socket(socket).map_err(|error| refused(error.to_string()))?;
        let (globals, mut events) = registry_queue_init(&connection).map_err(|error| refused(error.to_string()))?;
        let queue = events.handle();
        let compositor = CompositorState::bind(&globals, &queue).map_err(|error| refused(error.to_string()))?;
        let shell = XdgShell::bind(&globals, &queue).map_err(|error| refused(error.to_string()))?;
        let mut ears = Ears {
            registry: RegistryState::new(&globals),
            outputs: OutputState::new(&globals, &queue),
            seats: SeatState::new(&globals, &queue),
            heard: Arc::clone(heard),
            wanted_px: desc.size_px,
            scale: 1,
            logical: None,
            configured: false,
            place: None,
        };
        // The outputs say who they are.
        events.roundtrip(&mut ears).map_err(|error| refused(error.to_string()))?;
        let outputs: Vec<(WlOutput, OutputInfo)> =
            ears.outputs.outputs().filter_map(|output| Some((output.clone(), ears.outputs.info(&output)?))).collect();
        let output = match &desc.placement {
            Placement::Fullscreen(Some(wanted)) => {
                let found = outputs.iter().find(|(_, info)| name_of(info) == *wanted);
                Some(found.ok_or_else(|| WindowError::NoMonitor {
                    window: desc.name.clone(),
                    monitor: wanted.clone(),
                    have: outputs.iter().map(|(_, info)| name_of(info)).collect::<Vec<_>>().join(", "),
                })?)
            }
            Placement::Fullscreen(None) | Placement::Anywhere => None,
        };
        let (_, info) = output.or(outputs.first()).ok_or_else(|| refused("it has no output".into()))?;
        let current = info.modes.iter().find(|mode| mode.current);
        let refresh_hz = current.map(|mode| f64::from(mode.refresh_rate) / 1000.0).filter(|hz| *hz > 0.0);

        if matches!(desc.placement, Placement::Fullscreen(Some(_))) {
            ears.place = output.map(|(output, _)| output.clone());
        }
        let surface = compositor.create_surface(&queue);
        let window = shell.create_window(surface, WindowDecorations::None, &queue);
        window.set_title(format!("Lantern: {}", desc.name));
        window.set_app_id("lanternd");
        match &desc.placement {
            Placement::Fullscreen(_) => window.set_fullscreen(output.map(|(output, _)| output)),
            Placement::Anywhere => {
                // A calibration is for so many pixels and no others.
                window.set_min_size(Some(desc.size_px.into()));
                window.set_max_size(Some(desc.size_px.into()));
            }
        }
        window.commit();

        // Nothing may be shown before the compositor has said how large it is.
        while !ears.configured {
            events.blocking_dispatch(&mut ears).map_err(|error| refused(error.to_string()))?;
        }
        let listener = Listener::start(desc, heard, move |_| listen(&mut events, &mut ears))
            .map_err(|error| refused(error.to_string()))?;
        Ok((WaylandWindow { _listener: listener, window, connection }, refresh_hz))
    }

    pub(super) fn hide(&self) {
        let surface = self.window.wl_surface();
        surface.attach(None, 0, 0);
        surface.commit();
        // Where the compositor has gone, so has the window.
        let _ = self.connection.flush();
    }

    /// The surface, while the window lives.
    pub(crate) fn surface(&self) -> ObjectId {
        self.window.wl_surface().id()
    }
}

/// A monitor's name, or, by an old compositor's word, what it is.
fn name_of(info: &OutputInfo) -> String {
    info.name.clone().unwrap_or_else(|| info.model.clone())
}

/// Where a compositor listens: a path, or a name in the user's runtime folder.
fn socket_path(server: &str) -> PathBuf {
    let folder = std::env::var_os("XDG_RUNTIME_DIR").unwrap_or_default();
    PathBuf::from(folder).join(server)
}

/// Hears the compositor until the window, or the compositor, is gone.
fn listen(events: &mut EventQueue<Ears>, ears: &mut Ears) {
    while !ears.heard.is_stopping() {
        if let Err(error) = events.dispatch_pending(ears).and_then(|_| Ok(events.flush()?)) {
            return ears.heard.lose(format!("its compositor has gone ({error})"));
        }
        // None: more has come meanwhile.
        let Some(guard) = events.prepare_read() else { continue };
        let socket = guard.connection_fd();
        let mut ready = [PollFd::from_borrowed_fd(socket.as_fd(), PollFlags::IN)];
        let nap = Timespec::try_from(NAP).ok();
        match poll(&mut ready, nap.as_ref()) {
            Ok(0) => {}
            // What cannot be read is said by the next look at what is pending.
            Ok(_) => drop(guard.read()),
            Err(_) => std::thread::sleep(NAP),
        }
    }
}

/// What the compositor tells, and whom.
struct Ears {
    registry: RegistryState,
    outputs: OutputState,
    seats: SeatState,
    heard: Arc<Heard>,
    wanted_px: [u32; 2],
    /// Pixels to a unit of the compositor's.
    scale: u32,
    /// The size that it wants, in its units; None where it leaves that to us.
    logical: Option<[u32; 2]>,
    configured: bool,
    /// The monitor that it has to stay on. On another one it would light another projector's props.
    place: Option<WlOutput>,
}

impl Ears {
    fn resize(&self) {
        self.heard.resize(self.logical.map_or(self.wanted_px, |size| size.map(|side| side * self.scale)));
    }
}

impl CompositorHandler for Ears {
    fn scale_factor_changed(&mut self, _: &Connection, _: &QueueHandle<Self>, surface: &WlSurface, factor: i32) {
        // A projector's pixels are the device's own, not some enlarged ones.
        surface.set_buffer_scale(factor);
        self.scale = factor.unsigned_abs().max(1);
        self.resize();
    }

    fn transform_changed(&mut self, _: &Connection, _: &QueueHandle<Self>, _: &WlSurface, _: Transform) {}

    fn frame(&mut self, _: &Connection, _: &QueueHandle<Self>, _: &WlSurface, _: u32) {}

    fn surface_enter(&mut self, _: &Connection, _: &QueueHandle<Self>, _: &WlSurface, output: &WlOutput) {
        if self.place.as_ref().is_some_and(|place| place != output) {
            self.heard.lose("it was put on another monitor");
        }
        self.heard.expose();
    }

    fn surface_leave(&mut self, _: &Connection, _: &QueueHandle<Self>, _: &WlSurface, _: &WlOutput) {}
}

impl WindowHandler for Ears {
    fn request_close(&mut self, _: &Connection, _: &QueueHandle<Self>, _: &Window) {
        self.heard.lose("it was closed");
    }

    fn configure(&mut self, _: &Connection, _: &QueueHandle<Self>, _: &Window, configure: WindowConfigure, _: u32) {
        self.logical = match configure.new_size {
            (Some(width), Some(height)) => Some([width.get(), height.get()]),
            _ => None,
        };
        self.configured = true;
        self.resize();
    }
}

impl OutputHandler for Ears {
    fn output_state(&mut self) -> &mut OutputState {
        &mut self.outputs
    }

    fn new_output(&mut self, _: &Connection, _: &QueueHandle<Self>, _: WlOutput) {}

    fn update_output(&mut self, _: &Connection, _: &QueueHandle<Self>, _: WlOutput) {}

    fn output_destroyed(&mut self, _: &Connection, _: &QueueHandle<Self>, output: WlOutput) {
        if self.place.as_ref() == Some(&output) {
            self.heard.lose("its monitor has gone");
        }
    }
}

impl SeatHandler for Ears {
    fn seat_state(&mut self) -> &mut SeatState {
        &mut self.seats
    }

    fn new_seat(&mut self, _: &Connection, _: &QueueHandle<Self>, _: WlSeat) {}

    fn new_capability(&mut self, _: &Connection, queue: &QueueHandle<Self>, seat: WlSeat, capability: Capability) {
        if capability == Capability::Pointer {
            seat.get_pointer(queue, Hidden);
        }
    }

    fn remove_capability(&mut self, _: &Connection, _: &QueueHandle<Self>, _: WlSeat, _: Capability) {}

    fn remove_seat(&mut self, _: &Connection, _: &QueueHandle<Self>, _: WlSeat) {}
}

/// A pointer that shows nothing where it enters: it would be light on a prop.
struct Hidden;

impl Dispatch2<WlPointer, Ears> for Hidden {
    fn event(
        &self,
        _: &mut Ears,
        pointer: &WlPointer,
        event: wl_pointer::Event,
        _: &Connection,
        _: &QueueHandle<Ears>,
    ) {
        if let wl_pointer::Event::Enter { serial, .. } = event {
            pointer.set_cursor(serial, None, 0, 0);
        }
    }
}

impl ProvidesRegistryState for Ears {
    fn registry(&mut self) -> &mut RegistryState {
        &mut self.registry
    }

    registry_handlers![OutputState, SeatState];
}

delegate_registry!(Ears);
delegate_dispatch2!(Ears);
