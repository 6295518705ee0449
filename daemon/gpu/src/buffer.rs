//! Buffers: their memory, their texel view, and the host's access to those that it maps.

use std::sync::{Arc, Mutex, PoisonError};

use ash::vk;
use gpu_allocator::MemoryLocation;

use crate::device::Device;
use crate::error::GpuError;
use crate::external::{self, Lent};
use crate::handle::{DeviceHandle, Limits};
use crate::history::History;
use crate::memory::Memory;

/// What a buffer is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BufferKind {
    /// Device memory, bound as a storage buffer.
    Storage,
    /// Device memory, bound as a uniform texel buffer of this format, or as a storage buffer: either, unless it is too long for one.
    Texel(TexelFormat),
    /// Memory that the host maps and writes, bound as a uniform buffer.
    Uniform,
    /// Memory that the host maps and writes, bound as a storage buffer.
    HostStorage,
    /// Cached memory that the host maps and reads; the destination of copies.
    Readback,
    /// Memory that the host maps and writes; the source of copies.
    Staging,
    /// Memory that the host maps and writes; what acceleration structures are built from.
    StructureInput,
    /// Device memory in which an acceleration structure lies.
    Structure,
    /// Device memory in which one is built.
    StructureScratch,
}

/// The format of a texel buffer's elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TexelFormat {
    /// Four 32-bit unsigned integers, 16 bytes.
    Rgba32Uint,
    /// Four 32-bit floats, 16 bytes.
    Rgba32Float,
    /// One 32-bit unsigned integer, 4 bytes.
    R32Uint,
}

impl TexelFormat {
    /// Bytes of one element.
    pub fn bytes(self) -> u64 {
        match self {
            TexelFormat::Rgba32Uint | TexelFormat::Rgba32Float => 16,
            TexelFormat::R32Uint => 4,
        }
    }

    fn raw(self) -> vk::Format {
        match self {
            TexelFormat::Rgba32Uint => vk::Format::R32G32B32A32_UINT,
            TexelFormat::Rgba32Float => vk::Format::R32G32B32A32_SFLOAT,
            TexelFormat::R32Uint => vk::Format::R32_UINT,
        }
    }
}

impl BufferKind {
    fn usage(self) -> vk::BufferUsageFlags {
        let copies = vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST;
        let storage = vk::BufferUsageFlags::STORAGE_BUFFER;
        match self {
            BufferKind::Storage => copies | storage | vk::BufferUsageFlags::INDIRECT_BUFFER,
            BufferKind::Texel(_) => copies | storage | vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER,
            BufferKind::Uniform => copies | vk::BufferUsageFlags::UNIFORM_BUFFER,
            BufferKind::HostStorage => copies | storage,
            BufferKind::Readback | BufferKind::Staging => copies,
            BufferKind::StructureInput => {
                vk::BufferUsageFlags::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR | Self::BY_ADDRESS
            }
            BufferKind::Structure => vk::BufferUsageFlags::ACCELERATION_STRUCTURE_STORAGE_KHR | Self::BY_ADDRESS,
            BufferKind::StructureScratch => storage | Self::BY_ADDRESS,
        }
    }

    const BY_ADDRESS: vk::BufferUsageFlags = vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS;

    fn location(self) -> MemoryLocation {
        match self {
            BufferKind::Storage | BufferKind::Texel(_) | BufferKind::Structure | BufferKind::StructureScratch => {
                MemoryLocation::GpuOnly
            }
            BufferKind::Uniform | BufferKind::HostStorage | BufferKind::Staging | BufferKind::StructureInput => {
                MemoryLocation::CpuToGpu
            }
            BufferKind::Readback => MemoryLocation::GpuToCpu,
        }
    }

