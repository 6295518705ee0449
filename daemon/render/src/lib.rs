//! The passes, their order, and what each change makes stale.
