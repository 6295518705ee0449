//! The control socket from a client's side (CONTRACT, Socket protocol): JSON lines, and raw bytes after a snapshot's.

use std::{
    fmt,
    io::{BufRead, BufReader, Read, Write},
    os::unix::net::UnixStream,
    path::Path,
    time::Duration,
};

use anyhow::{Context, Result, bail, ensure};
use image::RgbImage;
use serde_json::{Value, json};

use crate::image::FloatImage;

/// No answer takes longer, even under the validation layer beside other tests.
const ANSWER_LIMIT: Duration = Duration::from_secs(120);

/// The daemon's no.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refused {
    /// A short word that stays the same.
    pub code: String,
    /// For people.
    pub message: String,
    /// Where in the request; empty where the daemon names no place.
    pub at: String,
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} at `{}`: {}", self.code, self.at, self.message)
    }
}

impl std::error::Error for Refused {}

/// One connection.
#[derive(Debug)]
pub struct Client {
    stream: BufReader<UnixStream>,
    next_id: u64,
}

impl Client {
    /// Connects.
    ///
    /// # Errors
    /// Where nobody listens.
    pub fn connect(socket: &Path) -> Result<Self> {
        let stream = UnixStream::connect(socket).with_context(|| format!("connecting to {}", socket.display()))?;
        stream.set_read_timeout(Some(ANSWER_LIMIT)).context("limiting the wait")?;
        Ok(Self { stream: BufReader::new(stream), next_id: 1 })
    }

    /// Writes bytes as they are.
    ///
    /// # Errors
    /// Where the daemon has closed the connection.
    pub fn send(&mut self, bytes: &[u8]) -> Result<()> {
        self.stream.get_mut().write_all(bytes).context("writing to lanternd")
    }

    /// Reads one line: a reply or an event. `None` where the daemon has closed the connection.
    ///
    /// # Errors
    /// Where nothing comes in time, or no JSON.
    pub fn line(&mut self) -> Result<Option<Value>> {
        let mut line = String::new();
        let length = self.stream.read_line(&mut line).context("reading from lanternd")?;
        if length == 0 {
            return Ok(None);
        }
        serde_json::from_str(&line).map(Some).with_context(|| format!("lanternd's line is no JSON: {line}"))
    }

    /// Asks, and gives what is under `ok`, or the refusal. Events that come before the reply are passed over.
    ///
    /// # Errors
    /// Where the connection or the protocol breaks.
    pub fn ask(&mut self, op: &str, parameters: Value) -> Result<Result<Value, Refused>> {
        let id = self.next_id;
        self.next_id += 1;
        let mut request = parameters;
        request["id"] = json!(id);
        request["op"] = json!(op);
        self.send(format!("{request}\n").as_bytes())?;

        let mut reply = loop {
            let line = self.line()?.with_context(|| format!("lanternd closed the connection at {op}"))?;
            if line.get("event").is_none() {
                break line;
            }
        };
        ensure!(reply["id"] == json!(id), "{op} has id {id}, and its reply is {reply}");
        if let Some(ok) = reply.get_mut("ok") {
            return Ok(Ok(ok.take()));
        }
        let Some(error) = reply.get("error") else { bail!("neither ok nor error: {reply}") };
        let text = |key: &str| error[key].as_str().unwrap_or_default().to_owned();
        let refused = Refused { code: text("code"), message: text("message"), at: text("at") };
        ensure!(!refused.code.is_empty() && !refused.message.is_empty(), "a refusal without code or message: {reply}");
        Ok(Err(refused))
    }

    /// Asks for what must not be refused.
    ///
    /// # Errors
    /// As [`Client::ask`], and [`Refused`].
    pub fn ask_ok(&mut self, op: &str, parameters: Value) -> Result<Value> {
        self.ask(op, parameters)?.with_context(|| format!("{op} was refused"))
    }

    /// Applies edits that must be taken, and gives `{revision, frame}`.
    ///
    /// # Errors
    /// As [`Client::ask_ok`].
    pub fn apply(&mut self, edits: Value) -> Result<Value> {
        self.ask_ok("scene.apply", json!({"edits": edits, "durable": false}))
    }

    /// Places a body.
    ///
    /// # Errors
    /// As [`Client::ask_ok`].
    pub fn pose(&mut self, body: &str, position_m: [f64; 3]) -> Result<()> {
        self.ask_ok("pose", json!({"body": body, "position_m": position_m})).map(drop)
    }

    /// `status`.
    ///
    /// # Errors
    /// As [`Client::ask_ok`].
    pub fn status(&mut self) -> Result<Value> {
        self.ask_ok("status", json!({}))
    }

