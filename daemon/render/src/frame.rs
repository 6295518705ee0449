//! The blocks that the shaders of one frame of one projector read.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use lantern_calibration::GpuFrustum;
use lantern_gpu::{Buffer, BufferKind, Device, GpuError};
use lantern_scene::Scene;

use crate::catalogue::Catalogue;
use crate::settings::Settings;

/// Viewers that the shaders take into account.
pub const MAX_VIEWERS: usize = 4;

/// Twin of `Frame` in `shaders-glsl/include/frame.glsl`; std140, 384 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct GpuFrame {
    /// The projector's frustum, relative to the scene's origin.
    pub frustum: GpuFrustum,
    /// Spherical harmonics of what a white diffuse surface shows.
    pub irradiance: [[f32; 4]; 9],
    /// Eyes, m, relative to the scene's origin.
    pub viewers: [[f32; 4]; MAX_VIEWERS],
}

impl GpuFrame {
    /// The block of one projector.
    pub fn new(frustum: GpuFrustum, scene: &Scene, viewers: &[DVec3]) -> Self {
        let relative = |p: &DVec3| (*p - scene.origin_m).as_vec3().extend(1.0).to_array();
        let mut eyes = [[0.0; 4]; MAX_VIEWERS];
        for (eye, viewer) in eyes.iter_mut().zip(viewers) {
            *eye = relative(viewer);
        }
        Self { frustum: standard_depth(frustum), irradiance: scene.environment.irradiance, viewers: eyes }
    }
}

/// Counts and switches: twin of `Setup` in `shaders-glsl/include/frame.glsl`; std430, 64 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct GpuSetup {
    /// Columns and rows of the environment's level 0.
    pub environment_px: [u32; 2],
    /// Rows of `viewers` in use.
    pub viewer_count: u32,
    /// Lights in use.
    pub light_count: u32,
    /// Samples a pixel, n².
    pub samples: u32,
    /// n.
    pub strata: u32,
    /// Secondary rays deep.
    pub max_depth: u32,
    /// Nodes of the top level; 0 = nothing can be hit.
    pub tlas_node_count: u32,
    /// Visible instances of role virtual.
    pub virtual_count: u32,
    /// Projectors that share the light.
    pub projector_count: u32,
    /// This projector among them.
    pub projector_index: u32,
    /// 0: every weight is 1.
    pub blend: u32,
    /// Sample planes that a buffer of hits holds.
    pub planes_a_group: u32,
    /// 0: every sample of every pixel is shaded.
    pub shade_once: u32,
    /// What is shown instead of the scene: a [`Pattern`](crate::Pattern).
    pub pattern: u32,
    /// First texel of the environment's level 0.
    pub environment_first: u32,
}

impl GpuSetup {
    /// The block of projector `projector.0` of `projector.1`.
    pub fn new(scene: &Scene, viewers: &[DVec3], settings: &Settings, projector: (usize, usize)) -> Self {
        let is_virtual = |i: &&lantern_scene::Instance| i.visible && i.role == lantern_scene::Role::Virtual;
        Self {
            environment_px: [scene.environment.width, scene.environment.height],
            viewer_count: viewers.len().min(MAX_VIEWERS) as u32,
            light_count: scene.lights.len() as u32,
            samples: settings.samples,
            strata: settings.samples.isqrt(),
            max_depth: settings.max_depth,
            tlas_node_count: (scene.top.nodes.len() / 5) as u32,
            virtual_count: scene.instances.iter().filter(is_virtual).count() as u32,
            projector_count: projector.1 as u32,
            projector_index: projector.0 as u32,
            blend: u32::from(settings.blend),
            planes_a_group: 1,
            shade_once: u32::from(settings.shades_once()),
            pattern: 0,
            environment_first: 0,
        }
    }
}

/// Both blocks on the device; the host writes them right before the submission.
pub(crate) struct FrameBlocks {
    frame: Arc<Buffer>,
    setup: Arc<Buffer>,
}

impl FrameBlocks {
    pub(crate) fn new(device: &Arc<Device>, name: &str) -> Result<Self, GpuError> {
        let frame = Buffer::new(device, &format!("{name}/frame"), BufferKind::Uniform, size_of::<GpuFrame>() as u64)?;
        let setup =
            Buffer::new(device, &format!("{name}/setup"), BufferKind::HostStorage, size_of::<GpuSetup>() as u64)?;
        Ok(Self { frame, setup })
    }

    pub(crate) fn write(&self, frame: &GpuFrame, setup: &GpuSetup) -> Result<(), GpuError> {
        self.frame.write(0, bytemuck::bytes_of(frame))?;
        self.setup.write(0, bytemuck::bytes_of(setup))
    }

    pub(crate) fn list(&self, catalogue: Catalogue) -> Catalogue {
        catalogue.with_buffer("Frame", &self.frame).with_buffer("Setup", &self.setup)
    }

    /// Bytes of both on the device.
    pub(crate) fn bytes(&self) -> u64 {
        self.frame.bytes() + self.setup.bytes()
    }
}

/// The attachments keep depth that grows with distance, whatever the projector's convention: one depth test and one clear value
/// serve all. Reading the layer turns it back.
fn standard_depth(frustum: GpuFrustum) -> GpuFrustum {
    if frustum.z_base == 0.0 {
        GpuFrustum { z_base: 1.0, depth_row: frustum.depth_row.map(|x| -x), ..frustum }
    } else {
        frustum
    }
}
