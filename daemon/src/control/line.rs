//! Lines in and bytes out, over a stream whose other end may be hostile: both are bounded in memory and in time.

use lantern_proto::MAX_LINE_BYTES;
use rustix::net::{RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, recvmsg};
use rustix::net::{SendAncillaryBuffer, SendAncillaryMessage, SendFlags, sendmsg};
use std::io::{self, IoSlice, IoSliceMut};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, OwnedFd};
use std::time::{Duration, Instant};
use tokio::io::Interest;
use tokio::net::UnixStream;
use tokio::time::timeout;

use super::handed::{Handed, MAX_WAITING};

/// How long a client may leave its end of the socket full before it is dropped.
pub(crate) const WRITE_PATIENCE: Duration = Duration::from_secs(3);

/// The slowest that a client may take in what is long: it waits in memory for as long.
const SLOWEST_BYTES_PER_S: f64 = 256.0 * 1024.0;

/// What is read at a time.
const CHUNK_BYTES: usize = 64 << 10;

/// What a client said.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Said {
    /// A line, its newline left off.
    Line(Vec<u8>),
    /// More than a line may hold.
    TooLong,
    /// Nothing more will come.
    End,
}

/// Cuts what a client sends into lines. Holds at most one line and one chunk.
#[derive(Default)]
pub(crate) struct Lines {
    buffer: Vec<u8>,
    /// Where the search for a newline goes on.
    searched: usize,
    /// What came with them.
    pub(crate) handed: Handed,
}

impl Lines {
    /// Waits for the next line. May be dropped while it waits; nothing is lost.
    pub(crate) async fn next(&mut self, stream: &UnixStream) -> io::Result<Said> {
        loop {
            if let Some(offset) = self.buffer[self.searched..].iter().position(|&byte| byte == b'\n') {
                let end = self.searched + offset;
                if end > MAX_LINE_BYTES {
                    return Ok(Said::TooLong);
                }
                let mut bytes: Vec<u8> = self.buffer.drain(..=end).collect();
                bytes.pop();
                self.searched = 0;
                return Ok(Said::Line(bytes));
            }
            self.searched = self.buffer.len();
            if self.searched > MAX_LINE_BYTES {
                return Ok(Said::TooLong);
            }
            if self.fill(stream).await? == 0 {
                // A last line without its newline is a line all the same.
                let bytes = std::mem::take(&mut self.buffer);
                self.searched = 0;
                return Ok(if bytes.is_empty() { Said::End } else { Said::Line(bytes) });
            }
        }
    }

    /// Reads what is there. Descriptors for which there is no room are closed by the kernel.
    async fn fill(&mut self, stream: &UnixStream) -> io::Result<usize> {
        let start = self.buffer.len();
        self.buffer.resize(start + CHUNK_BYTES, 0);
        let space = &mut self.buffer[start..];
        let received = stream
            .async_io(Interest::READABLE, || {
                let mut room = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(MAX_WAITING))];
                let mut came = RecvAncillaryBuffer::new(&mut room);
                let flags = RecvFlags::CMSG_CLOEXEC;
                let length = recvmsg(stream, &mut [IoSliceMut::new(space)], &mut came, flags)?.bytes;
                for message in came.drain() {
                    if let RecvAncillaryMessage::ScmRights(descriptors) = message {
                        descriptors.for_each(|descriptor| self.handed.push(descriptor));
                    }
                }
                Ok(length)
            })
            .await;
        self.buffer.truncate(start + *received.as_ref().unwrap_or(&0));
        received
    }
}

/// Reads and forgets until the client ends, `patience` is over or `most` bytes have come: a socket that is closed while
/// something lies unread in it looks broken to its client, who may then not read what was said last.
pub(crate) async fn discard(stream: &UnixStream, most: usize, patience: Duration) {
    let mut scrap = vec![0; CHUNK_BYTES];
    let mut left = most;
    let discarding = async {
        while left > 0 && stream.readable().await.is_ok() {
            match stream.try_read(&mut scrap) {
                Ok(0) => break,
                Ok(length) => left = left.saturating_sub(length),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Err(_) => break,
            }
        }
    };
    // Whether the client has ended or time has, the socket is closed next.
    let _ = timeout(patience, discarding).await;
}

/// Writes everything, and passes descriptors with its first byte.
///
/// # Errors
/// As [`write_all`].
pub(crate) async fn write_with(stream: &UnixStream, bytes: &[u8], descriptors: &[OwnedFd]) -> io::Result<()> {
    let descriptors: Vec<_> = descriptors.iter().map(AsFd::as_fd).collect();
    let mut room = vec![MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(descriptors.len()))];
    let mut ancillary = SendAncillaryBuffer::new(&mut room);
    if !ancillary.push(SendAncillaryMessage::ScmRights(&descriptors)) {
        return Err(io::ErrorKind::InvalidInput.into());
    }
    let send = stream.async_io(Interest::WRITABLE, || {
        Ok(sendmsg(stream, &[IoSlice::new(bytes)], &mut ancillary, SendFlags::NOSIGNAL)?)
    });
    let sent = timeout(WRITE_PATIENCE, send).await.map_err(|_| io::ErrorKind::TimedOut)??;
    write_all(stream, &bytes[sent..]).await
}

/// Writes everything.
///
/// # Errors
/// `TimedOut` where the client takes nothing for [`WRITE_PATIENCE`], or less than 256 KiB a second; else what the socket says.
pub(crate) async fn write_all(stream: &UnixStream, mut bytes: &[u8]) -> io::Result<()> {
    let until = Instant::now() + WRITE_PATIENCE + Duration::from_secs_f64(bytes.len() as f64 / SLOWEST_BYTES_PER_S);
    while !bytes.is_empty() {
        if Instant::now() > until {
            return Err(io::ErrorKind::TimedOut.into());
        }
        match stream.try_write(bytes) {
            Ok(length) => bytes = &bytes[length..],
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                timeout(WRITE_PATIENCE, stream.writable()).await.map_err(|_| io::ErrorKind::TimedOut)??;
            }
            Err(error) => return Err(error),
        }
    }
    Ok(())
}
