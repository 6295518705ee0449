//! What the daemon answers.

use crate::edit::Edit;
use crate::request::{EventKind, ExportHandle, Id};
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

/// `export.open`'s answer. With its line come descriptors (`SCM_RIGHTS`): one an image, and then, where there is one, that of the
/// timeline.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExportOpened {
    /// The projector's name.
    pub projector: String,
    /// What the images' descriptors are.
    pub handle: ExportHandle,
    /// How many images.
    pub images: usize,
    /// Columns.
    pub width: u32,
    /// Rows; row 0 is the top one.
    pub height: u32,
    /// The picture in each image.
    pub color: ExportPlane,
    /// Its depth.
    pub depth: ExportPlane,
    /// What an importer says of the memory.
    pub memory: ExportMemory,
    /// What an importer says of the buffer in it.
    pub buffer: ExportBuffer,
    /// Whether a timeline semaphore says when a picture is whole.
    pub semaphore: bool,
    /// The device that has the memory, as Vulkan knows it.
    pub device_uuid: String,
    /// The driver that has it.
    pub driver_uuid: String,
}

/// Where pixels lie in an exported image.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExportPlane {
    /// Vulkan's name of the format, without its `VK_FORMAT_`.
    pub format: String,
    /// Where the first row begins, bytes.
    pub offset: u64,
    /// From one row to the next, bytes.
    pub row_pitch: u64,
}

/// Memory that is to be imported.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExportMemory {
    /// Its size (`VkMemoryAllocateInfo::allocationSize`).
    pub bytes: u64,
    /// The index of its type on the device.
    #[serde(rename = "type")]
    pub memory_type: u32,
    /// Whether it is dedicated to the buffer.
    pub dedicated: bool,
}

/// The buffer that lies at the beginning of that memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExportBuffer {
    /// Its size.
    pub bytes: u64,
    /// Its `VkBufferUsageFlags`.
    pub usage: u32,
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
