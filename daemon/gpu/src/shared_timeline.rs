//! Timelines that other processes import, as file descriptors.

use std::os::fd::{FromRawFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ash::{khr, vk};

use crate::device::Device;
use crate::error::GpuError;
use crate::handle::DeviceHandle;
use crate::optional::TIMELINE_HANDLE;

impl Device {
    /// Makes a timeline that another process can import, with its descriptor; None on a device that exports none. The same driver
    /// alone can import it, as memory of [`HandleKind::OpaqueFd`](crate::HandleKind::OpaqueFd).
    ///
    /// # Errors
    /// What the driver says.
    pub fn export_timeline(&self, name: &str) -> Result<Option<(Arc<SharedTimeline>, OwnedFd)>, GpuError> {
        let handle = self.handle();
        if !handle.optional.timeline_fd {
            return Ok(None);
        }
        let refused = |result| GpuError::vulkan(format!("exporting the timeline {name:?}"), result);
        let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let mut export = vk::ExportSemaphoreCreateInfo::default().handle_types(TIMELINE_HANDLE);
        let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind).push_next(&mut export);
        // SAFETY: timelines are enabled on every device that is opened, and this one was seen to export them; the new object is
        // named before anyone else has it.
        let raw = unsafe {
            let raw = handle.raw.create_semaphore(&info, None).map_err(refused)?;
            handle.naming.name(raw, name);
            raw
        };
        let timeline = Arc::new(SharedTimeline { raw, device: Arc::clone(handle), last: AtomicU64::new(0) });
        let loader = khr::external_semaphore_fd::Device::new(handle.instance.raw(), &handle.raw);
        let info = vk::SemaphoreGetFdInfoKHR::default().semaphore(raw).handle_type(TIMELINE_HANDLE);
        // SAFETY: the extension is enabled, and the semaphore was made to be exported so.
        let fd = unsafe { loader.get_semaphore_fd(&info) }.map_err(refused)?;
        // SAFETY: each descriptor that Vulkan gives is its caller's own.
        Ok(Some((timeline, unsafe { OwnedFd::from_raw_fd(fd) })))
    }
}

/// A timeline semaphore that another process has imported. It only counts up; what the importer does to it concerns the importer
/// alone, since nothing here waits for it.
pub struct SharedTimeline {
    raw: vk::Semaphore,
    device: Arc<DeviceHandle>,
    last: AtomicU64,
}

impl std::fmt::Debug for SharedTimeline {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "SharedTimeline({})", self.last.load(Ordering::Relaxed))
    }
}

impl SharedTimeline {
    pub(crate) fn raw(&self) -> vk::Semaphore {
        self.raw
    }

    pub(crate) fn device(&self) -> &Arc<DeviceHandle> {
        &self.device
    }

    /// The value of the next hand-over.
    pub(crate) fn next(&self) -> u64 {
        self.last.fetch_add(1, Ordering::Relaxed) + 1
    }
}

impl Drop for SharedTimeline {
    fn drop(&mut self) {
        // SAFETY: submissions in flight keep it by Arc, so that no queue uses it any more.
        unsafe { self.device.raw.destroy_semaphore(self.raw, None) };
    }
}
