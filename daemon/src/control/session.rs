//! One client: its requests in order, each answered before the next is read.
//!
//! So a client that asks faster than it reads holds up itself alone: what it has not read fills its own socket, and
//! when that stays full it is dropped. The daemon keeps one request and one answer a client, and a bounded number of events
//! where it has subscribed to any, never more.

use super::engine::{Engine, Picture};
use super::events::Subscription;
use super::handed;
use super::hears::{Hears, beside_events};
use super::line::{Lines, Said, discard, write_all, write_with};
use super::pace::Pace;
use super::rules::Rules;
use crate::feed::{Lent, Reader};
use lantern_proto::{
    ErrorBody, Id, MAX_LINE_BYTES, Op, Outcome, Refusal, Reply, Request, SnapshotHead, Subscribed, parse_line,
};
use serde::Serialize;
use serde_json::{Map, Value};
use std::io;
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::net::UnixStream;
use tokio::sync::SemaphorePermit;

/// What is still read of a client whose line was too long, and for how long, so that it can read its error.
const FAREWELL_BYTES: usize = 64 << 20;
const FAREWELL: Duration = Duration::from_secs(1);

/// Serves a client that may come in, until it ends, says too much at once, or reads nothing.
pub(super) async fn serve(stream: UnixStream, engine: Arc<dyn Engine>, rules: Arc<Rules>) {
    let served = match admit(&stream, &rules).await {
        Ok(Ok(())) => converse(&stream, engine, &rules).await,
        Ok(Err(refusal)) => return turn_away(&stream, refusal).await,
        Err(error) => Err(error),
    };
    match served {
        Ok(()) => {}
        Err(error) if error.kind() == io::ErrorKind::TimedOut => {
            tracing::warn!("a client of the control socket does not read, and is dropped");
        }
        Err(error) => tracing::debug!(%error, "a client of the control socket broke off"),
    }
}

/// Whether the client may come in. The user database may be on another machine, so a thread that may wait asks it.
async fn admit(stream: &UnixStream, rules: &Arc<Rules>) -> io::Result<Result<(), ErrorBody>> {
    let (peer, rules) = (stream.peer_cred()?, rules.clone());
    tokio::task::spawn_blocking(move || rules.door.admit(peer)).await.map_err(io::Error::other)
}

/// Says why, and hangs up. A new socket has room for one line, so nobody waits.
pub(super) async fn turn_away(stream: &UnixStream, error: ErrorBody) {
    let line = line_of(&Reply { id: None, outcome: Outcome::Error(error) });
    // The client may have gone already, which is as well.
    let _ = write_all(stream, &line).await;
}

async fn converse(stream: &UnixStream, engine: Arc<dyn Engine>, rules: &Arc<Rules>) -> io::Result<()> {
    let mut lines = Lines::default();
    let mut hears = Hears::default();
    let mut pace = Pace::new(rules.max_requests_per_s, Instant::now());
    loop {
        match beside_events(stream, &hears, lines.next(stream)).await?? {
            Said::Line(bytes) => {
                let wait = pace.take(Instant::now());
                if !wait.is_zero() {
                    beside_events(stream, &hears, tokio::time::sleep(wait)).await?;
                }
                let file = lines.handed.named_by(&bytes);
                let answered = answer(bytes, file, engine.clone(), rules, hears.reader.as_ref());
                let (reply, rest) = beside_events(stream, &hears, answered).await?;
                let line = line_of(&reply);
                match rest {
                    Rest::Nothing => write_all(stream, &line).await?,
                    Rest::Picture(picture) => {
                        write_all(stream, &line).await?;
                        write_all(stream, &picture.bytes).await?;
                    }
                    Rest::Subscription(new) => {
                        write_all(stream, &line).await?;
                        // Of what was subscribed to before, nothing more is heard.
                        hears.subscription = Some(new);
                    }
                    Rest::Reader(descriptors, reader) => {
                        write_with(stream, &line, &descriptors).await?;
                        hears.reader = Some(reader);
                    }
                }
            }
            Said::TooLong => {
                let message =
                    format!("the line has more than {MAX_LINE_BYTES} bytes; hint: send fewer edits at a time");
                let error = ErrorBody::new("line-too-long", message);
                write_all(stream, &line_of(&Reply { id: None, outcome: Outcome::Error(error) })).await?;
                rustix::net::shutdown(stream, rustix::net::Shutdown::Write)?;
                discard(stream, FAREWELL_BYTES, FAREWELL).await;
                return Ok(());
            }
            Said::End => return Ok(()),
        }
    }
}

/// A reply as its line. One that is longer than a line may be becomes an error.
pub(super) fn line_of(reply: &Reply) -> Vec<u8> {
    // A reply has no maps but with string keys, so it can be written; an empty object would break the protocol.
    let mut line = serde_json::to_vec(reply).unwrap_or_else(|error| {
        tracing::error!(%error, "a reply cannot be written as JSON");
        br#"{"id":null,"error":{"code":"internal","message":"the reply cannot be written as JSON"}}"#.to_vec()
    });
    if line.len() > MAX_LINE_BYTES {
        let message = format!("the reply has {} bytes, and a line {MAX_LINE_BYTES} at most", line.len());
        let error = ErrorBody::new("reply-too-long", message);
        return line_of(&Reply { id: reply.id.clone(), outcome: Outcome::Error(error) });
    }
    line.push(b'\n');
    line
}

