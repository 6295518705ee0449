//! A display that was taken over, and the card's file by which that was done.

use std::fs::File;
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::Arc;

use ash::{ext, vk};
use drm::control::Device as _;

use crate::connectors::Connector;
use crate::instance::Instance;

/// A display that is ours until this is dropped.
pub(crate) struct Lease {
    pub(crate) instance: Arc<Instance>,
    pub(crate) physical: vk::PhysicalDevice,
    pub(crate) display: vk::DisplayKHR,
    /// The card's file, by which it was acquired.
    pub(crate) card: Option<Card>,
    pub(crate) connector: Option<Connector>,
    pub(crate) size_px: [u32; 2],
}

impl Lease {
    pub(crate) fn size_px(&self) -> [u32; 2] {
        self.size_px
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        if self.card.is_some() {
            let loader = ext::direct_mode_display::Instance::new(self.instance.entry(), self.instance.raw());
            // SAFETY: the display was acquired, and its surface is gone: that owns this lease. What the driver answers changes
            // nothing any more.
            let _ = unsafe { (loader.fp().release_display_ext)(self.physical, self.display) };
        }
    }
}

/// A card's file, for the questions of `drm`.
pub(crate) struct Card(pub(crate) File);

impl AsFd for Card {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

impl drm::Device for Card {}
impl drm::control::Device for Card {}

impl Card {
    /// The kernel's number of a connector.
    pub(crate) fn connector_id(&self, name: &str) -> std::io::Result<Option<u32>> {
        for handle in self.resource_handles()?.connectors() {
            let connector = self.get_connector(*handle, false)?;
            if format!("{}-{}", connector.interface().as_str(), connector.interface_id()) == name {
                return Ok(Some(u32::from(*handle)));
            }
        }
        Ok(None)
    }
}