    /// Refuses sizes that no binding of this kind could take.
    fn check(self, name: &str, bytes: u64, raw_bytes: u64, limits: &Limits) -> Result<(), GpuError> {
        let (asked, limit, unit) = match self {
            BufferKind::Storage | BufferKind::HostStorage => {
                (bytes, limits.max_storage_buffer_bytes, "bytes of a storage buffer")
            }
            BufferKind::Texel(format) => {
                if !bytes.is_multiple_of(format.bytes()) {
                    let problem = format!("{bytes} bytes are no whole number of {}-byte texels", format.bytes());
                    return Err(GpuError::misuse(name, problem));
                }
                let elements = bytes / format.bytes();
                // It is of use where one of the two ways can take it whole.
                let limit = limits.max_texel_buffer_elements.max(limits.max_storage_buffer_bytes / format.bytes());
                (elements, limit, "elements of a texel buffer")
            }
            BufferKind::Uniform => (bytes, limits.max_uniform_buffer_bytes, "bytes of a uniform buffer"),
            BufferKind::Readback
            | BufferKind::Staging
            | BufferKind::StructureInput
            | BufferKind::Structure
            | BufferKind::StructureScratch => (raw_bytes, limits.max_buffer_bytes, "bytes of a buffer"),
        };
        if bytes == 0 {
            return Err(GpuError::misuse(name, "a buffer of no bytes"));
        }
        let rows = [(asked, limit, unit), (raw_bytes, limits.max_buffer_bytes, "bytes of a buffer")];
        match rows.into_iter().find(|(asked, limit, _)| asked > limit) {
            Some((asked, limit, unit)) => Err(GpuError::TooLarge { object: name.into(), asked, limit, unit }),
            None => Ok(()),
        }
    }
}

/// A buffer on a device. Its contents are undetermined until something writes them.
pub struct Buffer {
    pub(crate) raw: vk::Buffer,
    /// The view of a texel buffer that is not too long for one, else null.
    pub(crate) view: vk::BufferView,
    pub(crate) device: Arc<DeviceHandle>,
    pub(crate) history: Mutex<History>,
    /// Of exported memory: the family of queues that stands for whoever imported it.
    pub(crate) importers: Option<u32>,
    memory: Option<Memory>,
    name: String,
    kind: BufferKind,
    bytes: u64,
}

impl std::fmt::Debug for Buffer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Buffer({:?}, {:?}, {} bytes)", self.name, self.kind, self.bytes)
    }
}

impl Buffer {
    /// Creates a buffer of `bytes` bytes.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] where the device could not bind it whole, [`GpuError::Misuse`] for no bytes or a broken
    /// texel, [`GpuError::OutOfDeviceMemory`], [`GpuError::Unsupported`] for what structures need on a device without ray
    /// queries.
    pub fn new(device: &Arc<Device>, name: &str, kind: BufferKind, bytes: u64) -> Result<Arc<Buffer>, GpuError> {
        let device = device.handle();
        // Whole words, so that a fill reaches the last byte.
        let raw_bytes = bytes.checked_next_multiple_of(4).ok_or_else(|| GpuError::misuse(name, "too many bytes"))?;
        kind.check(name, bytes, raw_bytes, &device.limits)?;
        if kind.usage().contains(BufferKind::BY_ADDRESS) {
            device.ray_queries()?;
        }
        // Where uploads have a queue of another family, both may touch every buffer without handing it over. For buffers that
        // costs nothing on the drivers that have such families, and a hand-over would be a barrier on either side of each slice.
        let mut info = vk::BufferCreateInfo::default().size(raw_bytes).usage(kind.usage());
        if device.families.len() > 1 {
            info = info.sharing_mode(vk::SharingMode::CONCURRENT).queue_family_indices(&device.families);
        }
        // SAFETY: size and usage are valid.
        let mut buffer = unsafe { Buffer::create(device, name, &info, (kind, bytes), None)? };
        buffer.bind_memory()?;
        if let BufferKind::Texel(format) = kind
            && bytes / format.bytes() <= device.limits.max_texel_buffer_elements
        {
            let info = vk::BufferViewCreateInfo::default().buffer(buffer.raw).format(format.raw()).range(bytes);
            // SAFETY: the buffer has this usage, the range is whole texels within it and within the device's limit,
            // and Vulkan 1.3 requires these formats for uniform texel buffers.
            buffer.view = unsafe { device.raw.create_buffer_view(&info, None) }
                .map_err(|result| GpuError::vulkan(format!("creating the view of buffer {name:?}"), result))?;
        }
        Ok(Arc::new(buffer))
    }

