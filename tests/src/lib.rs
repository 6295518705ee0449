//! Tests from outside: the oracle in f64, the harness, and what must hold.
