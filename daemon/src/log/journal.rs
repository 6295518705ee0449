//! The journal's own protocol (<https://systemd.io/JOURNAL_NATIVE_PROTOCOL>): an entry is a datagram of fields.
//!
//! Written by us, for what people read is the field `MESSAGE` alone: here it holds the other fields as well, as the lines of standard
//! error do, where the crate for it (`tracing-journald`) leaves them out.

use std::fmt::{Debug, Write};
use std::io::{self, stderr};
use std::os::unix::net::UnixDatagram;
use std::path::PathBuf;

use tracing::field::{Field, Visit};
use tracing::{Event, Level, Metadata, Subscriber};
use tracing_subscriber::layer::{Context, Layer};

/// Where journald listens.
const SOCKET: &str = "/run/systemd/journal/socket";

/// Before the names of our fields, so that none is taken for one of the journal's own: `projector` is `LANTERN_PROJECTOR`.
const PREFIX: &str = "LANTERN_";

/// Sends each event to the journal.
#[derive(Debug)]
pub(super) struct Journal {
    socket: UnixDatagram,
    path: PathBuf,
}

impl Journal {
    /// Where standard error leads to the journal (`$JOURNAL_STREAM`, systemd.exec(5)) and the journal can be told.
    pub(super) fn of_standard_error() -> Option<Self> {
        let stream = std::env::var("JOURNAL_STREAM").ok()?;
        let status = rustix::fs::fstat(stderr()).ok()?;
        if stream != format!("{}:{}", status.st_dev, status.st_ino) {
            return None;
        }
        let journal = Self::at(SOCKET.into()).ok()?;
        // An entry of nothing is passed over, and tells whether anybody is there.
        journal.send(&[]).ok().map(|()| journal)
    }

    fn at(path: PathBuf) -> io::Result<Self> {
        Ok(Self { socket: UnixDatagram::unbound()?, path })
    }

    /// By its path each time, so that a journal that was started again is found.
    fn send(&self, entry: &[u8]) -> io::Result<()> {
        self.socket.send_to(entry, &self.path).map(drop)
    }
}

impl<S: Subscriber> Layer<S> for Journal {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut words = Words::default();
        event.record(&mut words);
        if self.send(&entry(event.metadata(), &words)).is_err() {
            // Too long for a datagram, or nobody there: standard error leads to the same place, without fields.
            eprintln!("{}", words.line());
        }
    }
}

/// The entry of an event.
fn entry(metadata: &Metadata<'_>, words: &Words) -> Vec<u8> {
    // syslog(3): 3 is an error, 4 a warning, 6 informs and 7 is for whoever looks for faults.
    let priority = match *metadata.level() {
        Level::ERROR => "3",
        Level::WARN => "4",
        Level::INFO => "6",
        Level::DEBUG | Level::TRACE => "7",
    };
    let mut entry = Vec::new();
    put(&mut entry, "PRIORITY", priority);
    put(&mut entry, "SYSLOG_IDENTIFIER", "lanternd");
    put(&mut entry, "MESSAGE", &words.line());
    put(&mut entry, "TARGET", metadata.target());
    if let (Some(file), Some(line)) = (metadata.file(), metadata.line()) {
        put(&mut entry, "CODE_FILE", file);
        put(&mut entry, "CODE_LINE", &line.to_string());
    }
    for (name, value, _) in &words.fields {
        put(&mut entry, &name_of(name), value);
    }
    entry
}

/// The form that takes any value: a name, the length in 64 bits, little-endian, and the value.
fn put(entry: &mut Vec<u8>, name: &str, value: &str) {
    entry.extend_from_slice(name.as_bytes());
    entry.push(b'\n');
    entry.extend_from_slice(&(value.len() as u64).to_le_bytes());
    entry.extend_from_slice(value.as_bytes());
    entry.push(b'\n');
}

/// The journal takes capitals, digits and underscores, 64 of them at most.
fn name_of(field: &str) -> String {
    let letters = field.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_uppercase() } else { '_' });
    PREFIX.chars().chain(letters).take(64).collect()
}

/// What an event says.
#[derive(Debug, Default)]
struct Words {
    message: String,
    /// Names, values, and the values as a line shows them.
    fields: Vec<(&'static str, String, String)>,
}

impl Words {
    /// The message, and the fields behind it.
    fn line(&self) -> String {
        let mut line = self.message.clone();
        for (name, _, shown) in &self.fields {
            // A string takes whatever it is given.
            let _ = write!(line, "{}{name}={shown}", if line.is_empty() { "" } else { " " });
        }
        line
    }
}

impl Visit for Words {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        let value = format!("{value:?}");
        match field.name() {
            "message" => self.message = value,
            name => self.fields.push((name, value.clone(), value)),
        }
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        match field.name() {
            "message" => value.clone_into(&mut self.message),
            name => self.fields.push((name, value.to_owned(), format!("{value:?}"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;
    use tracing_subscriber::layer::SubscriberExt;

    /// The fields of the next entry.
    fn next(socket: &UnixDatagram) -> BTreeMap<String, String> {
        let mut datagram = vec![0; 1 << 16];
        let length = socket.recv(&mut datagram).unwrap();
        let mut rest = &datagram[..length];
        let mut fields = BTreeMap::new();
        while let Some(end) = rest.iter().position(|&byte| byte == b'\n') {
            let name = std::str::from_utf8(&rest[..end]).unwrap().to_owned();
            let length = u64::from_le_bytes(rest[end + 1..end + 9].try_into().unwrap()) as usize;
            let value = std::str::from_utf8(&rest[end + 9..end + 9 + length]).unwrap();
            assert!(fields.insert(name, value.to_owned()).is_none());
            assert_eq!(rest[end + 9 + length], b'\n');
            rest = &rest[end + 10 + length..];
        }
        assert!(rest.is_empty());
        fields
    }

    #[test]
    fn fields_and_priorities_are_kept_and_lines_stay_readable() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let socket = UnixDatagram::bind(&path).unwrap();
        let journal = Journal::at(path).unwrap();
        tracing::subscriber::with_default(tracing_subscriber::registry().with(journal), || {
            let error = io::Error::other("two\nlines");
            tracing::info!(projector = "left", revision = 7, "rendering");
            tracing::warn!(%error, "it went wrong");
            tracing::error!("a \"word\"");
            tracing::debug!(a.dotted = true);
        });
        let entry = next(&socket);
        assert_eq!((entry["PRIORITY"].as_str(), entry["SYSLOG_IDENTIFIER"].as_str()), ("6", "lanternd"));
        assert_eq!(entry["MESSAGE"], "rendering projector=\"left\" revision=7");
        assert_eq!((entry["LANTERN_PROJECTOR"].as_str(), entry["LANTERN_REVISION"].as_str()), ("left", "7"));
        assert!(entry["CODE_FILE"].ends_with("journal.rs") && entry["TARGET"].starts_with("lantern"));
        let entry = next(&socket);
        assert_eq!((entry["PRIORITY"].as_str(), entry["LANTERN_ERROR"].as_str()), ("4", "two\nlines"));
        let entry = next(&socket);
        assert_eq!((entry["PRIORITY"].as_str(), entry["MESSAGE"].as_str()), ("3", "a \"word\""));
        let entry = next(&socket);
        assert_eq!((entry["PRIORITY"].as_str(), entry["LANTERN_A_DOTTED"].as_str()), ("7", "true"));
        assert_eq!(entry["MESSAGE"], "a.dotted=true");
    }
}