    /// The object, without memory yet, and owned from here on, so that it is destroyed when a later step fails.
    ///
    /// # Safety
    /// `info` is valid for this device, of this kind and no fewer bytes.
    unsafe fn create(
        device: &Arc<DeviceHandle>,
        name: &str,
        info: &vk::BufferCreateInfo<'_>,
        (kind, bytes): (BufferKind, u64),
        importers: Option<u32>,
    ) -> Result<Buffer, GpuError> {
        // SAFETY: by this function's contract; the new object is named before anyone else has it.
        let raw = unsafe {
            let raw = device
                .raw
                .create_buffer(info, None)
                .map_err(|result| GpuError::vulkan(format!("creating buffer {name:?}"), result))?;
            device.naming.name(raw, name);
            raw
        };
        Ok(Buffer {
            raw,
            view: vk::BufferView::null(),
            device: Arc::clone(device),
            history: Mutex::default(),
            importers,
            memory: None,
            name: name.into(),
            kind,
            bytes,
        })
    }

    /// A storage buffer whose memory can be exported as `handle`, to processes that a family of queues stands for, with the memory's type
    /// and whether it is the buffer's alone.
    ///
    /// # Errors
    /// As for [`Buffer::new`], and [`GpuError::Unsupported`].
    pub(crate) fn exported(
        device: &Arc<DeviceHandle>,
        name: &str,
        bytes: u64,
        (handle, importers): (vk::ExternalMemoryHandleTypeFlags, u32),
    ) -> Result<(Arc<Buffer>, Lent), GpuError> {
        let kind = BufferKind::Storage;
        let raw_bytes = bytes
            .checked_next_multiple_of(external::PAGE_BYTES)
            .ok_or_else(|| GpuError::misuse(name, "too many bytes"))?;
        kind.check(name, bytes, raw_bytes, &device.limits)?;
        let alone = external::is_exportable(device, name, kind.usage(), handle)?;
        let mut external = vk::ExternalMemoryBufferCreateInfo::default().handle_types(handle);
        let info = vk::BufferCreateInfo::default().size(raw_bytes).usage(kind.usage()).push_next(&mut external);
        // SAFETY: size and usage are valid, and the device exports such buffers.
        let mut buffer = unsafe { Buffer::create(device, name, &info, (kind, bytes), Some(importers))? };
        let raw = buffer.raw;
        // SAFETY: the buffer was just created, for this handle.
        let (memory, memory_bytes, memory_type) = unsafe { external::memory_for(device, name, raw, handle, alone)? };
        // SAFETY: the buffer has no memory yet; the memory suits its requirements, and `buffer` drops the buffer before it.
        let object = unsafe {
            let (object, offset) = memory.place();
            buffer.memory = Some(memory);
            device
                .raw
                .bind_buffer_memory(raw, object, offset)
                .map_err(|result| GpuError::vulkan(format!("binding memory to buffer {name:?}"), result))?;
            object
        };
        let usage = kind.usage().as_raw();
        Ok((Arc::new(buffer), Lent { object, memory_bytes, memory_type, alone, buffer_bytes: raw_bytes, usage }))
    }

    /// Its size in bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// What it is for.
    pub fn kind(&self) -> BufferKind {
        self.kind
    }

    /// Its name, as the validation layer says it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Writes `data` at `offset` bytes through the mapping. What is recorded but not yet submitted will see it.
    ///
    /// # Errors
    /// [`GpuError::Misuse`] for memory of the device alone, [`GpuError::Range`], and [`GpuError::InFlight`] while
    /// submitted work uses the buffer.
    pub fn write(&self, offset: u64, data: &[u8]) -> Result<(), GpuError> {
        self.check_range(offset, data.len() as u64)?;
        let history = self.history.lock().unwrap_or_else(PoisonError::into_inner);
        let _gate = self.device.gate.read().unwrap_or_else(PoisonError::into_inner);
        if history.in_flight(false)? {
            return Err(GpuError::InFlight { object: self.name.clone(), operation: "written" });
        }
        let at = self.mapped(offset, data.len())?;
        // SAFETY: `at` is mapped for these bytes. No one else touches them: other threads are held by the lock on the
        // history, and the device uses nothing of this buffer, as just seen, nor begins to while the gate is held.
        unsafe { std::ptr::copy_nonoverlapping(data.as_ptr(), at, data.len()) };
        Ok(())
    }

