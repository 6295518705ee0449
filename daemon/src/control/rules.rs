//! What the socket asks of its clients, and what it gives them at most.

use tokio::sync::Semaphore;

use super::door::Door;

/// Pictures that wait in memory to be read, of all clients together: each may be a hundred megabytes.
const MAX_PICTURES: usize = 4;

/// Who may come, how many, and how much of them is taken in.
#[derive(Debug)]
pub struct Rules {
    /// Who.
    pub door: Door,
    /// At a time.
    pub max_clients: usize,
    /// Of each client; one that asks more is read more slowly.
    pub max_requests_per_s: u32,
    /// Held by each who has a picture made, until it is read.
    pub(super) pictures: Semaphore,
}

impl Rules {
    /// For so many clients, and so many requests a second of each.
    pub fn new(door: Door, max_clients: u32, max_requests_per_s: u32) -> Self {
        let max_clients = max_clients as usize;
        Self { door, max_clients, max_requests_per_s, pictures: Semaphore::new(MAX_PICTURES) }
    }
}
