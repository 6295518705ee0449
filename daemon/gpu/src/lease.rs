//! A display that was taken over.

use std::sync::Arc;

use ash::vk;

use crate::card::Card;
use crate::connectors::Connector;

/// A display that is ours until this is dropped, or the last one of its card.
pub(crate) struct Lease {
    pub(crate) display: vk::DisplayKHR,
    /// By which it was acquired; None where the driver lets nobody do that.
    #[expect(dead_code, reason = "it is kept: the display is released with the last that keeps its card")]
    pub(crate) card: Option<Arc<Card>>,
    pub(crate) connector: Option<Connector>,
    pub(crate) size_px: [u32; 2],
}

impl Lease {
    pub(crate) fn size_px(&self) -> [u32; 2] {
        self.size_px
    }
}
