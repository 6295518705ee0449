//! Building acceleration structures.

use std::sync::Arc;

use ash::vk;

use super::{Recorder, Uses};
use crate::access::{Access, AccessSet};
use crate::buffer::{Buffer, BufferKind};
use crate::error::GpuError;
use crate::structure::{BottomLevel, PLACED_BYTES, Placed, Structure, TopLevel};

/// What the addresses of what structures are built from are multiples of: instances ask for most.
const INPUT_ALIGNMENT: u64 = 16;

/// A buffer and an aligned place in it.
struct Place {
    buffer: Arc<Buffer>,
    offset: u64,
    address: vk::DeviceAddress,
}

impl Recorder {
    /// Builds the structure over a mesh: corners in its object space, and three numbers of corners a triangle. A shader is
    /// told the number of the triangle that it met.
    ///
    /// # Errors
    /// [`GpuError::Unsupported`] on a device that was opened without ray queries, [`GpuError::Misuse`] for no triangles or
    /// one with a corner that is not there, [`GpuError::TooLarge`], or no memory.
    pub fn build_bottom_level(
        &mut self,
        name: &str,
        corners: &[[f32; 3]],
        triangles: &[[u32; 3]],
    ) -> Result<Arc<BottomLevel>, GpuError> {
        let limit = self.device().handle().ray_queries()?.max_triangles;
        let count = count_within(name, triangles.len(), limit, "triangles of a structure")?;
        // The device reads corners by these numbers without asking whether they are there.
        if count == 0 || triangles.as_flattened().iter().any(|&corner| corner as usize >= corners.len()) {
            let problem = format!("{count} triangles between {} corners make no structure", corners.len());
            return Err(GpuError::misuse(name, problem));
        }
        let corner_bytes: Vec<u8> = corners.as_flattened().iter().flat_map(|x| x.to_ne_bytes()).collect();
        let number_bytes: Vec<u8> = triangles.as_flattened().iter().flat_map(|n| n.to_ne_bytes()).collect();
        let corner_place = self.input(&format!("corners of {name}"), &corner_bytes)?;
        let number_place = self.input(&format!("triangles of {name}"), &number_bytes)?;
        let data = vk::AccelerationStructureGeometryTrianglesDataKHR::default()
            .vertex_format(vk::Format::R32G32B32_SFLOAT)
            .vertex_data(vk::DeviceOrHostAddressConstKHR { device_address: corner_place.address })
            .vertex_stride(12)
            .max_vertex(corners.len() as u32 - 1)
            .index_type(vk::IndexType::UINT32)
            .index_data(vk::DeviceOrHostAddressConstKHR { device_address: number_place.address });
        let geometry = vk::AccelerationStructureGeometryKHR::default()
            .geometry_type(vk::GeometryTypeKHR::TRIANGLES)
            .geometry(vk::AccelerationStructureGeometryDataKHR { triangles: data });
        let inputs = [corner_place.buffer, number_place.buffer];
        let kind = vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL;
        let structure = self.build(name, kind, &geometry, count, &inputs, &[])?;
        let bottom = Arc::new(BottomLevel { structure });
        self.keep(&bottom);
        Ok(bottom)
    }

