//! The sockets: one task a tracker, which hears and never answers.

use crate::bodies::Bodies;
use crate::source::Source;
use lantern_config::Tracker;
use lantern_proto::status::TrackerStatus;
use std::collections::BTreeMap;
use std::future::poll_fn;
use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::{Duration, Instant};
use tokio::io::ReadBuf;
use tokio::net::UdpSocket;
use tokio::runtime::Handle;
use tokio::task::JoinHandle;

/// Longer than any datagram, so that a length is never cut.
const BUFFER_BYTES: usize = 1 << 16;

/// How long a failing socket is left alone: an error that stays must not eat a core.
const PAUSE_AFTER_ERROR: Duration = Duration::from_millis(50);

/// A tracker that cannot be listened to.
#[derive(Debug, thiserror::Error)]
pub enum TrackerError {
    /// Its address is taken, or not this machine's.
    #[error(
        "tracker `{name}` cannot listen at {listen}: {source}; hint: another program may have that port, or no \
             network card that address"
    )]
    Bind {
        /// The tracker.
        name: String,
        /// Its address.
        listen: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
}

/// A socket that can be closed while a task waits on it; `None` once it was.
type Socket = Arc<Mutex<Option<UdpSocket>>>;

/// A tracker that is listened to, until it is dropped.
struct Listening {
    /// As it was asked for; a port of 0 means any.
    asked: SocketAddr,
    /// As it is.
    address: SocketAddr,
    source: Arc<Mutex<Source>>,
    socket: Socket,
    task: JoinHandle<()>,
}

impl Listening {
    /// Whether its socket is the one that a tracker asks for: an address is one tracker's alone, but for port 0, where
    /// the name decides.
    fn serves(&self, tracker: &Tracker) -> bool {
        self.asked == tracker.listen && (self.asked.port() != 0 || lock(&self.source).name() == tracker.name)
    }

    /// Whether its socket keeps another from an address: the same port, and no two cards.
    fn stands_in_the_way_of(&self, other: SocketAddr) -> bool {
        let (ip, other_ip) = (self.address.ip(), other.ip());
        self.address.port() == other.port() && (ip == other_ip || ip.is_unspecified() || other_ip.is_unspecified())
    }

    /// Gives the address back to the system before it returns. An aborted task lets go of what it holds some time
    /// later, so the socket is taken from it.
    fn close(&self) {
        self.task.abort();
        lock(&self.socket).take();
    }
}

impl Drop for Listening {
    fn drop(&mut self) {
        self.close();
    }
}

/// All trackers of the configuration.
pub struct Trackers {
    runtime: Handle,
    bodies: Arc<Bodies>,
    listening: Vec<Listening>,
}

impl Trackers {
    /// Listens to each, on tasks of `runtime`.
    ///
    /// # Errors
    /// The first whose address cannot be bound; then none is listened to.
    pub fn start(runtime: Handle, trackers: &[Tracker], bodies: Arc<Bodies>) -> Result<Self, TrackerError> {
        let mut this = Self { runtime, bodies, listening: Vec::new() };
        this.configure(trackers)?;
        Ok(this)
    }

    /// Takes another configuration over. A tracker at an address that is listened to already keeps its socket, and under
    /// the same name its counts.
    ///
    /// # Errors
    /// The first whose address cannot be bound; then everything is as it was.
    pub fn configure(&mut self, trackers: &[Tracker]) -> Result<(), TrackerError> {
        let is_kept = |tracker: &&Tracker| self.listening.iter().any(|old| old.serves(tracker));
        let (kept, new): (Vec<&Tracker>, Vec<&Tracker>) = trackers.iter().partition(is_kept);

        // A socket that goes and stands in the way of one that comes must go first.
        let goes = |old: &&mut Listening| !kept.iter().any(|tracker| old.serves(tracker));
        let in_the_way = |old: &&mut Listening| new.iter().any(|tracker| old.stands_in_the_way_of(tracker.listen));
        let mut closed: Vec<&mut Listening> = self.listening.iter_mut().filter(goes).filter(in_the_way).collect();
        closed.iter().for_each(|old| old.close());

        // Every new socket is bound before anything else changes. Those bound so far are closed again before the old
        // ones come back, whose addresses they may hold.
        let (runtime, bodies) = (&self.runtime, &self.bodies);
        let added: Result<Vec<Listening>, TrackerError> =
            new.iter().map(|tracker| listen(runtime, tracker, bodies)).collect();
        let added = match added {
            Ok(added) => added,
            Err(error) => {
                closed.iter_mut().for_each(|old| reopen(runtime, old, bodies));
                return Err(error);
            }
        };

        self.listening.retain(|old| match kept.iter().find(|tracker| old.serves(tracker)) {
            Some(tracker) => {
                lock(&old.source).configure(tracker);
                true
            }
            None => false,
        });
        self.listening.extend(added);
        Ok(())
    }

