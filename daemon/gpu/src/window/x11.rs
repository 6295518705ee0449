//! A window of an X11 server, by its core protocol, RandR (monitors) and the hints that window managers agree upon (EWMH).

use std::ffi::CString;
use std::os::fd::AsFd;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use x11rb::connection::{Connection, RequestConnection};
use x11rb::errors::ReplyOrIdError;
use x11rb::properties::WmSizeHints;
use x11rb::protocol::Event;
use x11rb::protocol::randr::{self, ConnectionExt as _};
use x11rb::protocol::xproto::{
    AtomEnum, ConnectionExt as _, CreateGCAux, CreateWindowAux, EventMask, PropMode, Rectangle, Screen, WindowClass,
};
use x11rb::wrapper::ConnectionExt as _;
use x11rb::xcb_ffi::{XCBConnection, load_libxcb};

use super::{Heard, Listener, NAP, Placement, WindowDesc, WindowError};

/// How often a window looks whether its monitor is still where it was.
const LOOK: Duration = Duration::from_secs(1);

x11rb::atom_manager! {
    /// Names that have to be turned into numbers.
    Atoms: AtomsCookie {
        WM_PROTOCOLS,
        WM_DELETE_WINDOW,
        UTF8_STRING,
        _NET_WM_NAME,
        _NET_WM_STATE,
        _NET_WM_STATE_FULLSCREEN,
        _NET_WM_BYPASS_COMPOSITOR,
    }
}

/// The connection and the window on it. The listener goes first, then the window, then the connection.
pub(crate) struct X11Window {
    _listener: Listener,
    pub(crate) raw: u32,
    pub(crate) connection: Arc<XCBConnection>,
}

/// A monitor's place on the screen, px, and how often it shows another image.
struct Monitor {
    name: String,
    rectangle: Rectangle,
    refresh_hz: Option<f64>,
}

impl X11Window {
    pub(super) fn open(
        desc: &WindowDesc,
        server: &str,
        heard: &Arc<Heard>,
    ) -> Result<(X11Window, Option<f64>), WindowError> {
        let refused = |detail: String| WindowError::Server {
            window: desc.name.clone(),
            server: format!("the X11 server {server}"),
            detail,
        };
        load_libxcb().map_err(|error| refused(format!("{error}; hint: install libxcb1")))?;
        let address = CString::new(server).map_err(|error| refused(error.to_string()))?;
        let (connection, screen) =
            XCBConnection::connect(Some(&address)).map_err(|error| refused(error.to_string()))?;
        let connection = Arc::new(connection);
        let screen = &connection.setup().roots[screen];

        let monitors = monitors(&connection, screen.root).map_err(|error| refused(error.to_string()))?;
        let monitor = match &desc.placement {
            Placement::Fullscreen(Some(name)) => {
                let found = monitors.iter().find(|monitor| monitor.name == *name);
                Some(found.ok_or_else(|| WindowError::NoMonitor {
                    window: desc.name.clone(),
                    monitor: name.clone(),
                    have: monitors.iter().map(|monitor| monitor.name.as_str()).collect::<Vec<_>>().join(", "),
                })?)
            }
            Placement::Fullscreen(None) => monitors.first(),
            Placement::Anywhere => None,
        };
        let refresh_hz = monitor.or(monitors.first()).and_then(|monitor| monitor.refresh_hz);

        let (raw, atoms) = create(&connection, screen, desc, monitor).map_err(|error| refused(error.to_string()))?;
        let place = match (&desc.placement, monitor) {
            (Placement::Fullscreen(Some(_)), Some(monitor)) => Some((monitor.name.clone(), monitor.rectangle)),
            _ => None,
        };
        let (listening, root) = (Arc::clone(&connection), screen.root);
        let own = Own { raw, root, atoms, place };
        let listener = Listener::start(desc, heard, move |heard| listen(&listening, &own, &heard))
            .map_err(|error| refused(error.to_string()))?;
        Ok((X11Window { _listener: listener, raw, connection }, refresh_hz))
    }
}

impl X11Window {
    pub(super) fn hide(&self) {
        // Where the server has gone, so has the window.
        let _ = self.connection.unmap_window(self.raw);
        let _ = self.connection.flush();
    }
}

