//! Accepting clients, no more than the limit.

use super::engine::Engine;
use super::line::write_all;
use super::listener::{ControlError, Listener};
use super::session;
use lantern_proto::{ErrorBody, Outcome, Reply};
use std::sync::Arc;
use std::time::Duration;
use tokio::net::{UnixListener, UnixStream};
use tokio::runtime::Handle;
use tokio::sync::Semaphore;
use tokio::task::{JoinHandle, JoinSet};

/// How long accepting rests after an error, such as too many open files: one that stays must not eat a core.
const PAUSE_AFTER_ERROR: Duration = Duration::from_millis(100);

/// A socket that is served until it is dropped; then its clients are cut off and its file goes.
#[derive(Debug)]
pub struct Server {
    listener: Listener,
    task: JoinHandle<()>,
}

impl Server {
    /// Answers at a socket, on tasks of `runtime`, for at most `max_clients` at a time.
    ///
    /// # Errors
    /// [`ControlError::System`] where the runtime cannot watch the socket.
    pub fn start(
        runtime: &Handle,
        listener: Listener,
        engine: Arc<dyn Engine>,
        max_clients: usize,
    ) -> Result<Self, ControlError> {
        // A socket belongs to the runtime that it is made in.
        let _guard = runtime.enter();
        let socket = listener.try_clone().and_then(UnixListener::from_std).map_err(|source| ControlError::System {
            operation: "watch",
            path: listener.path().to_owned(),
            source,
        })?;
        tracing::info!(socket = %listener.path().display(), "answering");
        let task = runtime.spawn(accept(socket, engine, max_clients));
        Ok(Self { listener, task })
    }

    /// Where it answers.
    pub fn path(&self) -> &std::path::Path {
        self.listener.path()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// Accepts until it is aborted; its clients end with it.
async fn accept(socket: UnixListener, engine: Arc<dyn Engine>, max_clients: usize) {
    let places = Arc::new(Semaphore::new(max_clients));
    let mut sessions = JoinSet::new();
    loop {
        // Sessions that have ended are cleared away as they end, so that the set stays small.
        let accepted = tokio::select! {
            accepted = socket.accept() => accepted,
            Some(_) = sessions.join_next() => continue,
        };
        match accepted {
            Ok((stream, _)) => match places.clone().try_acquire_owned() {
                Ok(place) => {
                    let engine = engine.clone();
                    sessions.spawn(async move {
                        session::serve(stream, engine).await;
                        drop(place);
                    });
                }
                Err(_) => turn_away(&stream, max_clients).await,
            },
            Err(error) => {
                tracing::warn!(%error, "cannot accept a client");
                tokio::time::sleep(PAUSE_AFTER_ERROR).await;
            }
        }
    }
}

/// Says why, and hangs up. A new socket has room for one line, so nobody waits.
async fn turn_away(stream: &UnixStream, max_clients: usize) {
    let message = format!("all {max_clients} places are taken; hint: try again, or raise limits.max_clients");
    let error = ErrorBody::new("too-many-clients", message);
    let line = session::line_of(&Reply { id: None, outcome: Outcome::Error(error) });
    // The client may have gone already, which is as well.
    let _ = write_all(stream, &line).await;
}
