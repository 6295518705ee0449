//! The pipelines of a device, made once and shared by its projectors.

use std::sync::Arc;

use lantern_calibration::{Calibration, Optics};
use lantern_gpu::{ComputePipeline, DepthTest, Device, GpuError, GraphicsDesc, GraphicsPipeline, ImageFormat};
use lantern_scene::{Role, Scene};

use crate::loads::Loads;
use crate::settings::Settings;
use crate::shaders;

/// Specialisation constant of `secondary.comp`: reflect the projector's own ray.
const EYE_AT_PROJECTOR: u32 = 0;
/// Specialisation constant of every shader that traces.
const COUNT_RAYS: u32 = 1;
/// The same: write rays down.
const RECORD_RAYS: u32 = 8;

/// Specialisation constant of every shader that looks at surfaces: any texture.
const TEXTURED: u32 = 2;
/// Specialisation constant of every shader that traces shadows: any material that lets light through.
const TRANSMISSIVE: u32 = 3;

/// Specialisation constants of every shader that sends rays from projectors, or looks where they lead: whether the projector whose
/// picture is made has a lens, and whether any has.
const OWN_LENS: u32 = 9;
const ANY_LENS: u32 = 10;
/// Specialisation constant of `resolve.comp`: alpha and beta maps.
const MAPPED: u32 = 11;

/// Specialisation constant of `secondary.comp`: one sample of a pixel is shaded for all.
const ONE_FOR_ALL: u32 = 5;
/// Specialisation constants of `secondary.comp`: how a sample's rays may branch.
const COATED: u32 = 6;
const VIRTUAL: u32 = 7;
const LIGHTS: u32 = 12;
/// Specialisation constant of `primary.comp`: samples of a pixel that one invocation traces.
const SAMPLES_TOGETHER: u32 = 4;

/// What the pipelines are made for: what of a scene and of a projector, and how the scene is read. Branches are no way around work on a
/// driver that runs both sides under a mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Features {
    textured: bool,
    transmissive: bool,
    pub(crate) loads: Loads,
    own_lens: bool,
    any_lens: bool,
    mapped: bool,
    trees: Trees,
}

/// What of a scene decides how the rays of a sample branch. `secondary.comp` alone is made for it, so that a scene's first coat, virtual
/// thing, first or second light has no other shader made anew.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Trees {
    coated: bool,
    any_virtual: bool,
    /// None, one, or more.
    lights: u32,
}

impl Trees {
    fn of(scene: &Scene) -> Self {
        Self {
            coated: scene.gpu_materials.iter().any(|m| m.clearcoat > 0.0),
            any_virtual: has_virtual(scene),
            lights: scene.lights.len().min(2) as u32,
        }
    }
}

/// Whether anything virtual is shown.
pub(crate) fn has_virtual(scene: &Scene) -> bool {
    scene.instances.iter().any(|instance| instance.visible && instance.role == Role::Virtual)
}

impl Features {
    pub(crate) fn of(scene: &Scene, loads: Loads) -> Self {
        Self {
            loads,
            textured: !scene.textures.headers.is_empty(),
            transmissive: scene.gpu_materials.iter().any(|m| m.transmission > 0.0),
            own_lens: false,
            any_lens: false,
            mapped: false,
            trees: Trees::of(scene),
        }
    }

    /// Whether the other's shaders differ in no more than how a sample's rays branch.
    pub(crate) fn differ_in_trees_alone(&self, other: &Self) -> bool {
        *self == Self { trees: self.trees, ..*other }
    }

    /// The same for a picture of such a projector, or of none, beside others of which any has a lens.
    pub(crate) fn of_projector(self, projector: Option<&Calibration>, any_lens: bool) -> Self {
        Self {
            own_lens: projector.is_some_and(|of| *of.optics() != Optics::Pinhole),
            any_lens,
            mapped: projector.is_some_and(|of| !of.maps().is_empty()),
            ..self
        }
    }
}

/// Formats of the composite's colour attachments: radiance with weight, and node.
pub(crate) const ATTACHMENTS: &[ImageFormat] = &[ImageFormat::Rgba32Float, ImageFormat::R32Float];

/// Formats of the ideal image behind a lens: instance and triangle.
pub(crate) const SEEN: &[ImageFormat] = &[ImageFormat::R32Uint, ImageFormat::R32Uint];

#[derive(Clone)]
pub(crate) struct Pipelines {
    pub(crate) tiles: Arc<ComputePipeline>,
    /// Sample planes that one dispatch of `primary` writes: 1 or 4.
    pub(crate) samples_together: u32,
    primary: Arc<ComputePipeline>,
    /// One plane, four pixels as a beam.
    primary_quads: Arc<ComputePipeline>,
    pub(crate) light: Arc<ComputePipeline>,
    pub(crate) lists: Arc<ComputePipeline>,
    /// One sample for all of a pixel's.
    pub(crate) secondary_once: Arc<ComputePipeline>,
    pub(crate) refine: Arc<ComputePipeline>,
    /// Every sample of a pixel.
    pub(crate) secondary_each: Arc<ComputePipeline>,
    pub(crate) edges: Arc<ComputePipeline>,
    pub(crate) blend: Arc<ComputePipeline>,
    pub(crate) resolve: Arc<ComputePipeline>,
    pub(crate) room: Arc<ComputePipeline>,
    /// Writes everywhere.
    pub(crate) composite_first: Arc<GraphicsPipeline>,
    /// Writes where it is not behind what was rasterised before.
    pub(crate) composite_over: Arc<GraphicsPipeline>,
    pub(crate) raster: Arc<GraphicsPipeline>,
    /// Raster nodes onto the ideal image behind a lens.
    pub(crate) visible: Arc<GraphicsPipeline>,
    /// What the rays meet of it.
    pub(crate) warped: Arc<GraphicsPipeline>,
}