impl Drop for X11Window {
    fn drop(&mut self) {
        // Where the server has gone, so has the window.
        let _ = self.connection.destroy_window(self.raw);
        let _ = self.connection.flush();
    }
}

/// The monitors of a screen; none on a server without RandR 1.5.
fn monitors(connection: &XCBConnection, root: u32) -> Result<Vec<Monitor>, ReplyOrIdError> {
    if connection.extension_information(randr::X11_EXTENSION_NAME)?.is_none() {
        return Ok(Vec::new());
    }
    let modes = connection.randr_get_screen_resources_current(root)?.reply()?;
    let refresh_hz = |output: u32| {
        let crtc = connection.randr_get_output_info(output, modes.config_timestamp).ok()?.reply().ok()?.crtc;
        let mode = connection.randr_get_crtc_info(crtc, modes.config_timestamp).ok()?.reply().ok()?.mode;
        let mode = modes.modes.iter().find(|known| known.id == mode)?;
        let dots = f64::from(mode.htotal) * f64::from(mode.vtotal);
        (dots > 0.0 && mode.dot_clock > 0).then(|| f64::from(mode.dot_clock) / dots)
    };
    let listed = connection.randr_get_monitors(root, true)?.reply()?.monitors;
    listed
        .into_iter()
        .map(|monitor| {
            let name = connection.get_atom_name(monitor.name)?.reply()?.name;
            let rectangle = Rectangle { x: monitor.x, y: monitor.y, width: monitor.width, height: monitor.height };
            let refresh_hz = monitor.outputs.first().and_then(|output| refresh_hz(*output));
            Ok(Monitor { name: String::from_utf8_lossy(&name).into_owned(), rectangle, refresh_hz })
        })
        .collect()
}

fn create(
    connection: &XCBConnection,
    screen: &Screen,
    desc: &WindowDesc,
    monitor: Option<&Monitor>,
) -> Result<(u32, Atoms), ReplyOrIdError> {
    let atoms = Atoms::new(connection)?.reply()?;
    let fullscreen = matches!(desc.placement, Placement::Fullscreen(_));
    let side = |px: u32| u16::try_from(px).unwrap_or(u16::MAX);
    let whole = Rectangle { x: 0, y: 0, width: screen.width_in_pixels, height: screen.height_in_pixels };
    let place = match monitor {
        Some(monitor) => monitor.rectangle,
        None if fullscreen => whole,
        None => Rectangle { x: 0, y: 0, width: side(desc.size_px[0]), height: side(desc.size_px[1]) },
    };

    // Black until the first image is there, and without a pointer on it: a pointer would be light on a prop.
    let cursor = no_cursor(connection, screen)?;
    let aux = CreateWindowAux::new()
        .background_pixel(screen.black_pixel)
        .cursor(cursor)
        .event_mask(EventMask::STRUCTURE_NOTIFY | EventMask::EXPOSURE);
    let raw = connection.generate_id()?;
    let Rectangle { x, y, width, height } = place;
    let (class, depth) = (WindowClass::INPUT_OUTPUT, x11rb::COPY_DEPTH_FROM_PARENT);
    connection.create_window(depth, raw, screen.root, x, y, width, height, 0, class, screen.root_visual, &aux)?;
    connection.free_cursor(cursor)?;

    let title = format!("Lantern: {}", desc.name);
    let replace = PropMode::REPLACE;
    connection.change_property8(replace, raw, AtomEnum::WM_NAME, AtomEnum::STRING, title.as_bytes())?;
    connection.change_property8(replace, raw, atoms._NET_WM_NAME, atoms.UTF8_STRING, title.as_bytes())?;
    connection.change_property8(replace, raw, AtomEnum::WM_CLASS, AtomEnum::STRING, b"lanternd\0Lantern\0")?;
    connection.change_property32(replace, raw, atoms.WM_PROTOCOLS, AtomEnum::ATOM, &[atoms.WM_DELETE_WINDOW])?;
    let mut hints = WmSizeHints::new();
    if fullscreen {
        let state = [atoms._NET_WM_STATE_FULLSCREEN];
        connection.change_property32(replace, raw, atoms._NET_WM_STATE, AtomEnum::ATOM, &state)?;
        connection.change_property32(replace, raw, atoms._NET_WM_BYPASS_COMPOSITOR, AtomEnum::CARDINAL, &[1])?;
        hints.position = Some((x11rb::properties::WmSizeHintsSpecification::UserSpecified, x.into(), y.into()));
    } else {
        // A calibration is for so many pixels and no others.
        let size = (i32::from(width), i32::from(height));
        (hints.min_size, hints.max_size) = (Some(size), Some(size));
    }
    hints.set_normal_hints(connection, raw)?;
    connection.map_window(raw)?;
    connection.flush()?;
    Ok((raw, atoms))
}