    /// Reads `bytes` bytes from `offset` through the mapping: what the last completed submission left there.
    ///
    /// # Errors
    /// [`GpuError::Misuse`] for memory of the device alone, [`GpuError::Range`], and [`GpuError::InFlight`] while
    /// submitted work writes the buffer.
    pub fn read(&self, offset: u64, bytes: u64) -> Result<Vec<u8>, GpuError> {
        self.check_range(offset, bytes)?;
        let length = usize::try_from(bytes).map_err(|_| GpuError::misuse(&self.name, "more bytes than memory has"))?;
        let history = self.history.lock().unwrap_or_else(PoisonError::into_inner);
        let _gate = self.device.gate.read().unwrap_or_else(PoisonError::into_inner);
        if history.in_flight(true)? {
            return Err(GpuError::InFlight { object: self.name.clone(), operation: "read" });
        }
        let at = self.mapped(offset, length)?;
        // SAFETY: `at` is mapped for these bytes, and no one writes them: see `write`.
        Ok(unsafe { std::slice::from_raw_parts(at, length) }.to_vec())
    }

    /// Where the device finds it; refused for kinds that are not named by address.
    pub(crate) fn address(&self) -> Result<vk::DeviceAddress, GpuError> {
        if !self.kind.usage().contains(BufferKind::BY_ADDRESS) {
            return Err(GpuError::misuse(&self.name, format!("a buffer of kind {:?} has no address", self.kind)));
        }
        let info = vk::BufferDeviceAddressInfo::default().buffer(self.raw);
        // SAFETY: the buffer has memory and this usage, which it has only on a device with that feature.
        Ok(unsafe { self.device.raw.get_buffer_device_address(&info) })
    }

    /// Whether the host maps its memory.
    pub(crate) fn is_mapped(&self) -> bool {
        self.kind.location() != MemoryLocation::GpuOnly
    }

    /// Refuses a range that is not inside the buffer.
    pub(crate) fn check_range(&self, offset: u64, bytes: u64) -> Result<(), GpuError> {
        match offset.checked_add(bytes) {
            Some(end) if end <= self.bytes => Ok(()),
            _ => Err(GpuError::Range { object: self.name.clone(), offset, bytes, size: self.bytes }),
        }
    }

    /// The mapped address of `length` bytes at `offset`, which the caller has found to be inside the buffer.
    fn mapped(&self, offset: u64, length: usize) -> Result<*mut u8, GpuError> {
        let refuse = || GpuError::misuse(&self.name, format!("the host does not map a buffer of kind {:?}", self.kind));
        if !self.is_mapped() {
            return Err(refuse());
        }
        let (start, mapped_bytes) = self.memory.as_ref().and_then(Memory::mapped).ok_or_else(refuse)?;
        if offset + length as u64 > mapped_bytes {
            return Err(refuse());
        }
        // SAFETY: the mapping has `mapped_bytes` bytes, and the range was just seen to lie within them.
        Ok(unsafe { start.as_ptr().add(offset as usize) })
    }

    fn bind_memory(&mut self) -> Result<(), GpuError> {
        // SAFETY: the buffer was just created and has no memory yet; the memory suits its requirements, and `self`
        // drops the buffer before the memory.
        unsafe {
            let requirements = self.device.raw.get_buffer_memory_requirements(self.raw);
            let memory = Memory::new(&self.device, &self.name, requirements, self.kind.location(), true)?;
            let (object, offset) = memory.place();
            self.memory = Some(memory);
            self.device
                .raw
                .bind_buffer_memory(self.raw, object, offset)
                .map_err(|result| GpuError::vulkan(format!("binding memory to buffer {:?}", self.name), result))
        }
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        // SAFETY: whatever uses the buffer on the device holds it by Arc until it has completed, so nothing does; the
        // view is null or this buffer's, and the memory is dropped after this.
        unsafe {
            self.device.raw.destroy_buffer_view(self.view, None);
            self.device.raw.destroy_buffer(self.raw, None);
        }
    }
}
