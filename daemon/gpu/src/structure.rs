//! Acceleration structures (`VK_KHR_acceleration_structure`): bottom levels over triangles, top levels over placed bottom levels.
//!
//! Each is built once, by the recording that makes it, and never changed: so a picture in flight keeps the structures
//! that it reads, and a move makes another top level. Their barriers are those of the buffer that they lie in.

use std::sync::Arc;

use ash::vk;

use crate::buffer::Buffer;
use crate::error::GpuError;
use crate::ticket::{Phase, Ticket};

/// What the two levels share.
pub(crate) struct Structure {
    pub(crate) raw: vk::AccelerationStructureKHR,
    /// Where it lies; whole, and nothing else does.
    pub(crate) storage: Arc<Buffer>,
    /// Where the device finds it.
    address: vk::DeviceAddress,
    /// The recording that builds it.
    ticket: Arc<Ticket>,
}

impl Structure {
    /// Takes all of `storage` for a structure that the recording of `ticket` is about to build.
    pub(crate) fn new(
        storage: Arc<Buffer>,
        kind: vk::AccelerationStructureTypeKHR,
        ticket: &Arc<Ticket>,
    ) -> Result<Structure, GpuError> {
        let name = storage.name().to_owned();
        let info = vk::AccelerationStructureCreateInfoKHR::default().buffer(storage.raw).size(storage.bytes()).ty(kind);
        let functions = storage.device.ray_queries()?;
        // SAFETY: the buffer is of the kind that structures lie in, as long as this one, and is held beside it; the new
        // object is named before anyone else has it.
        let raw = unsafe {
            let raw = functions
                .raw
                .create_acceleration_structure(&info, None)
                .map_err(|result| GpuError::vulkan(format!("creating structure {name:?}"), result))?;
            storage.device.naming.name(raw, &name);
            raw
        };
        let info = vk::AccelerationStructureDeviceAddressInfoKHR::default().acceleration_structure(raw);
        // SAFETY: the structure was just created, in a buffer that has memory.
        let address = unsafe { functions.raw.get_acceleration_structure_device_address(&info) };
        Ok(Structure { raw, storage, address, ticket: Arc::clone(ticket) })
    }

    /// Refuses one whose building was recorded and never submitted: there is nothing in it that may be walked.
    pub(crate) fn check_built(&self) -> Result<(), GpuError> {
        match self.ticket.phase() {
            Phase::Abandoned => Err(GpuError::Unwritten { object: self.storage.name().into() }),
            Phase::Recorded | Phase::Submitted(_) => Ok(()),
        }
    }
}

impl Drop for Structure {
    fn drop(&mut self) {
        if let Ok(functions) = self.storage.device.ray_queries() {
            // SAFETY: whatever builds or walks the structure holds it by Arc until it has completed. Its buffer goes after it.
            unsafe { functions.raw.destroy_acceleration_structure(self.raw, None) };
        }
    }
}

/// The structure over the triangles of one mesh. Made by [`Recorder::build_bottom_level`](crate::Recorder::build_bottom_level).
pub struct BottomLevel {
    pub(crate) structure: Structure,
}

impl std::fmt::Debug for BottomLevel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "BottomLevel({:?})", self.structure.storage)
    }
}

impl BottomLevel {
    /// Bytes of device memory that it takes.
    pub fn bytes(&self) -> u64 {
        self.structure.storage.bytes()
    }
}

/// The structure over placed bottom levels, which shaders bind. Made by
/// [`Recorder::build_top_level`](crate::Recorder::build_top_level); keeps the bottom levels alive.
pub struct TopLevel {
    pub(crate) structure: Structure,
    /// What its bytes name by address.
    _bottoms: Vec<Arc<BottomLevel>>,
}

impl std::fmt::Debug for TopLevel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "TopLevel({:?})", self.structure.storage)
    }
}

impl TopLevel {
    pub(crate) fn new(structure: Structure, placed: &[Placed<'_>]) -> TopLevel {
        TopLevel { structure, _bottoms: placed.iter().map(|p| Arc::clone(p.bottom)).collect() }
    }

    /// Its name, as the validation layer says it.
    pub fn name(&self) -> &str {
        self.structure.storage.name()
    }

    /// Bytes of device memory that it takes, without the bottom levels.
    pub fn bytes(&self) -> u64 {
        self.structure.storage.bytes()
    }
}

/// A bottom level where it stands.
#[derive(Debug, Clone, Copy)]
pub struct Placed<'a> {
    /// What stands there.
    pub bottom: &'a Arc<BottomLevel>,
    /// Three rows of the affine matrix.
    pub world_from_object: [[f32; 4]; 3],
    /// What a shader is told that it met (its *custom index*), below 2²⁴.
    pub number: u32,
    /// A ray whose mask shares no bit with it passes.
    pub mask: u8,
    /// Whether a hit is one, or for the shader to judge.
    pub opaque: bool,
}

/// Bytes of a placed bottom level, as the device reads it (VkAccelerationStructureInstanceKHR).
pub(crate) const PLACED_BYTES: usize = 64;

impl Placed<'_> {
    /// As the device reads it; nothing is culled by its winding.
    pub(crate) fn words(&self) -> [u32; PLACED_BYTES / 4] {
        let opacity = match self.opaque {
            true => vk::GeometryInstanceFlagsKHR::FORCE_OPAQUE,
            false => vk::GeometryInstanceFlagsKHR::FORCE_NO_OPAQUE,
        };
        let flags = vk::GeometryInstanceFlagsKHR::TRIANGLE_FACING_CULL_DISABLE | opacity;
        let mut words = [0; PLACED_BYTES / 4];
        for (word, number) in words.iter_mut().zip(self.world_from_object.as_flattened()) {
            *word = number.to_bits();
        }
        words[12] = self.number & 0x00ff_ffff | u32::from(self.mask) << 24;
        words[13] = flags.as_raw() << 24;
        words[14] = self.bottom.structure.address as u32;
        words[15] = (self.bottom.structure.address >> 32) as u32;
        words
    }
}
