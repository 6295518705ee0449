//! Edits that are too long for a line, in a memfd that came with it.
//!
//! A client writes the list into a memfd, seals it so that nobody can change it any more, and passes its descriptor with the request
//! (`SCM_RIGHTS`), which says `"edits": "fd:0"`. Nothing else is taken: what is not sealed could change while it is read, or shrink,
//! which would end the process where it was mapped; what is no memfd could be a pipe that never ends.

use std::collections::VecDeque;
use std::fs::File;
use std::os::fd::OwnedFd;
use std::os::unix::fs::FileExt;

use lantern_proto::{ErrorBody, Refusal, Request, parse_line_with};
use rustix::fs::{SealFlags, fcntl_get_seals, fstat};
use tokio::sync::Semaphore;

/// A list in memory is up to fourteen times as long as its text.
const MAX_BYTES: u64 = 16 << 20;

/// A request that says where its edits are is no longer.
const MAX_LINE_BYTES: usize = 4096;

/// Descriptors that a client may have sent ahead of the requests that name them.
pub(crate) const MAX_WAITING: usize = 4;

/// One list at a time is read, whoever sends them, so that their memory is bounded.
static READING: Semaphore = Semaphore::const_new(1);

/// What came with a client's lines and no request has named yet, in the order in which it came.
#[derive(Default)]
pub(crate) struct Handed(VecDeque<OwnedFd>);

impl Handed {
    /// Keeps a descriptor; one more than may wait is closed.
    pub(crate) fn push(&mut self, descriptor: OwnedFd) {
        if self.0.len() < MAX_WAITING {
            self.0.push_back(descriptor);
        }
    }

    /// The descriptor that a line names; `None` where it names none.
    pub(crate) fn named_by(&mut self, line: &[u8]) -> Option<Option<OwnedFd>> {
        let name = br#""fd:0""#;
        let names = line.len() <= MAX_LINE_BYTES && line.windows(name.len()).any(|window| window == name);
        names.then(|| self.0.pop_front())
    }
}

/// Reads a request whose edits are in a file.
///
/// # Errors
/// As [`parse_line_with`]; and `bad-file` where there is no file, or none that can be read safely.
pub(crate) async fn parse(line: Vec<u8>, file: Option<OwnedFd>) -> Result<Request, Refusal> {
    // The semaphore is never closed.
    let _turn = READING.acquire().await.ok();
    let read = move || {
        let text = file.ok_or_else(|| bad("no file came with it", "pass one with SCM_RIGHTS")).and_then(read);
        parse_line_with(&line, text)
    };
    match tokio::task::spawn_blocking(read).await {
        Ok(parsed) => parsed,
        Err(error) => {
            tracing::error!(%error, "a list of edits has failed inside");
            Err(Refusal { id: None, error: ErrorBody::new("internal", "the daemon failed inside; hint: see its log") })
        }
    }
}

fn bad(message: &str, hint: &str) -> ErrorBody {
    ErrorBody::new("bad-file", format!("{message}; hint: {hint}")).at("edits")
}

fn read(descriptor: OwnedFd) -> Result<Vec<u8>, ErrorBody> {
    let sealed = SealFlags::SHRINK | SealFlags::GROW | SealFlags::WRITE;
    // Nothing but a memfd has seals.
    if !fcntl_get_seals(&descriptor).is_ok_and(|seals| seals.contains(sealed)) {
        return Err(bad("the file is no memfd that is sealed", "add F_SEAL_SHRINK, F_SEAL_GROW and F_SEAL_WRITE"));
    }
    let unreadable = |error: std::io::Error| bad(&format!("the file cannot be read: {error}"), "open it to be read");
    let length = fstat(&descriptor).map_err(|error| unreadable(error.into()))?.st_size;
    let length = u64::try_from(length).unwrap_or_default();
    if length > MAX_BYTES {
        let message = format!("the file has {length} bytes, and {MAX_BYTES} are taken");
        return Err(ErrorBody::new("too-large", format!("{message}; hint: send fewer edits at a time")).at("edits"));
    }
    // From its start, wherever the client stands in it.
    let mut text = vec![0; usize::try_from(length).unwrap_or_default()];
    File::from(descriptor).read_exact_at(&mut text, 0).map_err(unreadable)?;
    Ok(text)
}
