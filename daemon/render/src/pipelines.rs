//! The pipelines of a device, made once and shared by its projectors.

use std::sync::Arc;

use lantern_gpu::{ComputePipeline, DepthTest, Device, GpuError, GraphicsDesc, GraphicsPipeline, ImageFormat};

use crate::renderer::Settings;
use crate::shaders;

/// Specialisation constant of `secondary.comp`: reflect the projector's own ray.
const EYE_AT_PROJECTOR: u32 = 0;
/// Specialisation constant of every shader that traces.
const COUNT_RAYS: u32 = 1;

/// Formats of the composite's colour attachments: radiance with weight, and node.
pub(crate) const ATTACHMENTS: &[ImageFormat] = &[ImageFormat::Rgba32Float, ImageFormat::R32Float];

pub(crate) struct Pipelines {
    pub(crate) primary: Arc<ComputePipeline>,
    pub(crate) light: Arc<ComputePipeline>,
    pub(crate) secondary: Arc<ComputePipeline>,
    pub(crate) blend: Arc<ComputePipeline>,
    pub(crate) resolve: Arc<ComputePipeline>,
    pub(crate) room: Arc<ComputePipeline>,
    /// Writes everywhere.
    pub(crate) composite_first: Arc<GraphicsPipeline>,
    /// Writes where it is not behind what was rasterised before.
    pub(crate) composite_over: Arc<GraphicsPipeline>,
    pub(crate) raster: Arc<GraphicsPipeline>,
}

impl Pipelines {
    pub(crate) fn new(device: &Arc<Device>, settings: &Settings) -> Result<Self, GpuError> {
        let count = (COUNT_RAYS, u32::from(settings.count_rays));
        let eye_at_projector = (EYE_AT_PROJECTOR, u32::from(settings.eye_at_projector));
        let compute = |shader, constants: &[(u32, u32)]| ComputePipeline::new(device, shader, constants);
        let graphics = |name, vertex, fragment, depth_test, constants: &[(u32, u32)]| {
            GraphicsPipeline::new(
                device,
                &GraphicsDesc {
                    name,
                    vertex,
                    fragment,
                    constants,
                    colors: ATTACHMENTS,
                    depth: Some(ImageFormat::Depth32),
                    depth_test,
                },
            )
        };
        let composite = |name, test| graphics(name, &shaders::COMPOSITE_VERT, &shaders::COMPOSITE_FRAG, test, &[]);
        Ok(Self {
            primary: compute(&shaders::PRIMARY_COMP, &[count])?,
            light: compute(&shaders::LIGHT_COMP, &[count])?,
            secondary: compute(&shaders::SECONDARY_COMP, &[eye_at_projector, count])?,
            blend: compute(&shaders::BLEND_COMP, &[count])?,
            resolve: compute(&shaders::RESOLVE_COMP, &[])?,
            room: compute(&shaders::ROOM_COMP, &[])?,
            composite_first: composite("composite, first", DepthTest::Always)?,
            composite_over: composite("composite, over raster", DepthTest::LessOrEqual)?,
            raster: graphics("raster", &shaders::RASTER_VERT, &shaders::RASTER_FRAG, DepthTest::Less, &[])?,
        })
    }
}