/// A pointer of one pixel that is not drawn.
fn no_cursor(connection: &XCBConnection, screen: &Screen) -> Result<u32, ReplyOrIdError> {
    let (pixmap, context, cursor) = (connection.generate_id()?, connection.generate_id()?, connection.generate_id()?);
    connection.create_pixmap(1, pixmap, screen.root, 1, 1)?;
    connection.create_gc(context, pixmap, &CreateGCAux::new().foreground(0))?;
    let whole = Rectangle { x: 0, y: 0, width: 1, height: 1 };
    connection.poly_fill_rectangle(pixmap, context, &[whole])?;
    connection.create_cursor(cursor, pixmap, pixmap, 0, 0, 0, 0, 0, 0, 0, 0)?;
    connection.free_gc(context)?;
    connection.free_pixmap(pixmap)?;
    Ok(cursor)
}

/// What a window's thread has to know of it.
struct Own {
    raw: u32,
    root: u32,
    atoms: Atoms,
    /// The monitor that it has to stay on.
    place: Option<(String, Rectangle)>,
}

impl Own {
    /// Whether its monitor is where it was. A window that the server has put elsewhere would light another projector's props.
    fn is_in_place(&self, connection: &XCBConnection) -> bool {
        let Some((name, place)) = &self.place else { return true };
        // A server that does not say is heard again soon.
        let Ok(monitors) = monitors(connection, self.root) else { return true };
        let sides = |of: &Rectangle| (of.x, of.y, of.width, of.height);
        monitors.iter().any(|monitor| monitor.name == *name && sides(&monitor.rectangle) == sides(place))
    }
}

/// Hears the server until the window, or the server, is gone.
fn listen(connection: &XCBConnection, own: &Own, heard: &Heard) {
    let Own { raw, atoms, .. } = own;
    let raw = *raw;
    let mut looked = Instant::now();
    while !heard.is_stopping() {
        // Servers do not tell of all that happens to monitors.
        if own.place.is_some() && looked.elapsed() > LOOK {
            looked = Instant::now();
            if !own.is_in_place(connection) {
                return heard.lose("its monitor has gone, or stands elsewhere");
            }
        }
        loop {
            match connection.poll_for_event() {
                Ok(None) => break,
                Ok(Some(Event::ConfigureNotify(event))) if event.window == raw => {
                    heard.resize([event.width.into(), event.height.into()]);
                }
                Ok(Some(Event::Expose(event))) if event.window == raw && event.count == 0 => heard.expose(),
                Ok(Some(Event::ClientMessage(event)))
                    if event.type_ == atoms.WM_PROTOCOLS && event.data.as_data32()[0] == atoms.WM_DELETE_WINDOW =>
                {
                    return heard.lose("it was closed");
                }
                Ok(Some(Event::DestroyNotify(event))) if event.window == raw => return heard.lose("it was destroyed"),
                Ok(Some(_)) => {}
                Err(error) => return heard.lose(format!("its server has gone ({error})")),
            }
        }
        let mut ready = [PollFd::from_borrowed_fd(connection.as_fd(), PollFlags::IN)];
        // One that cannot be polled is asked again after the nap, and says then what is wrong.
        let nap = Timespec::try_from(NAP).ok();
        if poll(&mut ready, nap.as_ref()).is_err() {
            std::thread::sleep(NAP);
        }
    }
}