    /// For `status`, by name.
    pub fn status(&self) -> BTreeMap<String, TrackerStatus> {
        let status = |tracker: &Listening| {
            let mut source = lock(&tracker.source);
            (source.name().to_owned(), source.status(tracker.address.to_string()))
        };
        self.listening.iter().map(status).collect()
    }

    /// Where a tracker listens: what the system chose, where the configuration says port 0.
    pub fn address(&self, name: &str) -> Option<SocketAddr> {
        self.listening.iter().find(|tracker| lock(&tracker.source).name() == name).map(|tracker| tracker.address)
    }
}

fn listen(runtime: &Handle, tracker: &Tracker, bodies: &Arc<Bodies>) -> Result<Listening, TrackerError> {
    let opened = bind(runtime, tracker.listen).and_then(|socket| Ok((socket.local_addr()?, socket)));
    let (address, socket) =
        opened.map_err(|source| TrackerError::Bind { name: tracker.name.clone(), listen: tracker.listen, source })?;
    tracing::info!(tracker = tracker.name, %address, protocol = tracker.protocol.as_str(), "listening for poses");
    let (socket, source) = (Arc::new(Mutex::new(Some(socket))), Arc::new(Mutex::new(Source::new(tracker))));
    let task = runtime.spawn(hear(socket.clone(), source.clone(), bodies.clone()));
    Ok(Listening { asked: tracker.listen, address, source, socket, task })
}

/// Listens again where a socket was closed, with the counts of before.
fn reopen(runtime: &Handle, closed: &mut Listening, bodies: &Arc<Bodies>) {
    match bind(runtime, closed.address) {
        Ok(socket) => {
            closed.socket = Arc::new(Mutex::new(Some(socket)));
            closed.task = runtime.spawn(hear(closed.socket.clone(), closed.source.clone(), bodies.clone()));
        }
        Err(error) => {
            let mut source = lock(&closed.source);
            tracing::error!(tracker = source.name(), address = %closed.address, %error, "cannot listen again");
            source.fail(&error);
        }
    }
}

fn bind(runtime: &Handle, address: SocketAddr) -> io::Result<UdpSocket> {
    let socket = std::net::UdpSocket::bind(address)?;
    socket.set_nonblocking(true)?;
    // A socket belongs to the runtime that it is made in.
    let _guard = runtime.enter();
    UdpSocket::from_std(socket)
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Hears until the socket is closed.
async fn hear(socket: Socket, source: Arc<Mutex<Source>>, bodies: Arc<Bodies>) {
    let mut buffer = vec![0; BUFFER_BYTES];
    while let Some(heard) = poll_fn(|context| poll_datagram(&socket, context, &mut buffer)).await {
        match heard {
            Ok((length, from)) => lock(&source).hear(&buffer[..length], from, &bodies, Instant::now()),
            Err(error) => {
                lock(&source).fail(&error);
                tokio::time::sleep(PAUSE_AFTER_ERROR).await;
            }
        }
    }
}

/// The next datagram's length and sender; `None` of a closed socket, which is held for the time of this call alone.
fn poll_datagram(
    socket: &Mutex<Option<UdpSocket>>,
    context: &mut Context<'_>,
    buffer: &mut [u8],
) -> Poll<Option<io::Result<(usize, SocketAddr)>>> {
    let socket = lock(socket);
    let Some(socket) = socket.as_ref() else { return Poll::Ready(None) };
    let mut buffer = ReadBuf::new(buffer);
    socket.poll_recv_from(context, &mut buffer).map(|from| Some(from.map(|from| (buffer.filled().len(), from))))
}