impl Pipelines {
    pub(crate) fn new(device: &Arc<Device>, settings: &Settings, features: Features) -> Result<Self, GpuError> {
        let count = (COUNT_RAYS, u32::from(settings.count_rays));
        let record = (RECORD_RAYS, u32::from(settings.record_rays));
        let textured = (TEXTURED, u32::from(features.textured));
        let transmissive = (TRANSMISSIVE, u32::from(features.transmissive));
        let own_lens = (OWN_LENS, u32::from(features.own_lens));
        let any_lens = (ANY_LENS, u32::from(features.any_lens));
        let compute = |shader, constants: &[(u32, u32)]| {
            ComputePipeline::new(device, features.loads.shader(shader, device.has_ray_queries()), constants)
        };
        let graphics = |name, vertex, fragment, colors, depth_test, constants: &[(u32, u32)]| {
            GraphicsPipeline::new(
                device,
                &GraphicsDesc {
                    name,
                    vertex: features.loads.shader(vertex, false),
                    fragment: features.loads.shader(fragment, false),
                    constants,
                    colors,
                    depth: Some(ImageFormat::Depth32),
                    depth_test,
                },
            )
        };
        let composite = |name, test| {
            graphics(name, &shaders::COMPOSITE_VERT, &shaders::COMPOSITE_FRAG, ATTACHMENTS, test, &[own_lens])
        };
        let raster = |name, vertex, fragment| {
            graphics(name, vertex, fragment, ATTACHMENTS, DepthTest::Less, &[textured, own_lens, any_lens])
        };
        let samples_together = samples_together(device, settings.walk.beams);
        let [secondary_once, secondary_each] = secondary(device, settings, features)?;
        Ok(Self {
            tiles: compute(&shaders::TILES_COMP, &[own_lens])?,
            samples_together,
            primary: compute(&shaders::PRIMARY_COMP, &[count, record, own_lens, (SAMPLES_TOGETHER, samples_together)])?,
            primary_quads: compute(&shaders::PRIMARY_QUADS_COMP, &[count, record, own_lens])?,
            light: compute(&shaders::LIGHT_COMP, &[count, record, textured, transmissive, own_lens])?,
            lists: compute(&shaders::LISTS_COMP, &[])?,
            secondary_once,
            refine: compute(&shaders::REFINE_COMP, &[])?,
            secondary_each,
            edges: compute(&shaders::EDGES_COMP, &[])?,
            blend: compute(&shaders::BLEND_COMP, &[count, record, textured, own_lens, any_lens])?,
            resolve: compute(&shaders::RESOLVE_COMP, &[(MAPPED, u32::from(features.mapped))])?,
            room: compute(&shaders::ROOM_COMP, &[textured, own_lens, any_lens])?,
            composite_first: composite("composite, first", DepthTest::Always)?,
            composite_over: composite("composite, over raster", DepthTest::LessOrEqual)?,
            raster: raster("raster", &shaders::RASTER_VERT, &shaders::RASTER_FRAG)?,
            visible: graphics("visible", &shaders::VISIBLE_VERT, &shaders::VISIBLE_FRAG, SEEN, DepthTest::Less, &[])?,
            warped: raster("warped", &shaders::COMPOSITE_VERT, &shaders::WARPED_FRAG)?,
        })
    }

    /// What traces primary rays: where beams are wanted and there is one sample plane at a time, those of neighbouring pixels.
    pub(crate) fn primary(&self, planes_a_group: u32) -> &Arc<ComputePipeline> {
        if self.samples_together > 1 && planes_a_group == 1 { &self.primary_quads } else { &self.primary }
    }

    /// The same for a scene that differs in how rays branch.
    pub(crate) fn with_trees(
        &self,
        device: &Arc<Device>,
        settings: &Settings,
        features: Features,
    ) -> Result<Self, GpuError> {
        let [secondary_once, secondary_each] = secondary(device, settings, features)?;
        Ok(Self { secondary_once, secondary_each, ..self.clone() })
    }
}

/// The pass that follows the eye: one sample for all of a pixel's, and every sample.
fn secondary(
    device: &Arc<Device>,
    settings: &Settings,
    features: Features,
) -> Result<[Arc<ComputePipeline>; 2], GpuError> {
    let shader = features.loads.shader(&shaders::SECONDARY_COMP, device.has_ray_queries());
    let make = |one_for_all| {
        let switches = [
            (EYE_AT_PROJECTOR, settings.eye_at_projector),
            (COUNT_RAYS, settings.count_rays),
            (RECORD_RAYS, settings.record_rays),
            (TEXTURED, features.textured),
            (TRANSMISSIVE, features.transmissive),
            (OWN_LENS, features.own_lens),
            (COATED, features.trees.coated),
            (VIRTUAL, features.trees.any_virtual),
            (ONE_FOR_ALL, one_for_all),
        ];
        let mut constants: Vec<_> = switches.map(|(id, on)| (id, u32::from(on))).into();
        constants.push((LIGHTS, features.trees.lights));
        ComputePipeline::new(device, shader, &constants)
    };
    Ok([make(true)?, make(false)?])
}

/// Four where a core does an invocation's work: it then does most of it once for all four. One where thousands of invocations must be
/// in flight, whose registers four rays would take, or where the device walks its own structures.
fn samples_together(device: &Device, beams: Option<bool>) -> u32 {
    if beams.unwrap_or(device.info().kind == "cpu" && !device.has_ray_queries()) { 4 } else { 1 }
}
