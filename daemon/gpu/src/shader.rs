//! Shaders and their binding tables, as a build script writes them from the SPIR-V.

use std::sync::Arc;

use ash::vk;

use crate::error::GpuError;
use crate::handle::DeviceHandle;

/// A shader: its code, and what reflection found in it. This crate trusts the table to match the code.
#[derive(Debug)]
pub struct Shader {
    /// The name of its source.
    pub name: &'static str,
    /// Where in the pipeline it runs.
    pub stage: Stage,
    /// Its code; the entry point is `main`.
    pub spirv: &'static [u32],
    /// What it binds.
    pub bindings: &'static [Binding],
    /// Bytes of push constants that it declares, from offset 0; 0 for none.
    pub push_bytes: u32,
    /// Invocations of a workgroup, by axis; ones for a stage that has none.
    pub local_size: [u32; 3],
}

/// A stage of a pipeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Compute.
    Compute,
    /// Vertex.
    Vertex,
    /// Fragment.
    Fragment,
}

/// One resource that a shader binds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Binding {
    /// The descriptor set, always 0.
    pub set: u32,
    /// The number in the set.
    pub binding: u32,
    /// The name in the source, by which a resource is given.
    pub name: &'static str,
    /// What is bound.
    pub kind: BindingKind,
    /// Whether the shader reads it.
    pub reads: bool,
    /// Whether the shader writes it.
    pub writes: bool,
}

/// What kind of resource a shader binds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BindingKind {
    /// `uniform` block.
    UniformBuffer,
    /// `buffer` block.
    StorageBuffer,
    /// `textureBuffer`, `utextureBuffer`, `samplerBuffer` …
    UniformTexelBuffer,
    /// `image2D` and its like.
    StorageImage,
    /// `sampler2D` and its like, with a nearest-clamp sampler of this crate.
    SampledImage,
    /// `accelerationStructureEXT`, on a device that was opened with ray queries.
    AccelerationStructure,
}

impl BindingKind {
    pub(crate) fn raw(self) -> vk::DescriptorType {
        match self {
            BindingKind::UniformBuffer => vk::DescriptorType::UNIFORM_BUFFER,
            BindingKind::StorageBuffer => vk::DescriptorType::STORAGE_BUFFER,
            BindingKind::UniformTexelBuffer => vk::DescriptorType::UNIFORM_TEXEL_BUFFER,
            BindingKind::StorageImage => vk::DescriptorType::STORAGE_IMAGE,
            BindingKind::SampledImage => vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
            BindingKind::AccelerationStructure => vk::DescriptorType::ACCELERATION_STRUCTURE_KHR,
        }
    }
}

/// A shader's code on a device, while pipelines are made of it.
pub(crate) struct Module {
    pub(crate) raw: vk::ShaderModule,
    device: Arc<DeviceHandle>,
}

/// The first word of every SPIR-V module.
const SPIRV_MAGIC: u32 = 0x0723_0203;

impl Module {
    /// Takes the code to the device; refuses a shader of another stage than `stage`.
    pub(crate) fn new(device: &Arc<DeviceHandle>, shader: &Shader, stage: Stage) -> Result<Module, GpuError> {
        if shader.stage != stage {
            let problem = format!("a {:?} shader where a {stage:?} shader belongs", shader.stage);
            return Err(GpuError::misuse(shader.name, problem));
        }
        if shader.spirv.len() < 5 || shader.spirv[0] != SPIRV_MAGIC {
            return Err(GpuError::misuse(shader.name, "its code is not spir-v"));
        }
        let info = vk::ShaderModuleCreateInfo::default().code(shader.spirv);
        // SAFETY: the code has a SPIR-V header and is otherwise trusted, as the crate says: the build script compiled
        // it. The new object is named before anyone else has it.
        let raw = unsafe {
            let raw = device
                .raw
                .create_shader_module(&info, None)
                .map_err(|result| GpuError::vulkan(format!("loading shader {:?}", shader.name), result))?;
            device.naming.name(raw, shader.name);
            raw
        };
        Ok(Module { raw, device: Arc::clone(device) })
    }
}

impl Drop for Module {
    fn drop(&mut self) {
        // SAFETY: a module may go as soon as no pipeline is being made of it, and makers borrow it.
        unsafe { self.device.raw.destroy_shader_module(self.raw, None) };
    }
}
