//! Graphics pipelines: triangle lists whose vertices the shader pulls, without culling or blending.

use std::sync::Arc;

use ash::vk;

use super::Constants;
use super::compute::first;
use crate::device::Device;
use crate::error::GpuError;
use crate::format::ImageFormat;
use crate::handle::DeviceHandle;
use crate::layout::{Layout, sealed};
use crate::naming::ENTRY_POINT;
use crate::shader::{Module, Shader, Stage};

/// When a fragment passes the depth test; one that passes writes its depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DepthTest {
    /// Always.
    Always,
    /// Where it is nearer, in window z, than what is there.
    Less,
    /// Where it is nearer or equal.
    LessOrEqual,
}

/// What a graphics pipeline is made of. Viewport and scissor are the whole target.
#[derive(Debug, Clone, Copy)]
pub struct GraphicsDesc<'a> {
    /// Its name.
    pub name: &'a str,
    /// The vertex shader; there is no vertex input, it pulls from buffers.
    pub vertex: &'static Shader,
    /// The fragment shader.
    pub fragment: &'static Shader,
    /// Specialisation constants of both: (id, 32-bit value).
    pub constants: &'a [(u32, u32)],
    /// The formats of its colour attachments.
    pub colors: &'a [ImageFormat],
    /// The format of its depth attachment, if it has one.
    pub depth: Option<ImageFormat>,
    /// The depth test; without a depth attachment it has no effect.
    pub depth_test: DepthTest,
}

/// A vertex and a fragment shader with all state, ready to draw.
pub struct GraphicsPipeline {
    pub(crate) raw: vk::Pipeline,
    pub(crate) layout: Arc<Layout>,
    pub(crate) colors: Vec<ImageFormat>,
    pub(crate) depth: Option<ImageFormat>,
}

impl std::fmt::Debug for GraphicsPipeline {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "GraphicsPipeline({:?})", self.layout.name)
    }
}

impl sealed::Sealed for GraphicsPipeline {
    fn layout(&self) -> &Arc<Layout> {
        &self.layout
    }
}

impl GraphicsPipeline {
    /// Makes a pipeline, for dynamic rendering.
    ///
    /// # Errors
    /// As [`ComputePipeline::new`](crate::ComputePipeline::new), and [`GpuError::Misuse`] for formats that are no
    /// attachment's, [`GpuError::Unsupported`] for a shader that writes storage where the device cannot.
    pub fn new(device: &Arc<Device>, desc: &GraphicsDesc<'_>) -> Result<Arc<GraphicsPipeline>, GpuError> {
        let handle = device.handle();
        check(desc, handle)?;
        let vertex = Module::new(handle, desc.vertex, Stage::Vertex)?;
        let fragment = Module::new(handle, desc.fragment, Stage::Fragment)?;
        let layout = Layout::new(handle, desc.name, &[desc.vertex, desc.fragment])?;
        let constants = Constants::new(desc.constants);
        let raw = create_raw(device, desc, [&vertex, &fragment], &layout, &constants)?;
        Ok(Arc::new(GraphicsPipeline { raw, layout, colors: desc.colors.to_vec(), depth: desc.depth }))
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.layout.name
    }
}

impl Drop for GraphicsPipeline {
    fn drop(&mut self) {
        // SAFETY: whatever uses the pipeline on the device holds it by Arc until it has completed.
        unsafe { self.layout.device.raw.destroy_pipeline(self.raw, None) };
    }
}

