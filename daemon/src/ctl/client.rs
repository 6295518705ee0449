//! The socket's other end, for one who asks one thing at a time and waits for the answer.

use super::Failure;
use lantern_proto::{Outcome, Reply};
use serde_json::Value;
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

/// Longer than any edit takes; a daemon that says nothing for so long is as good as gone.
const PATIENCE: Duration = Duration::from_secs(300);

/// A connection to a daemon.
pub(super) struct Client {
    reader: BufReader<UnixStream>,
    last_id: u64,
}

impl Client {
    /// # Errors
    /// [`Failure::NoDaemon`].
    pub(super) fn connect(path: &Path) -> Result<Self, Failure> {
        let connect = || {
            let stream = UnixStream::connect(path)?;
            stream.set_read_timeout(Some(PATIENCE))?;
            stream.set_write_timeout(Some(PATIENCE))?;
            Ok(stream)
        };
        let stream = connect().map_err(|source| Failure::NoDaemon { path: path.to_owned(), source })?;
        Ok(Self { reader: BufReader::new(stream), last_id: 0 })
    }

    /// Asks, and gives the `ok` of the answer. `request` is an object without an id.
    ///
    /// # Errors
    /// [`Failure::Refused`] with the daemon's words, [`Failure::Lost`] where there is no answer or none of the protocol.
    pub(super) fn ask(&mut self, mut request: Value) -> Result<Value, Failure> {
        self.last_id += 1;
        request["id"] = self.last_id.into();
        let mut line = request.to_string().into_bytes();
        line.push(b'\n');
        match self.reader.get_mut().write_all(&line) {
            Ok(()) => {}
            // A daemon that hangs up has said why: it has no place for us, or the line is too long.
            Err(error) if matches!(error.kind(), ErrorKind::BrokenPipe | ErrorKind::ConnectionReset) => {}
            Err(error) => return Err(lost(&error)),
        }

        let mut answer = String::new();
        if self.reader.read_line(&mut answer).map_err(|error| lost(&error))? == 0 {
            return Err(Failure::Lost("it hung up without an answer".to_owned()));
        }
        let reply: Reply = serde_json::from_str(&answer)
            .map_err(|error| Failure::Lost(format!("what answers does not speak the protocol: {error}")))?;
        match reply.outcome {
            Outcome::Error(error) => Err(Failure::Refused(error)),
            Outcome::Ok(value) if reply.id == Some(self.last_id.into()) => Ok(value),
            Outcome::Ok(_) => Err(Failure::Lost("the answer is to another request".to_owned())),
        }
    }

    /// From now on, waits for as long as nothing is said.
    ///
    /// # Errors
    /// [`Failure::Lost`] where the system will not have it.
    pub(super) fn wait_for_ever(&mut self) -> Result<(), Failure> {
        self.reader.get_ref().set_read_timeout(None).map_err(|error| lost(&error))
    }

    /// The next line, such as an event, with its end.
    ///
    /// # Errors
    /// [`Failure::Lost`] where there is none.
    pub(super) fn line(&mut self) -> Result<String, Failure> {
        let mut line = String::new();
        if self.reader.read_line(&mut line).map_err(|error| lost(&error))? == 0 {
            return Err(Failure::Lost("it hung up".to_owned()));
        }
        Ok(line)
    }

    /// The bytes that follow an answer.
    ///
    /// # Errors
    /// [`Failure::Lost`] where they end too early.
    pub(super) fn bytes(&mut self, count: u64) -> Result<Vec<u8>, Failure> {
        let mut bytes = Vec::new();
        let read = self.reader.by_ref().take(count).read_to_end(&mut bytes).map_err(|error| lost(&error))?;
        if (read as u64) < count {
            return Err(Failure::Lost(format!("{read} of {count} bytes came")));
        }
        Ok(bytes)
    }
}

fn lost(error: &io::Error) -> Failure {
    match error.kind() {
        ErrorKind::WouldBlock | ErrorKind::TimedOut => {
            Failure::Lost(format!("no answer within {} s", PATIENCE.as_secs()))
        }
        _ => Failure::Lost(error.to_string()),
    }
}