    /// Builds the structure over bottom levels where they stand; one may stand in many places, and none is allowed.
    ///
    /// # Errors
    /// As for [`Recorder::build_bottom_level`]; [`GpuError::Misuse`] for a number of 2²⁴ or more, [`GpuError::Unwritten`]
    /// for a bottom level whose recording was dropped, [`GpuError::OtherDevice`].
    pub fn build_top_level(&mut self, name: &str, placed: &[Placed<'_>]) -> Result<Arc<TopLevel>, GpuError> {
        let limit = self.device().handle().ray_queries()?.max_instances;
        let count = count_within(name, placed.len(), limit, "instances of a structure")?;
        let mut bytes = Vec::with_capacity(placed.len() * PLACED_BYTES);
        for each in placed {
            each.bottom.structure.check_built()?;
            if each.number >= 1 << 24 {
                return Err(GpuError::misuse(name, format!("{} is no number of 24 bits", each.number)));
            }
            bytes.extend(each.words().into_iter().flat_map(u32::to_ne_bytes));
        }
        // None have nothing to read, and a buffer of nothing cannot be.
        bytes.resize(bytes.len().max(PLACED_BYTES), 0);
        let place = self.input(&format!("instances of {name}"), &bytes)?;
        let data = vk::AccelerationStructureGeometryInstancesDataKHR::default()
            .data(vk::DeviceOrHostAddressConstKHR { device_address: place.address });
        let geometry = vk::AccelerationStructureGeometryKHR::default()
            .geometry_type(vk::GeometryTypeKHR::INSTANCES)
            .geometry(vk::AccelerationStructureGeometryDataKHR { instances: data });
        let bottoms: Vec<_> = placed.iter().map(|each| each.bottom).collect();
        let kind = vk::AccelerationStructureTypeKHR::TOP_LEVEL;
        let structure = self.build(name, kind, &geometry, count, &[place.buffer], &bottoms)?;
        let top = Arc::new(TopLevel::new(structure, placed));
        self.keep(&top);
        Ok(top)
    }

    /// Puts bytes where the device reads them to build; they live until it has.
    fn input(&self, name: &str, bytes: &[u8]) -> Result<Place, GpuError> {
        let kind = BufferKind::StructureInput;
        let buffer = Buffer::new(self.device(), name, kind, bytes.len() as u64 + INPUT_ALIGNMENT)?;
        let place = Place::new(buffer, INPUT_ALIGNMENT)?;
        place.buffer.write(place.offset, bytes)?;
        Ok(place)
    }

    /// Records the building of a structure of `count` primitives of a geometry that lies in `inputs` and names `bottoms`.
    fn build(
        &mut self,
        name: &str,
        kind: vk::AccelerationStructureTypeKHR,
        geometry: &vk::AccelerationStructureGeometryKHR<'_>,
        count: u32,
        inputs: &[Arc<Buffer>],
        bottoms: &[&Arc<BottomLevel>],
    ) -> Result<Structure, GpuError> {
        self.check_outside()?;
        let handle = Arc::clone(self.device().handle());
        let functions = handle.ray_queries()?;
        let geometries = std::slice::from_ref(geometry);
        let mut info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
            .ty(kind)
            .flags(vk::BuildAccelerationStructureFlagsKHR::PREFER_FAST_TRACE)
            .mode(vk::BuildAccelerationStructureModeKHR::BUILD)
            .geometries(geometries);
        let mut sizes = vk::AccelerationStructureBuildSizesInfoKHR::default();
        // SAFETY: the description is whole but for the addresses, which this call does not follow.
        unsafe {
            let on_device = vk::AccelerationStructureBuildTypeKHR::DEVICE;
            functions.raw.get_acceleration_structure_build_sizes(on_device, &info, &[count], &mut sizes);
        }
        let bytes = sizes.acceleration_structure_size;
        let storage = Buffer::new(self.device(), name, BufferKind::Structure, bytes)?;
        let scratch_bytes = sizes.build_scratch_size + functions.scratch_alignment;
        let scratch_name = format!("scratch of {name}");
        let scratch = Buffer::new(self.device(), &scratch_name, BufferKind::StructureScratch, scratch_bytes)?;
        let scratch = Place::new(scratch, functions.scratch_alignment)?;
        let structure = Structure::new(storage, kind, &self.recording.ticket)?;

        let mut uses = Uses::default();
        for input in inputs {
            uses.add_buffer(input, AccessSet::of(Access::StructureInput));
        }
        for bottom in bottoms {
            uses.add_buffer(&bottom.structure.storage, AccessSet::of(Access::StructureRead));
        }
        uses.add_buffer(&scratch.buffer, AccessSet::of(Access::StructureWrite));
        uses.add_buffer(&structure.storage, AccessSet::of(Access::StructureWrite));
        self.apply(&uses)?;
        info.dst_acceleration_structure = structure.raw;
        info.scratch_data = vk::DeviceOrHostAddressKHR { device_address: scratch.address };
        let range = vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(count);
        // SAFETY: recording outside of a rendering; structure and scratch have the sizes that the device asked for this very
        // description; every number of a corner is that of one, and every bottom level that is named was built before, by
        // the barrier; inputs and scratch are kept below, the structure and what it names by the callers.
        unsafe {
            let commands = self.recording.commands();
            functions.raw.cmd_build_acceleration_structures(commands, &[info], &[&[range]]);
        }
        for buffer in inputs.iter().chain([&scratch.buffer]) {
            self.keep(buffer);
        }
        Ok(structure)
    }
}

impl Place {
    /// The first aligned address of a buffer that is at least so much longer than what is to lie there.
    fn new(buffer: Arc<Buffer>, alignment: u64) -> Result<Place, GpuError> {
        let start = buffer.address()?;
        let address = start.next_multiple_of(alignment);
        Ok(Place { buffer, offset: address - start, address })
    }
}

fn count_within(name: &str, count: usize, limit: u64, unit: &'static str) -> Result<u32, GpuError> {
    let asked = count as u64;
    match u32::try_from(count) {
        Ok(fits) if asked <= limit => Ok(fits),
        _ => Err(GpuError::TooLarge { object: name.into(), asked, limit, unit }),
    }
}
