//! The sockets: one task a tracker, which hears and never answers.

use crate::bodies::Bodies;
use crate::source::Source;
use lantern_config::Tracker;
use lantern_proto::status::TrackerStatus;
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
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
        source: std::io::Error,
    },
}

/// A tracker that is listened to, until it is dropped.
struct Listening {
    /// As it was asked for; a port of 0 means any.
    asked: SocketAddr,
    /// As it is.
    address: SocketAddr,
    source: Arc<Mutex<Source>>,
    task: JoinHandle<()>,
}

impl Listening {
    /// Whether its socket is the one that a tracker asks for: an address is one tracker's alone, but for port 0, where
    /// the name decides.
    fn serves(&self, tracker: &Tracker) -> bool {
        self.asked == tracker.listen && (self.asked.port() != 0 || lock(&self.source).name() == tracker.name)
    }
}

impl Drop for Listening {
    fn drop(&mut self) {
        self.task.abort();
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
        // Every new socket is bound before anything changes.
        let is_kept = |tracker: &Tracker| self.listening.iter().any(|old| old.serves(tracker));
        let mut added = Vec::new();
        for tracker in trackers.iter().filter(|tracker| !is_kept(tracker)) {
            added.push(self.listen(tracker)?);
        }

        let mut kept = std::mem::take(&mut self.listening);
        kept.retain(|old| match trackers.iter().find(|tracker| old.serves(tracker)) {
            Some(tracker) => {
                lock(&old.source).configure(tracker);
                true
            }
            None => false,
        });
        kept.extend(added);
        self.listening = kept;
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

    fn listen(&self, tracker: &Tracker) -> Result<Listening, TrackerError> {
        let bind = || {
            let socket = std::net::UdpSocket::bind(tracker.listen)?;
            socket.set_nonblocking(true)?;
            let address = socket.local_addr()?;
            // A socket belongs to the runtime that it is made in.
            let _guard = self.runtime.enter();
            Ok((UdpSocket::from_std(socket)?, address))
        };
        let (socket, address) = bind().map_err(|source| TrackerError::Bind {
            name: tracker.name.clone(),
            listen: tracker.listen,
            source,
        })?;
        tracing::info!(tracker = tracker.name, %address, protocol = tracker.protocol.as_str(), "listening for poses");
        let source = Arc::new(Mutex::new(Source::new(tracker)));
        let task = self.runtime.spawn(hear(socket, source.clone(), self.bodies.clone()));
        Ok(Listening { asked: tracker.listen, address, source, task })
    }
}

fn lock(source: &Mutex<Source>) -> MutexGuard<'_, Source> {
    source.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Hears until it is aborted.
async fn hear(socket: UdpSocket, source: Arc<Mutex<Source>>, bodies: Arc<Bodies>) {
    let mut buffer = vec![0; BUFFER_BYTES];
    loop {
        match socket.recv_from(&mut buffer).await {
            Ok((length, from)) => lock(&source).hear(&buffer[..length], from, &bodies, Instant::now()),
            Err(error) => {
                lock(&source).fail(&error);
                tokio::time::sleep(PAUSE_AFTER_ERROR).await;
            }
        }
    }
}
