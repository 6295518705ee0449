//! Memory of a buffer that other processes can import.

use std::sync::Arc;

use ash::vk;

use crate::error::GpuError;
use crate::handle::DeviceHandle;
use crate::memory::Memory;

/// Exported buffers end with one of these, bytes: what drivers take memory from the kernel in is no larger, so that nothing lies behind a
/// buffer in its memory that it could not fill.
pub(crate) const PAGE_BYTES: u64 = 64 << 10;

/// What an importer has to say of a buffer, and the memory, which has no descriptor yet; see `Exported`.
pub(crate) struct Lent {
    pub(crate) object: vk::DeviceMemory,
    pub(crate) memory_bytes: u64,
    pub(crate) memory_type: u32,
    pub(crate) alone: bool,
    pub(crate) buffer_bytes: u64,
    pub(crate) usage: u32,
}

/// Whether buffers of this usage must have memory of their own to be exported so; refused where they cannot be.
pub(crate) fn is_exportable(
    device: &DeviceHandle,
    name: &str,
    usage: vk::BufferUsageFlags,
    handle: vk::ExternalMemoryHandleTypeFlags,
) -> Result<bool, GpuError> {
    let info = vk::PhysicalDeviceExternalBufferInfo::default().usage(usage).handle_type(handle);
    let mut properties = vk::ExternalBufferProperties::default();
    // SAFETY: the device is one that the instance listed, and speaks 1.3.
    unsafe {
        let instance = device.instance.raw();
        instance.get_physical_device_external_buffer_properties(device.physical, &info, &mut properties);
    }
    let can = properties.external_memory_properties.external_memory_features;
    if !can.contains(vk::ExternalMemoryFeatureFlags::EXPORTABLE) {
        let device = format!("buffer {name:?} on device {:?}", device.info.name);
        return Err(GpuError::Unsupported { device, missing: format!("the export of its memory as {handle:?}") });
    }
    Ok(can.contains(vk::ExternalMemoryFeatureFlags::DEDICATED_ONLY))
}

/// Memory for a buffer, to be exported; with its bytes and the index of its type.
///
/// # Safety
/// The buffer is of this device, and was created for this handle.
pub(crate) unsafe fn memory_for(
    device: &Arc<DeviceHandle>,
    name: &str,
    buffer: vk::Buffer,
    handle: vk::ExternalMemoryHandleTypeFlags,
    alone: bool,
) -> Result<(Memory, u64, u32), GpuError> {
    // SAFETY: the buffer lives, by this function's contract.
    let (requirements, types) = unsafe {
        let requirements = device.raw.get_buffer_memory_requirements(buffer);
        (requirements, device.instance.raw().get_physical_device_memory_properties(device.physical))
    };
    let limit = device.limits.max_memory_bytes;
    if requirements.size > limit {
        let (object, asked, unit) = (name.into(), requirements.size, "bytes of memory in one piece");
        return Err(GpuError::TooLarge { object, asked, limit, unit });
    }
    let fits = |index: &u32| requirements.memory_type_bits & (1 << index) != 0;
    let is_own = |index: &u32| {
        let flags = types.memory_types[*index as usize].property_flags;
        flags.contains(vk::MemoryPropertyFlags::DEVICE_LOCAL)
    };
    let all = || (0..types.memory_type_count).filter(fits);
    let Some(memory_type) = all().find(is_own).or_else(|| all().next()) else {
        return Err(GpuError::Memory { object: name.into(), detail: "no memory type suits it".into() });
    };
    let mut export = vk::ExportMemoryAllocateInfo::default().handle_types(handle);
    let mut dedicated = vk::MemoryDedicatedAllocateInfo::default().buffer(buffer);
    let mut info = vk::MemoryAllocateInfo::default()
        .allocation_size(requirements.size)
        .memory_type_index(memory_type)
        .push_next(&mut export);
    if alone {
        info = info.push_next(&mut dedicated);
    }
    // SAFETY: size and type are the buffer's, and the device exports such memory.
    let memory = unsafe { Memory::own(device, name, &info)? };
    Ok((memory, requirements.size, memory_type))
}
