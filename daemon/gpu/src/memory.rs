//! Memory of one buffer or image, from the device's allocator.

use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};

use ash::vk;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use gpu_allocator::{AllocationError, MemoryLocation};

use crate::error::GpuError;
use crate::handle::DeviceHandle;

/// A piece of device memory; goes back to where it came from when dropped.
pub(crate) struct Memory {
    device: Arc<DeviceHandle>,
    source: Source,
    bytes: u64,
}

/// Where memory comes from.
enum Source {
    /// The device's allocator, whose blocks hold several objects. None only while it is being dropped.
    Shared(Option<Allocation>),
    /// A memory object of its own, which the host does not map.
    Own(vk::DeviceMemory),
}

impl Memory {
    /// Takes memory that meets `requirements`. What the host can see is always coherent.
    pub(crate) fn new(
        device: &Arc<DeviceHandle>,
        name: &str,
        requirements: vk::MemoryRequirements,
        location: MemoryLocation,
        linear: bool,
    ) -> Result<Memory, GpuError> {
        let limit = device.limits.max_memory_bytes;
        if requirements.size > limit {
            let (object, asked, unit) = (name.into(), requirements.size, "bytes of memory in one piece");
            return Err(GpuError::TooLarge { object, asked, limit, unit });
        }
        let mut allocator = device.allocator.lock().unwrap_or_else(PoisonError::into_inner);
        let allocator = allocator.as_mut().ok_or_else(|| GpuError::misuse(name, "its device is being closed"))?;
        let description = AllocationCreateDesc {
            name,
            requirements,
            location,
            linear,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        };
        let allocation = allocator.allocate(&description).map_err(|error| match error {
            AllocationError::OutOfMemory => {
                GpuError::OutOfDeviceMemory { operation: format!("taking {} bytes for {name:?}", requirements.size) }
            }
            error => GpuError::Memory { object: name.into(), detail: error.to_string() },
        })?;
        let bytes = allocation.size();
        device.allocated_bytes.fetch_add(bytes, Ordering::Relaxed);
        Ok(Memory { device: Arc::clone(device), source: Source::Shared(Some(allocation)), bytes })
    }

    /// Takes a memory object of its own, as `info` says.
    ///
    /// # Safety
    /// `info` is valid for the device, and its structures are.
    pub(crate) unsafe fn own(
        device: &Arc<DeviceHandle>,
        name: &str,
        info: &vk::MemoryAllocateInfo<'_>,
    ) -> Result<Memory, GpuError> {
        let bytes = info.allocation_size;
        // SAFETY: by this function's contract; the new object is named before anyone else has it.
        let raw = unsafe {
            let raw = device
                .raw
                .allocate_memory(info, None)
                .map_err(|result| GpuError::vulkan(format!("taking {bytes} bytes for {name:?}"), result))?;
            device.naming.name(raw, name);
            raw
        };
        device.allocated_bytes.fetch_add(bytes, Ordering::Relaxed);
        Ok(Memory { device: Arc::clone(device), source: Source::Own(raw), bytes })
    }

    /// The memory object and the offset in it, to bind.
    ///
    /// # Safety
    /// Only to bind one object that is destroyed before this memory is dropped.
    pub(crate) unsafe fn place(&self) -> (vk::DeviceMemory, u64) {
        match &self.source {
            // SAFETY: the caller does not free the memory object, by this function's contract.
            Source::Shared(Some(allocation)) => (unsafe { allocation.memory() }, allocation.offset()),
            Source::Shared(None) => (vk::DeviceMemory::null(), 0),
            Source::Own(raw) => (*raw, 0),
        }
    }

    /// Where the host sees it, and how many bytes; None for memory of the device alone.
    pub(crate) fn mapped(&self) -> Option<(std::ptr::NonNull<u8>, u64)> {
        let Source::Shared(Some(allocation)) = &self.source else { return None };
        Some((allocation.mapped_ptr()?.cast(), allocation.size()))
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        let allocation = match &mut self.source {
            Source::Shared(allocation) => allocation.take(),
            Source::Own(raw) => {
                self.device.allocated_bytes.fetch_sub(self.bytes, Ordering::Relaxed);
                // SAFETY: what was bound to it is destroyed before, by the contract of `place`.
                unsafe { self.device.raw.free_memory(*raw, None) };
                return;
            }
        };
        let mut allocator = self.device.allocator.lock().unwrap_or_else(PoisonError::into_inner);
        if let (Some(allocator), Some(allocation)) = (allocator.as_mut(), allocation) {
            self.device.allocated_bytes.fetch_sub(self.bytes, Ordering::Relaxed);
            if let Err(error) = allocator.free(allocation) {
                tracing::error!(%error, "memory could not be given back");
            }
        }
    }
}
