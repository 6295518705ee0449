//! The trackers of a configuration: one task each, which hears, and speaks where the protocol has it so.

use crate::bodies::Bodies;
use crate::counters;
use crate::socket::{Place, Sockets, TrackerError};
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
use tokio::runtime::Handle;
use tokio::task::JoinHandle;
use tokio::time::MissedTickBehavior;

/// Longer than any datagram, so that a length is never cut.
const BUFFER_BYTES: usize = 1 << 16;

/// How long a failing socket is left alone: an error that stays must not eat a core.
const PAUSE_AFTER_ERROR: Duration = Duration::from_millis(50);

/// How often a protocol may speak.
const TURN: Duration = Duration::from_millis(500);

/// A socket that can be closed while a task waits on it; `None` once it was.
type Socket = Arc<Mutex<Option<Sockets>>>;

/// A tracker that is listened to, until it is dropped.
struct Listening {
    place: Place,
    /// As it is.
    address: SocketAddr,
    source: Arc<Mutex<Source>>,
    socket: Socket,
    task: JoinHandle<()>,
}

impl Listening {
    /// Whether its sockets are those that a tracker asks for: an address is one tracker's alone, but for port 0, where
    /// the name decides.
    fn serves(&self, tracker: &Tracker) -> bool {
        self.place == Place::of(tracker) && (self.place.listen.port() != 0 || lock(&self.source).name() == tracker.name)
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

    fn status(&self) -> (String, TrackerStatus) {
        let kernel_dropped = lock(&self.socket).as_ref().and_then(Sockets::kernel_dropped);
        let mut source = lock(&self.source);
        let socket = counters::Socket { listen: self.address.to_string(), kernel_dropped };
        (source.name().to_owned(), source.status_of(socket))
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
        self.listening.iter().map(Listening::status).collect()
    }

    /// Where a tracker listens: what the system chose, where the configuration says port 0.
    pub fn address(&self, name: &str) -> Option<SocketAddr> {
        self.listening.iter().find(|tracker| lock(&tracker.source).name() == name).map(|tracker| tracker.address)
    }
}

fn listen(runtime: &Handle, tracker: &Tracker, bodies: &Arc<Bodies>) -> Result<Listening, TrackerError> {
    let place = Place::of(tracker);
    let sockets = Sockets::open(runtime, &tracker.name, &place)?;
    let address = sockets.address();
    tracing::info!(tracker = tracker.name, %address, protocol = tracker.protocol.as_str(), "listening for poses");
    let (socket, source) = (Arc::new(Mutex::new(Some(sockets))), Arc::new(Mutex::new(Source::new(tracker))));
    let task = runtime.spawn(hear(socket.clone(), source.clone(), bodies.clone(), place.speaks));
    Ok(Listening { place, address, source, socket, task })
}

/// Listens again where a socket was closed, with the counts of before.
fn reopen(runtime: &Handle, closed: &mut Listening, bodies: &Arc<Bodies>) {
    // Where the system chose the port, it must be that one again.
    let place = Place { listen: closed.address, ..closed.place.clone() };
    let mut source = lock(&closed.source);
    match Sockets::open(runtime, source.name(), &place) {
        Ok(sockets) => {
            closed.socket = Arc::new(Mutex::new(Some(sockets)));
            closed.task =
                runtime.spawn(hear(closed.socket.clone(), closed.source.clone(), bodies.clone(), place.speaks));
        }
        Err(error) => {
            tracing::error!(tracker = source.name(), address = %closed.address, %error, "cannot listen again");
            source.fail(&error);
        }
    }
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Hears until the socket is closed, and says what the protocol wants to have said.
async fn hear(socket: Socket, source: Arc<Mutex<Source>>, bodies: Arc<Bodies>, speaks: bool) {
    let mut buffer = vec![0; BUFFER_BYTES];
    let mut turn = tokio::time::interval(TURN);
    turn.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        let heard = tokio::select! {
            heard = poll_fn(|context| poll_datagram(&socket, context, &mut buffer)) => heard,
            _ = turn.tick(), if speaks => {
                say(&socket, &source);
                continue;
            }
        };
        match heard {
            None => return,
            Some(Ok((length, from))) => lock(&source).hear(&buffer[..length], from, &bodies, Instant::now()),
            Some(Err(error)) => {
                lock(&source).fail(&error);
                tokio::time::sleep(PAUSE_AFTER_ERROR).await;
            }
        }
    }
}

fn say(socket: &Mutex<Option<Sockets>>, source: &Mutex<Source>) {
    let sayings = lock(source).say(Instant::now());
    for saying in sayings {
        let said = lock(socket).as_ref().map_or(Ok(()), |socket| socket.say(&saying));
        if let Err(error) = said {
            lock(source).fail(&error);
        }
    }
}

/// The next datagram's length and sender; `None` of a closed socket, which is held for the time of this call alone.
fn poll_datagram(
    socket: &Mutex<Option<Sockets>>,
    context: &mut Context<'_>,
    buffer: &mut [u8],
) -> Poll<Option<io::Result<(usize, SocketAddr)>>> {
    match lock(socket).as_ref() {
        None => Poll::Ready(None),
        Some(sockets) => sockets.poll_datagram(context, buffer).map(Some),
    }
}
