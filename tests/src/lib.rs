//! Tests from outside: the oracle in f64, the harness, and what must hold.

pub mod oracle;
pub mod stage;
