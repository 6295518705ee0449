//! What a client hears of unasked, written while something else is awaited.

use std::future::pending;
use std::io;
use std::pin::pin;
use std::sync::Arc;

use lantern_proto::Event;
use tokio::net::UnixStream;

use super::events::Subscription;
use super::line::write_all;
use crate::feed::Reader;

/// What a client hears of unasked.
#[derive(Default)]
pub(super) struct Hears {
    pub(super) subscription: Option<Subscription>,
    /// Pictures in memory that it has imported.
    pub(super) reader: Option<Reader>,
}

impl Hears {
    /// The next event that it subscribed to; never, where there is none.
    async fn event(&self) -> Arc<Event> {
        match &self.subscription {
            Some(subscription) => subscription.next().await,
            None => pending().await,
        }
    }

    /// The next picture that is its own; never, where there is none.
    async fn picture(&self) -> Arc<Event> {
        match &self.reader {
            Some(reader) => Arc::new(reader.next().await),
            None => pending().await,
        }
    }
}

/// Waits for something, and writes what the client hears of meanwhile.
pub(super) async fn beside_events<T>(
    stream: &UnixStream,
    hears: &Hears,
    awaited: impl Future<Output = T>,
) -> io::Result<T> {
    let mut awaited = pin!(awaited);
    loop {
        let event = tokio::select! {
            done = &mut awaited => return Ok(done),
            event = hears.event() => event,
            event = hears.picture() => event,
        };
        match serde_json::to_vec(&*event) {
            Ok(mut line) => {
                line.push(b'\n');
                write_all(stream, &line).await?;
            }
            Err(error) => tracing::error!(%error, "an event cannot be written as JSON"),
        }
    }
}
