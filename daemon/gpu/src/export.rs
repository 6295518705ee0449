//! Memory and timelines that other processes import, as file descriptors.
//!
//! A buffer is exported rather than an image, since its layout is known to whoever reads it: rows of bytes. Where a device exports
//! dma-bufs, such a buffer can also be imported as a linear image, or by another interface than Vulkan.

use std::os::fd::{FromRawFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ash::{khr, vk};

use crate::buffer::Buffer;
use crate::device::Device;
use crate::error::GpuError;
use crate::external::Lent;
use crate::handle::DeviceHandle;
use crate::optional::TIMELINE_HANDLE;

/// What kind of descriptor stands for memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HandleKind {
    /// One that the same driver alone can import, by Vulkan.
    OpaqueFd,
    /// One that the kernel knows, and other drivers and interfaces.
    DmaBuf,
}

impl HandleKind {
    fn raw(self) -> vk::ExternalMemoryHandleTypeFlags {
        match self {
            HandleKind::OpaqueFd => vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD,
            HandleKind::DmaBuf => vk::ExternalMemoryHandleTypeFlags::DMA_BUF_EXT,
        }
    }
}

/// A buffer, its memory's descriptor, and what an importer has to say to get the same memory.
#[derive(Debug)]
pub struct Exported {
    /// A storage buffer.
    pub buffer: Arc<Buffer>,
    /// Its memory, which begins with it. It lives as long as anybody has it imported.
    pub memory: OwnedFd,
    /// How much memory that is, bytes.
    pub memory_bytes: u64,
    /// The index of its type on this device.
    pub memory_type: u32,
    /// Whether the memory is the buffer's alone (`VkMemoryDedicatedAllocateInfo`).
    pub alone: bool,
    /// The buffer's own size, bytes.
    pub buffer_bytes: u64,
    /// What it may be used for (`VkBufferUsageFlags`): an importer's has the same.
    pub usage: u32,
}

impl Device {
    /// Refuses a kind of descriptor that the device cannot give.
    ///
    /// # Errors
    /// [`GpuError::Unsupported`], which names the extension.
    pub fn must_export(&self, kind: HandleKind) -> Result<(), GpuError> {
        let optional = self.handle().optional;
        let missing = match kind {
            _ if !optional.memory_fd => "VK_KHR_external_memory_fd",
            HandleKind::DmaBuf if !optional.dma_buf => "VK_EXT_external_memory_dma_buf",
            HandleKind::OpaqueFd | HandleKind::DmaBuf => return Ok(()),
        };
        Err(GpuError::Unsupported { device: format!("device {:?}", self.info().name), missing: missing.into() })
    }

    /// Makes a storage buffer of `bytes` bytes whose memory another process can import. Its memory is the device's own, and the
    /// importer can write to it: nothing may be in it that is read back and trusted.
    ///
    /// # Errors
    /// As for [`Buffer::new`], and [`GpuError::Unsupported`].
    pub fn export_buffer(&self, name: &str, bytes: u64, kind: HandleKind) -> Result<Exported, GpuError> {
        self.must_export(kind)?;
        let handle = self.handle();
        let (buffer, lent) = Buffer::exported(handle, name, bytes, kind.raw())?;
        let loader = khr::external_memory_fd::Device::new(handle.instance.raw(), &handle.raw);
        let info = vk::MemoryGetFdInfoKHR::default().memory(lent.object).handle_type(kind.raw());
        // SAFETY: the extension is enabled; the memory was made to be exported so, and lives as long as the buffer.
        let fd = unsafe { loader.get_memory_fd(&info) }
            .map_err(|result| GpuError::vulkan(format!("exporting the memory of {name:?}"), result))?;
        // SAFETY: each descriptor that Vulkan gives is its caller's own.
        let memory = unsafe { OwnedFd::from_raw_fd(fd) };
        let Lent { memory_bytes, memory_type, alone, buffer_bytes, usage, .. } = lent;
        Ok(Exported { buffer, memory, memory_bytes, memory_type, alone, buffer_bytes, usage })
    }

    /// Makes a timeline that another process can import, with its descriptor; None on a device that exports none.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::buffer::BufferKind;
    use crate::cache::PipelineCache;
    use crate::command::Recorder;
    use crate::families;
    use crate::instance::{Instance, Validation};
    use crate::optional::Optional;
    use crate::queue::Queue;
    use crate::select;
    use std::sync::Mutex;
    use std::time::Duration;

    #[test]
    fn what_is_handed_out_can_be_written_again() {
        let instance = Instance::new(Validation::On).unwrap();
        let device = Device::open(&instance, None, 1, None).unwrap();
        let exported = device.export_buffer("exported", 4096, HandleKind::OpaqueFd).unwrap();
        assert!(exported.memory_bytes >= 4096 && rustix::fs::fstat(&exported.memory).is_ok());
        let timeline = device.export_timeline("exported").unwrap().map(|(timeline, _)| timeline);
        let back = Buffer::new(&device, "back", BufferKind::Readback, 4096).unwrap();
        for turn in 1..5u32 {
            let mut recorder = Recorder::new(&device, 0, "picture").unwrap();
            recorder.fill(&exported.buffer, turn).unwrap();
            recorder.copy_buffer(&exported.buffer, 0, &back, 0, 4096).unwrap();
            let value = recorder.hand_out(&exported.buffer, timeline.as_ref()).unwrap();
            assert_eq!(value, timeline.as_ref().map(|_| u64::from(turn)));
            device.submit(recorder.finish().unwrap(), &[]).unwrap().wait(Duration::from_secs(60)).unwrap();
            assert_eq!(back.read(0, 4).unwrap(), turn.to_ne_bytes());
        }
        drop((exported, back, timeline, device));
        assert_eq!(instance.validation_messages(), Vec::<String>::new());
    }

    #[test]
    fn a_device_without_the_extensions_refuses_by_their_names() {
        let instance = Instance::new(Validation::On).unwrap();
        let info = select::choose(&instance.devices().unwrap(), None).unwrap().clone();
        let physical = instance.physical_devices().unwrap()[info.index];
        let family = families::serving(&families::all(&instance, physical)).unwrap();
        let with = |optional: Optional| {
            let families = (family, None);
            let mut handle = DeviceHandle::create(&instance, physical, info.clone(), families, 1, false).unwrap();
            Arc::get_mut(&mut handle).unwrap().optional = optional;
            let queues = Queue::all(&handle, family.index, 1).unwrap();
            let (cache, release) = (PipelineCache::open(&handle, None).unwrap(), Arc::default());
            Device { handle, queues, projector_queues: 1, release, cache, work: Mutex::default() }
        };
        let words = |device: &Device, kind| device.export_buffer("exported", 4096, kind).unwrap_err().to_string();
        let device = with(Optional { memory_fd: true, ..Optional::default() });
        assert!(device.must_export(HandleKind::OpaqueFd).is_ok() && device.export_timeline("one").unwrap().is_none());
        let no_dma_buf = words(&device, HandleKind::DmaBuf);
        assert!(no_dma_buf.contains("VK_EXT_external_memory_dma_buf"), "{no_dma_buf}");
        let nothing = words(&with(Optional::default()), HandleKind::OpaqueFd);
        assert!(nothing.contains("VK_KHR_external_memory_fd"), "{nothing}");
    }
}