/// What comes of a request besides its reply.
enum Rest<'a> {
    Nothing,
    /// Bytes that follow it.
    Picture(Held<'a>),
    /// What the client hears of from then on.
    Subscription(Subscription),
    /// Descriptors that come with it, and the pictures in them.
    Reader(Vec<OwnedFd>, Reader),
}

/// A picture in memory, and the place that it takes there.
struct Held<'a> {
    bytes: Vec<u8>,
    _place: Option<SemaphorePermit<'a>>,
}

/// The reply to a line, and what comes of it besides. `reader` is what the client reads already.
async fn answer<'a>(
    line: Vec<u8>,
    file: Option<Option<OwnedFd>>,
    engine: Arc<dyn Engine>,
    rules: &'a Rules,
    reader: Option<&Reader>,
) -> (Reply, Rest<'a>) {
    let refuse = |id: Option<Id>, error| (Reply { id, outcome: Outcome::Error(error) }, Rest::Nothing);
    let parsed = match file {
        None => parse_line(&line),
        Some(file) => handed::parse(line, file).await,
    };
    let Request { id, op } = match parsed {
        Ok(request) => request,
        Err(Refusal { id, error }) => return refuse(id, error),
    };
    // What concerns this client's own pictures alone.
    match (&op, reader) {
        (Op::ExportRelease(release), reader) => {
            let image = release.image;
            if reader.is_some_and(|reader| reader.release(image)) {
                return (Reply { id: Some(id), outcome: Outcome::Ok(Value::Object(Map::new())) }, Rest::Nothing);
            }
            let message = format!("this client holds no image {image}; hint: release each that an event names, once");
            return refuse(Some(id), ErrorBody::new("not-held", message).at("image"));
        }
        (Op::ExportOpen(_), Some(reader)) if !reader.has_ended() => {
            let message = "this connection has an export already; hint: open another connection for another";
            return refuse(Some(id), ErrorBody::new("busy", message));
        }
        _ => {}
    }
    // Whoever asks for a picture waits until there is room for it. The semaphore is never closed.
    let place = match op {
        Op::Snapshot(_) => rules.pictures.acquire().await.ok(),
        _ => None,
    };
    match tokio::task::spawn_blocking(move || perform(&*engine, op)).await {
        Ok(Ok(Answer { value, with })) => {
            let rest = match with {
                With::Nothing => Rest::Nothing,
                With::Picture(bytes) => Rest::Picture(Held { bytes, _place: place }),
                With::Subscription(subscription) => Rest::Subscription(subscription),
                With::Reader(descriptors, reader) => Rest::Reader(descriptors, reader),
            };
            (Reply { id: Some(id), outcome: Outcome::Ok(value) }, rest)
        }
        Ok(Err(error)) => refuse(Some(id), error),
        Err(error) => {
            tracing::error!(%error, "a request has failed inside");
            refuse(Some(id), ErrorBody::new("internal", "the daemon failed inside; hint: see its log"))
        }
    }
}

struct Answer {
    value: Value,
    with: With,
}

/// What the engine gives besides a value.
enum With {
    Nothing,
    Picture(Vec<u8>),
    Subscription(Subscription),
    Reader(Vec<OwnedFd>, Reader),
}

/// Asks the engine, which may block. What protocol 1 has and this version has not is refused.
fn perform(engine: &dyn Engine, op: Op) -> Result<Answer, ErrorBody> {
    match op {
        Op::Hello => plain(&engine.hello()),
        Op::Status => plain(&engine.status()),
        Op::SceneGet => plain(&engine.scene_get()),
        Op::SceneApply(apply) => plain(&engine.apply(&apply.edits, apply.durable)?),
        Op::Pose(pose) => {
            engine.pose(&pose)?;
            plain(&Map::new())
        }
        Op::Snapshot(snapshot) => {
            let Picture { format, bytes } = engine.snapshot(&snapshot.projector, snapshot.layer)?;
            let head = SnapshotHead { bytes: bytes.len() as u64, format: format.to_owned() };
            Ok(Answer { with: With::Picture(bytes), ..plain(&head)? })
        }
        Op::Subscribe(subscribe) => {
            let with = With::Subscription(engine.events().subscribe(&subscribe.events));
            Ok(Answer { with, ..plain(&Subscribed { events: subscribe.events })? })
        }
        Op::ExportOpen(open) => {
            let Lent { opened, descriptors, reader } = engine.export(&open)?;
            Ok(Answer { with: With::Reader(descriptors, reader), ..plain(&opened)? })
        }
        // Each session's own.
        Op::ExportRelease(_) => Err(ErrorBody::new("not-held", "there is no export").at("image")),
        Op::Pattern(pattern) => {
            engine.pattern(&pattern)?;
            plain(&Map::new())
        }
        Op::ConfigReload => plain(&engine.reload()?),
    }
}

fn plain(value: &impl Serialize) -> Result<Answer, ErrorBody> {
    let value = serde_json::to_value(value)
        .map_err(|error| ErrorBody::new("internal", format!("the reply cannot be written as JSON: {error}")))?;
    Ok(Answer { value, with: With::Nothing })
}
