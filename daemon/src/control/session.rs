//! One client: its requests in order, each answered before the next is read.
//!
//! So a client that asks faster than it reads holds up itself alone: what it has not read fills its own socket, and
//! when that stays full it is dropped. The daemon keeps one request and one answer a client, never more.

use super::engine::{Engine, Picture};
use super::line::{Lines, Said, discard, write_all};
use lantern_proto::{ErrorBody, Id, MAX_LINE_BYTES, Op, Outcome, Refusal, Reply, Request, SnapshotHead, parse_line};
use serde::Serialize;
use serde_json::{Map, Value};
use std::io;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::UnixStream;

/// What is still read of a client whose line was too long, and for how long, so that it can read its error.
const FAREWELL_BYTES: usize = 64 << 20;
const FAREWELL: Duration = Duration::from_secs(1);

/// Serves a client until it ends, says too much at once, or reads nothing.
pub(super) async fn serve(stream: UnixStream, engine: Arc<dyn Engine>) {
    match converse(&stream, engine).await {
        Ok(()) => {}
        Err(error) if error.kind() == io::ErrorKind::TimedOut => {
            tracing::warn!("a client of the control socket does not read, and is dropped");
        }
        Err(error) => tracing::debug!(%error, "a client of the control socket broke off"),
    }
}

async fn converse(stream: &UnixStream, engine: Arc<dyn Engine>) -> io::Result<()> {
    let mut lines = Lines::default();
    loop {
        match lines.next(stream).await? {
            Said::Line { bytes, with_files } => {
                let (reply, picture) = answer(&bytes, with_files, engine.clone()).await;
                write_all(stream, &line_of(&reply)).await?;
                write_all(stream, &picture).await?;
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

/// The reply to a line, and the bytes that follow it.
async fn answer(line: &[u8], with_files: bool, engine: Arc<dyn Engine>) -> (Reply, Vec<u8>) {
    let refuse = |id: Option<Id>, error| (Reply { id, outcome: Outcome::Error(error) }, Vec::new());
    let parsed = parse_line(line);
    if with_files {
        let id = match parsed {
            Ok(request) => Some(request.id),
            Err(refusal) => refusal.id,
        };
        let error =
            ErrorBody::new("not-built", "payloads in file descriptors are not built yet; hint: send them as JSON");
        return refuse(id, error);
    }
    let Request { id, op } = match parsed {
        Ok(request) => request,
        Err(Refusal { id, error }) => return refuse(id, error),
    };
    match tokio::task::spawn_blocking(move || perform(&*engine, op)).await {
        Ok(Ok(Answer { value, picture })) => (Reply { id: Some(id), outcome: Outcome::Ok(value) }, picture),
        Ok(Err(error)) => refuse(Some(id), error),
        Err(error) => {
            tracing::error!(%error, "a request has failed inside");
            refuse(Some(id), ErrorBody::new("internal", "the daemon failed inside; hint: see its log"))
        }
    }
}

struct Answer {
    value: Value,
    picture: Vec<u8>,
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
            Ok(Answer { picture: bytes, ..plain(&head)? })
        }
        Op::Subscribe(_) => {
            Err(ErrorBody::new("not-built", "`subscribe` is not built yet; hint: poll `status`").at("op"))
        }
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
    Ok(Answer { value, picture: Vec::new() })
}
