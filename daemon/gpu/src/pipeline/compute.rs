//! Compute pipelines.

use std::sync::Arc;

use ash::vk;

use super::Constants;
use crate::device::Device;
use crate::error::GpuError;
use crate::layout::{Layout, sealed};
use crate::naming::ENTRY_POINT;
use crate::shader::{Module, Shader, Stage};

/// A compute shader with its constants, ready to be dispatched.
pub struct ComputePipeline {
    pub(crate) raw: vk::Pipeline,
    pub(crate) layout: Arc<Layout>,
}

impl std::fmt::Debug for ComputePipeline {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "ComputePipeline({:?})", self.layout.name)
    }
}

impl sealed::Sealed for ComputePipeline {
    fn layout(&self) -> &Arc<Layout> {
        &self.layout
    }
}

impl ComputePipeline {
    /// Makes a pipeline of `shader` with specialisation `constants`: (id, 32-bit value).
    ///
    /// # Errors
    /// [`GpuError::Misuse`] for another stage or a constant given twice, [`GpuError::TooLarge`] for a workgroup,
    /// push constants or bindings beyond the device, [`GpuError::Binding`] for a table that contradicts itself.
    pub fn new(
        device: &Arc<Device>,
        shader: &'static Shader,
        constants: &[(u32, u32)],
    ) -> Result<Arc<ComputePipeline>, GpuError> {
        let handle = device.handle();
        check_group(shader, handle)?;
        Constants::check(shader.name, constants)?;
        let module = Module::new(handle, shader, Stage::Compute)?;
        let layout = Layout::new(handle, shader.name, &[shader])?;

        let constants = Constants::new(constants);
        let specialization = constants.info();
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module.raw)
            .name(ENTRY_POINT)
            .specialization_info(&specialization);
        let info = vk::ComputePipelineCreateInfo::default().stage(stage).layout(layout.raw);
        // SAFETY: module, layout and cache live; the layout is derived from the shader's table, which is trusted to
        // match its code. The new object is named before anyone else has it.
        let raw = unsafe {
            let made = handle.raw.create_compute_pipelines(device.cache().raw(), &[info], None);
            let raw = first(made).map_err(|result| GpuError::vulkan(format!("compiling {:?}", shader.name), result))?;
            handle.naming.name(raw, shader.name);
            raw
        };
        Ok(Arc::new(ComputePipeline { raw, layout }))
    }

    /// The name of its shader.
    pub fn name(&self) -> &str {
        &self.layout.name
    }
}

impl Drop for ComputePipeline {
    fn drop(&mut self) {
        // SAFETY: whatever uses the pipeline on the device holds it by Arc until it has completed.
        unsafe { self.layout.device.raw.destroy_pipeline(self.raw, None) };
    }
}

/// The one pipeline of a call that makes one. A failed call leaves null handles, of which nothing is to be freed.
pub(super) fn first(
    made: Result<Vec<vk::Pipeline>, (Vec<vk::Pipeline>, vk::Result)>,
) -> Result<vk::Pipeline, vk::Result> {
    match made {
        Ok(pipelines) => pipelines.first().copied().ok_or(vk::Result::ERROR_UNKNOWN),
        Err((_, result)) => Err(result),
    }
}

fn check_group(shader: &Shader, device: &crate::handle::DeviceHandle) -> Result<(), GpuError> {
    let limits = &device.limits;
    let invocations = shader.local_size.iter().fold(1u64, |all, &n| all.saturating_mul(n.into()));
    let by_axis = shader.local_size.into_iter().zip(limits.max_group_size).map(|(n, max)| (u64::from(n), max));
    let mut rows = by_axis.chain([(invocations, limits.max_group_invocations)]);
    match rows.find(|&(asked, limit)| asked > u64::from(limit)) {
        Some((asked, limit)) => Err(GpuError::TooLarge {
            object: shader.name.into(),
            asked,
            limit: limit.into(),
            unit: "invocations of a workgroup",
        }),
        None => Ok(()),
    }
}
