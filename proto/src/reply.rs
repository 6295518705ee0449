//! What the daemon answers.

use crate::edit::Edit;
use crate::request::{EventKind, Id};
use serde::{Deserialize, Serialize};

/// One line to a client. The bytes of a snapshot follow its line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reply {
    /// The request's number; null where none could be read.
    pub id: Option<Id>,
    /// How it went.
    #[serde(flatten)]
    pub outcome: Outcome,
}

/// How a request went.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Done; what is in it depends on the op.
    Ok(serde_json::Value),
    /// Refused; nothing has changed.
    Error(ErrorBody),
}

/// Why a request was refused.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("{message}{}", .at.as_ref().map(|at| format!(" (at {at})")).unwrap_or_default())]
pub struct ErrorBody {
    /// For programs: a short word that stays the same.
    pub code: String,
    /// For people.
    pub message: String,
    /// Where in the request, such as `edits[3].node`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at: Option<String>,
}

impl ErrorBody {
    /// A refusal that is about no one place of the request.
    pub fn new(code: &str, message: impl Into<String>) -> Self {
        Self { code: code.to_owned(), message: message.into(), at: None }
    }

    /// The same, about a place of the request. An empty place is none.
    #[must_use]
    pub fn at(mut self, at: impl Into<String>) -> Self {
        self.at = Some(at.into()).filter(|at| !at.is_empty());
        self
    }
}

/// `hello`'s answer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Hello {
    /// [`PROTOCOL`](crate::PROTOCOL).
    pub protocol: u32,
    /// The daemon's version.
    pub version: String,
    /// The projectors' names, in the configuration's order.
    pub projectors: Vec<String>,
}

/// `scene.get`'s answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneGet {
    /// The revision that the edits rebuild.
    pub revision: u64,
    /// In an order in which they apply to an empty scene.
    pub edits: Vec<Edit>,
}

/// `scene.apply`'s answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Applied {
    /// The new revision.
    pub revision: u64,
    /// The first frame that shows it.
    pub frame: u64,
    /// Whether it would survive `kill -9`: false where nothing is kept or the client did not ask for it.
    pub durable: bool,
}

/// `config.reload`'s answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Reloaded {
    /// The scene's revision now.
    pub revision: u64,
}

/// `subscribe`'s answer: what is heard of from now on, instead of what was before.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Subscribed {
    /// As they were asked for.
    pub events: Vec<EventKind>,
}

/// `snapshot`'s answer, before its bytes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SnapshotHead {
    /// How many bytes follow the line.
    pub bytes: u64,
    /// `png` or `exr`.
    pub format: String,
}
