//! The crate from outside, on a real device, with the validation layer and its synchronisation checks: any message of
//! it fails the test.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "helpers of tests fail a test by panicking, as tests do")]

mod cache;
mod common;
mod compute;
mod graphics;
mod misuse;
mod order;
mod ray_query;
mod start;
