//! Tests from outside: the oracle in f64, the harness, and what must hold.

pub mod client;
pub mod desktops;
pub mod faults;
pub mod gpu;
pub mod harness;
pub mod image;
pub mod lab;
pub mod lenses;
pub mod models;
pub mod oracle;
pub mod random;
pub mod senders;
pub mod stage;
