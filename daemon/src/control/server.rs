//! Accepting clients, no more than the limit.

use super::engine::Engine;
use super::listener::{ControlError, Listener};
use super::rules::Rules;
use super::session;
use lantern_proto::ErrorBody;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::UnixListener;
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
    /// Answers at a socket by its rules, on tasks of `runtime`.
    ///
    /// # Errors
    /// [`ControlError::System`] where the runtime cannot watch the socket.
    pub fn start(
        runtime: &Handle,
        listener: Listener,
        engine: Arc<dyn Engine>,
        rules: Rules,
    ) -> Result<Self, ControlError> {
        // A socket belongs to the runtime that it is made in.
        let _guard = runtime.enter();
        let socket = listener.try_clone().and_then(UnixListener::from_std).map_err(|source| ControlError::System {
            operation: "watch",
            path: listener.path().to_owned(),
            source,
        })?;
        tracing::info!(socket = %listener.path().display(), "answering");
        let task = runtime.spawn(accept(socket, engine, Arc::new(rules)));
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
async fn accept(socket: UnixListener, engine: Arc<dyn Engine>, rules: Arc<Rules>) {
    let places = Arc::new(Semaphore::new(rules.max_clients));
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
                    let (engine, rules) = (engine.clone(), rules.clone());
                    sessions.spawn(async move {
                        session::serve(stream, engine, rules).await;
                        drop(place);
                    });
                }
                Err(_) => {
                    let message = format!(
                        "all {} places are taken; hint: try again, or raise limits.max_clients",
                        rules.max_clients
                    );
                    session::turn_away(&stream, ErrorBody::new("too-many-clients", message)).await;
                }
            },
            Err(error) => {
                tracing::warn!(%error, "cannot accept a client");
                tokio::time::sleep(PAUSE_AFTER_ERROR).await;
            }
        }
    }
}
