//! Pipelines: compute and graphics.

mod compute;
mod graphics;

use ash::vk;

pub use compute::ComputePipeline;
pub use graphics::{DepthTest, GraphicsDesc, GraphicsPipeline};

/// Specialisation constants, laid out for Vulkan: one 32-bit word each.
struct Constants {
    entries: Vec<vk::SpecializationMapEntry>,
    data: Vec<u8>,
}

impl Constants {
    fn new(constants: &[(u32, u32)]) -> Constants {
        let entries = (0u32..)
            .zip(constants)
            .map(|(at, &(id, _))| vk::SpecializationMapEntry { constant_id: id, offset: at * 4, size: 4 })
            .collect();
        let data = constants.iter().flat_map(|&(_, value)| value.to_ne_bytes()).collect();
        Constants { entries, data }
    }

    fn info(&self) -> vk::SpecializationInfo<'_> {
        vk::SpecializationInfo::default().map_entries(&self.entries).data(&self.data)
    }

    /// Refuses an id that is given twice.
    fn check(object: &str, constants: &[(u32, u32)]) -> Result<(), crate::GpuError> {
        let twice = constants.iter().enumerate().find(|(at, (id, _))| constants[..*at].iter().any(|(i, _)| i == id));
        match twice {
            Some((_, (id, _))) => {
                Err(crate::GpuError::misuse(object, format!("specialisation constant {id} is given twice")))
            }
            None => Ok(()),
        }
    }
}