    /// The file of a layer, and its format as the daemon calls it.
    ///
    /// # Errors
    /// As [`Client::ask_ok`].
    pub fn snapshot(&mut self, projector: &str, layer: &str) -> Result<(String, Vec<u8>)> {
        let head = self.ask_ok("snapshot", json!({"projector": projector, "layer": layer}))?;
        Ok((head["format"].as_str().unwrap_or_default().to_owned(), self.bytes(&head)?))
    }

    /// The bytes that follow a snapshot's answer.
    ///
    /// # Errors
    /// Where the connection ends before they have come.
    pub fn bytes(&mut self, head: &Value) -> Result<Vec<u8>> {
        let length = head["bytes"].as_u64().with_context(|| format!("a snapshot without its length: {head}"))?;
        let mut bytes = vec![0; usize::try_from(length)?];
        self.stream.read_exact(&mut bytes).context("reading a snapshot")?;
        Ok(bytes)
    }

    /// Passes over what follows a snapshot's line.
    ///
    /// # Errors
    /// Where the connection ends before that.
    pub fn skip(&mut self, bytes: u64) -> Result<()> {
        let read = std::io::copy(&mut self.stream.by_ref().take(bytes), &mut std::io::sink()).context("reading")?;
        ensure!(read == bytes, "{read} of {bytes} bytes came");
        Ok(())
    }

    /// A layer that is an EXR.
    ///
    /// # Errors
    /// As [`Client::snapshot`], and where it is none.
    pub fn layer(&mut self, projector: &str, layer: &str) -> Result<FloatImage> {
        let (format, bytes) = self.snapshot(projector, layer)?;
        ensure!(format.eq_ignore_ascii_case("exr"), "{layer} comes as {format}");
        FloatImage::from_exr(&bytes).with_context(|| format!("reading layer {layer}"))
    }

    /// A layer that is a PNG.
    ///
    /// # Errors
    /// As [`Client::snapshot`], and where it is none.
    pub fn png(&mut self, projector: &str, layer: &str) -> Result<RgbImage> {
        let (format, bytes) = self.snapshot(projector, layer)?;
        ensure!(format.eq_ignore_ascii_case("png"), "{layer} comes as {format}");
        let decoded = image::load_from_memory_with_format(&bytes, image::ImageFormat::Png);
        Ok(decoded.with_context(|| format!("reading layer {layer}"))?.into_rgb8())
    }
}

#[cfg(test)]
mod tests {
    use std::{os::unix::net::UnixListener, thread};

    use super::*;

    /// Plays a daemon that answers each line of one connection by the next of these.
    fn answering(answers: &'static [&'static [u8]]) -> (tempfile::TempDir, Client) {
        let folder = tempfile::tempdir().unwrap();
        let socket = folder.path().join("socket");
        let listener = UnixListener::bind(&socket).unwrap();
        thread::spawn(move || {
            let mut stream = BufReader::new(listener.accept().unwrap().0);
            for answer in answers {
                stream.read_line(&mut String::new()).unwrap();
                stream.get_mut().write_all(answer).unwrap();
            }
        });
        let client = Client::connect(&socket).unwrap();
        (folder, client)
    }

    #[test]
    fn replies_refusals_events_and_bytes_are_told_apart() {
        let (_folder, mut client) = answering(&[
            b"{\"event\": \"frame\"}\n{\"id\": 1, \"ok\": {\"protocol\": 1}}\n",
            b"{\"id\": 2, \"error\": {\"code\": \"unknown-node\", \"message\": \"no\", \"at\": \"edits[0].node\"}}\n",
            b"{\"id\": 3, \"ok\": {\"bytes\": 3, \"format\": \"png\"}}\n\n{x{\"id\": 4, \"ok\": {}}\n",
            b"{\"id\": 7, \"ok\": {}}\n",
        ]);
        assert_eq!(client.ask_ok("hello", json!({})).unwrap()["protocol"], 1);
        let refused = client.ask("scene.apply", json!({"edits": []})).unwrap().unwrap_err();
        assert_eq!((refused.code.as_str(), refused.at.as_str()), ("unknown-node", "edits[0].node"));
        assert_eq!(client.snapshot("left", "color").unwrap(), ("png".to_owned(), b"\n{x".to_vec()));
        assert!(client.line().unwrap().is_some(), "the bytes were not counted right");
        assert!(client.ask("status", json!({})).is_err(), "another request's reply");
        assert_eq!(client.line().unwrap(), None);
    }
}
