//! What the control socket asks of the daemon.

use std::collections::BTreeMap;
use std::sync::Arc;

use lantern_proto::status::TrackerStatus;
use lantern_proto::{
    Applied, Edit, ErrorBody, ExportOpen, Hello, Layer, PatternRequest, Pose, Reloaded, SceneGet, Status,
};

use super::events::Events;
use crate::feed::Lent;

/// A file in memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// `png` or `exr`.
    pub format: &'static str,
    /// The file.
    pub bytes: Vec<u8>,
}

/// The daemon, as its clients see it.
///
/// Methods may block: they are called on threads that are there to wait. Each is all or nothing, and a refusal changes
/// nothing. Several clients call at the same time.
pub trait Engine: Send + Sync + 'static {
    /// Who is there.
    fn hello(&self) -> Hello;

    /// How it goes, all of one moment.
    fn status(&self) -> Status;

    /// The part of it that is about trackers.
    fn trackers(&self) -> BTreeMap<String, TrackerStatus>;

    /// What happens, for those who want to hear of it.
    fn events(&self) -> &Arc<Events>;

    /// The scene as edits that rebuild it.
    fn scene_get(&self) -> SceneGet;

    /// Applies edits, and returns when the first frame that shows them is out and, if `durable`, when they would survive
    /// `kill -9`.
    ///
    /// # Errors
    /// The first edit that cannot be applied, with its place; then none is.
    fn apply(&self, edits: &[Edit], durable: bool) -> Result<Applied, ErrorBody>;

    /// Places a body.
    ///
    /// # Errors
    /// An unknown body, or what is no pose.
    fn pose(&self, pose: &Pose) -> Result<(), ErrorBody>;

    /// One layer of what a projector shows.
    ///
    /// # Errors
    /// An unknown projector, or a layer that cannot be had.
    fn snapshot(&self, projector: &str, layer: Layer) -> Result<Picture, ErrorBody>;

    /// Shows a test pattern on one projector or on all, or the scene again; returns when it is shown.
    ///
    /// # Errors
    /// An unknown projector.
    fn pattern(&self, request: &PatternRequest) -> Result<(), ErrorBody>;

    /// Images for a client that wants a projector's pictures, and its end of them.
    ///
    /// # Errors
    /// An unknown projector, or one whose pictures go elsewhere.
    fn export(&self, open: &ExportOpen) -> Result<Lent, ErrorBody>;

    /// Reads the configuration again.
    ///
    /// # Errors
    /// What is wrong with it; then the one before stays.
    fn reload(&self) -> Result<Reloaded, ErrorBody>;
}