fn check(desc: &GraphicsDesc<'_>, device: &DeviceHandle) -> Result<(), GpuError> {
    Constants::check(desc.name, desc.constants)?;
    let depth_fits = desc.depth.is_none_or(|format| format == ImageFormat::Depth32);
    if !depth_fits || desc.colors.contains(&ImageFormat::Depth32) {
        return Err(GpuError::misuse(desc.name, "a depth format among the colours, or a colour format as depth"));
    }
    if desc.colors.len() > device.limits.max_color_attachments as usize {
        return Err(GpuError::TooLarge {
            object: desc.name.into(),
            asked: desc.colors.len() as u64,
            limit: device.limits.max_color_attachments.into(),
            unit: "colour attachments",
        });
    }
    for (shader, able) in [
        (desc.vertex, device.features.core.vertex_pipeline_stores_and_atomics),
        (desc.fragment, device.features.core.fragment_stores_and_atomics),
    ] {
        if able == vk::FALSE && shader.bindings.iter().any(|binding| binding.writes) {
            return Err(GpuError::Unsupported {
                device: format!("device {:?}", device.info.name),
                missing: format!("storage written by {:?} shaders, which {:?} needs", shader.stage, shader.name),
            });
        }
    }
    Ok(())
}

fn create_raw(
    device: &Device,
    desc: &GraphicsDesc<'_>,
    [vertex, fragment]: [&Module; 2],
    layout: &Layout,
    constants: &Constants,
) -> Result<vk::Pipeline, GpuError> {
    let specialization = constants.info();
    let stage = |stage, module: &Module| {
        vk::PipelineShaderStageCreateInfo::default()
            .stage(stage)
            .module(module.raw)
            .name(ENTRY_POINT)
            .specialization_info(&specialization)
    };
    let stages = [stage(vk::ShaderStageFlags::VERTEX, vertex), stage(vk::ShaderStageFlags::FRAGMENT, fragment)];

    // Fixed for all pipelines: pulled vertices, lone triangles seen from both sides, one sample, no blending.
    let vertex_input = vk::PipelineVertexInputStateCreateInfo::default();
    let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(vk::PrimitiveTopology::TRIANGLE_LIST);
    let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
    let raster = vk::PipelineRasterizationStateCreateInfo::default()
        .polygon_mode(vk::PolygonMode::FILL)
        .cull_mode(vk::CullModeFlags::NONE)
        .front_face(vk::FrontFace::COUNTER_CLOCKWISE)
        .line_width(1.0);
    let samples = vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(vk::SampleCountFlags::TYPE_1);
    let dynamic_states = [vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR];
    let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic_states);
    let written = vk::PipelineColorBlendAttachmentState::default().color_write_mask(vk::ColorComponentFlags::RGBA);
    let attachments = vec![written; desc.colors.len()];
    let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&attachments);

    let depth = vk::PipelineDepthStencilStateCreateInfo::default()
        .depth_test_enable(desc.depth.is_some())
        .depth_write_enable(desc.depth.is_some())
        .depth_compare_op(match desc.depth_test {
            DepthTest::Always => vk::CompareOp::ALWAYS,
            DepthTest::Less => vk::CompareOp::LESS,
            DepthTest::LessOrEqual => vk::CompareOp::LESS_OR_EQUAL,
        });
    let color_formats: Vec<vk::Format> = desc.colors.iter().map(|format| format.raw()).collect();
    let mut rendering = vk::PipelineRenderingCreateInfo::default()
        .color_attachment_formats(&color_formats)
        .depth_attachment_format(desc.depth.map_or(vk::Format::UNDEFINED, ImageFormat::raw));

    let info = vk::GraphicsPipelineCreateInfo::default()
        .stages(&stages)
        .vertex_input_state(&vertex_input)
        .input_assembly_state(&assembly)
        .viewport_state(&viewport)
        .rasterization_state(&raster)
        .multisample_state(&samples)
        .depth_stencil_state(&depth)
        .color_blend_state(&blend)
        .dynamic_state(&dynamic)
        .layout(layout.raw)
        .push_next(&mut rendering);
    let handle = device.handle();
    // SAFETY: modules, layout and cache live; the layout is derived from the shaders' tables, which are trusted to
    // match their code; all that `info` points to lives until the call returns. The new object is named before anyone
    // else has it.
    unsafe {
        let made = handle.raw.create_graphics_pipelines(device.cache().raw(), &[info], None);
        let raw = first(made).map_err(|result| GpuError::vulkan(format!("compiling {:?}", desc.name), result))?;
        handle.naming.name(raw, desc.name);
        Ok(raw)
    }
}
