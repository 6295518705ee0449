//! A swapchain itself: what its images belong to.

use std::sync::Arc;

use ash::{khr, vk};

use crate::handle::DeviceHandle;
use crate::surface::Surface;

/// The swapchain itself, which its images keep alive.
pub(crate) struct RawSwapchain {
    pub(crate) raw: vk::SwapchainKHR,
    pub(crate) loader: khr::swapchain::Device,
    /// Signalled when an image may be drawn to; one more than there are images.
    pub(crate) acquired: Vec<vk::Semaphore>,
    /// By image: signalled when it was drawn.
    pub(crate) drawn: Vec<vk::Semaphore>,
    pub(crate) device: Arc<DeviceHandle>,
    pub(crate) surface: Arc<Surface>,
}

impl Drop for RawSwapchain {
    fn drop(&mut self) {
        // SAFETY: all images hold this by Arc, so none is in use; their queue has come to rest (`Swapchain`), so that nothing
        // waits for the semaphores any more.
        unsafe {
            for semaphore in self.acquired.iter().chain(&self.drawn) {
                self.device.raw.destroy_semaphore(*semaphore, None);
            }
            self.loader.destroy_swapchain(self.raw, None);
        }
    }
}
