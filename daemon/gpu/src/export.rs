//! Memory that other processes import, as file descriptors.
//!
//! A buffer is exported rather than an image, since its layout is known to whoever reads it: rows of bytes. Where a device exports
//! dma-bufs, such a buffer can also be imported as a linear image, or by another interface than Vulkan.

use std::os::fd::{FromRawFd, OwnedFd};
use std::sync::Arc;

use ash::{khr, vk};

use crate::buffer::Buffer;
use crate::command::Recorder;
use crate::device::Device;
use crate::error::GpuError;
use crate::external::Lent;
use crate::optional::Optional;

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

    /// The family of queues that stands for whoever has imported such memory. The same driver is EXTERNAL; what may be any driver and
    /// any device is FOREIGN, where that may be said.
    pub(crate) fn family(self, optional: Optional) -> u32 {
        match self {
            HandleKind::DmaBuf if optional.foreign => vk::QUEUE_FAMILY_FOREIGN_EXT,
            HandleKind::OpaqueFd | HandleKind::DmaBuf => vk::QUEUE_FAMILY_EXTERNAL,
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
    /// importer can write to it: nothing may be in it that is read back and trusted. It holds zeroes, and the host has waited for
    /// these: memory comes with what others have left there, which is nobody's to see.
    ///
    /// # Errors
    /// As for [`Buffer::new`], [`GpuError::Unsupported`], and those of [`Submission::wait`](crate::Submission::wait).
    pub fn export_buffer(self: &Arc<Self>, name: &str, bytes: u64, kind: HandleKind) -> Result<Exported, GpuError> {
        self.must_export(kind)?;
        let handle = self.handle();
        let (buffer, lent) = Buffer::exported(handle, name, bytes, (kind.raw(), kind.family(handle.optional)))?;
        self.clear(&buffer)?;
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

    /// Fills all of a buffer with zeroes, and waits for that.
    fn clear(self: &Arc<Self>, buffer: &Arc<Buffer>) -> Result<(), GpuError> {
        let mut recorder = Recorder::new(self, 0, buffer.name())?;
        recorder.fill(buffer, 0)?;
        self.submit(recorder.finish()?, &[])?.wait(self.hung_after())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::buffer::BufferKind;
    use crate::cache::PipelineCache;
    use crate::external::PAGE_BYTES;
    use crate::families;
    use crate::handle::DeviceHandle;
    use crate::instance::{Instance, Validation};
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
        // Another buffer's is not handed out.
        let mut recorder = Recorder::new(&device, 0, "no picture").unwrap();
        assert!(matches!(recorder.hand_out(&back, None), Err(GpuError::Misuse { .. })));
        drop(recorder);
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
    fn what_is_handed_out_holds_nothing_that_others_left() {
        let instance = Instance::new(Validation::On).unwrap();
        let device = Device::open(&instance, None, 1, None).unwrap();
        const BYTES: u64 = 100_000;
        let Exported { buffer, memory_bytes, buffer_bytes, .. } =
            device.export_buffer("exported", BYTES, HandleKind::OpaqueFd).unwrap();
        // Nothing lies behind the buffer that it could not fill.
        assert!(buffer_bytes.is_multiple_of(PAGE_BYTES) && memory_bytes == buffer_bytes, "{memory_bytes} bytes");
        let back = Buffer::new(&device, "back", BufferKind::Readback, BYTES).unwrap();
        let is_all = |value: u8| {
            let mut recorder = Recorder::new(&device, 0, "look").unwrap();
            recorder.copy_buffer(&buffer, 0, &back, 0, BYTES).unwrap();
            device.submit(recorder.finish().unwrap(), &[]).unwrap().wait(Duration::from_secs(60)).unwrap();
            back.read(0, BYTES).unwrap().iter().all(|byte| *byte == value)
        };
        assert!(is_all(0));
        // Some drivers' memory is empty by itself. This is not.
        let mut recorder = Recorder::new(&device, 0, "left by others").unwrap();
        recorder.fill(&buffer, u32::MAX).unwrap();
        device.submit(recorder.finish().unwrap(), &[]).unwrap().wait(Duration::from_secs(60)).unwrap();
        assert!(is_all(255));
        device.clear(&buffer).unwrap();
        assert!(is_all(0));
        drop((buffer, back));
        drop(device);
        assert_eq!(instance.validation_messages(), Vec::<String>::new());
    }

    #[test]
    fn another_driver_is_foreign_where_that_can_be_said() {
        let (without, with) = (Optional::default(), Optional { foreign: true, ..Optional::default() });
        for (kind, optional, family) in [
            (HandleKind::OpaqueFd, without, vk::QUEUE_FAMILY_EXTERNAL),
            (HandleKind::OpaqueFd, with, vk::QUEUE_FAMILY_EXTERNAL),
            (HandleKind::DmaBuf, without, vk::QUEUE_FAMILY_EXTERNAL),
            (HandleKind::DmaBuf, with, vk::QUEUE_FAMILY_FOREIGN_EXT),
        ] {
            assert_eq!(kind.family(optional), family, "{kind:?}");
        }
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
            Arc::new(Device { handle, queues, projector_queues: 1, release, cache, work: Mutex::default() })
        };
        let words = |device: &Arc<Device>, kind| device.export_buffer("exported", 4096, kind).unwrap_err().to_string();
        let device = with(Optional { memory_fd: true, ..Optional::default() });
        assert!(device.must_export(HandleKind::OpaqueFd).is_ok() && device.export_timeline("one").unwrap().is_none());
        let no_dma_buf = words(&device, HandleKind::DmaBuf);
        assert!(no_dma_buf.contains("VK_EXT_external_memory_dma_buf"), "{no_dma_buf}");
        let nothing = words(&with(Optional::default()), HandleKind::OpaqueFd);
        assert!(nothing.contains("VK_KHR_external_memory_fd"), "{nothing}");
    }
}
