//! The control socket (CONTRACT, "Socket protocol"): one JSON object a line, over a Unix stream socket.
//!
//! - [`engine`]: what the socket asks of the daemon;
//! - [`events`]: what subscribers hear of;
//! - `listener`: the socket file, of which one daemon at a time is the owner;
//! - `door`: who may come in;
//! - `rules`: what is asked of clients, and what they get at most;
//! - `server`: accepting clients, no more than the limit;
//! - `session`: one client, its requests in order;
//! - `pace`: how fast it is read;
//! - `hears`: what it hears of unasked: events, and pictures that it has imported;
//! - `handed`: edits that are too long for a line, in a memfd;
//! - `line`: lines in, bytes out, neither without bounds.
//!
//! Everything here runs on tokio and waits for clients; the engine's methods run on its blocking threads, so that a
//! client never waits for another one's request, and no frame ever waits for a client.

mod door;
pub mod engine;
pub mod events;
mod handed;
mod hears;
mod line;
mod listener;
mod pace;
mod rules;
mod server;
mod session;

pub use door::{Door, GroupError};
pub use engine::{Engine, Picture};
pub use events::{Events, Subscription};
pub use listener::{ControlError, Listener};
pub use rules::Rules;
pub use server::Server;
