//! Reading little-endian numbers one after the other, and never past the end.

use crate::protocol::{Refusal, bad};
use glam::DVec3;

/// What is left of a datagram.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bytes<'a> {
    rest: &'a [u8],
}

impl<'a> Bytes<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    /// How many are left.
    pub(crate) fn len(&self) -> usize {
        self.rest.len()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    /// The next `count`, for `what`.
    pub(crate) fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8], Refusal> {
        let Some((taken, rest)) = self.rest.split_at_checked(count) else {
            return bad(format!("ends inside {what}: {count} bytes wanted, {} left", self.len()));
        };
        self.rest = rest;
        Ok(taken)
    }

    /// The text before the next zero, which is passed over.
    pub(crate) fn text(&mut self, what: &str) -> Result<&'a [u8], Refusal> {
        let Some(end) = self.rest.iter().position(|byte| *byte == 0) else {
            return bad(format!("ends inside {what}"));
        };
        let text = &self.rest[..end];
        self.rest = &self.rest[end + 1..];
        Ok(text)
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], Refusal> {
        let taken = self.take(N, what)?;
        Ok(std::array::from_fn(|at| taken[at]))
    }

    pub(crate) fn u16(&mut self, what: &str) -> Result<u16, Refusal> {
        self.array(what).map(u16::from_le_bytes)
    }

    pub(crate) fn u32(&mut self, what: &str) -> Result<u32, Refusal> {
        self.array(what).map(u32::from_le_bytes)
    }

    pub(crate) fn u64(&mut self, what: &str) -> Result<u64, Refusal> {
        self.array(what).map(u64::from_le_bytes)
    }

    pub(crate) fn f32(&mut self, what: &str) -> Result<f64, Refusal> {
        self.array(what).map(|bytes| f64::from(f32::from_le_bytes(bytes)))
    }

    pub(crate) fn f64(&mut self, what: &str) -> Result<f64, Refusal> {
        self.array(what).map(f64::from_le_bytes)
    }

    /// Three f32.
    pub(crate) fn vector(&mut self, what: &str) -> Result<DVec3, Refusal> {
        Ok(DVec3::new(self.f32(what)?, self.f32(what)?, self.f32(what)?))
    }

    /// A count of things of at least `bytes` each, that fit into what is left.
    pub(crate) fn count(&mut self, bytes: usize, what: &str) -> Result<usize, Refusal> {
        let count = self.u32(what)?;
        // A count that fits no usize fits no datagram either.
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        if count > self.len() / bytes {
            return bad(format!("claims {count} {what} in {} bytes", self.len()));
        }
        Ok(count)
    }
}
