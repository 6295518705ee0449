//! A projector's picture into an image of its output.
//!
//! Reads `Color`, or `Shown`; writes the image. It reads nothing that the host writes for each frame, so that the next one can begin
//! while this one waits for its screen.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use lantern_gpu::{
    Bindings, DepthTest, Device, GpuError, GraphicsDesc, GraphicsPipeline, Image, ImageFormat, Load, Pixels, Recorder,
};

use crate::catalogue::Catalogue;
use crate::shaders;
use crate::targets::Targets;

/// Specialisation constant of `present.frag`: alpha and beta maps; the same as of `resolve.comp`.
const MAPPED: u32 = 11;
/// Specialisation constant of `present.frag`: one of its `PIXELS_` constants.
const PIXELS: u32 = 12;

/// Twin of `Push` in `present.frag`; 12 bytes.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Push {
    /// cd/m².
    white_nits: f32,
    columns: u32,
    /// Not 0: the picture is a test pattern.
    is_pattern: u32,
}

/// An image to draw into, and how its numbers are read.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// A colour attachment.
    pub image: &'a Arc<Image>,
    /// What its numbers stand for.
    pub pixels: Pixels,
    /// For HDR: how bright white is, cd/m².
    pub white_nits: f32,
}

impl Target<'_> {
    /// Makes it black.
    ///
    /// # Errors
    /// What Vulkan says.
    pub fn record_black(&self, recorder: &mut Recorder) -> Result<(), GpuError> {
        recorder.render("black", &[(self.image, Load::Clear([0.0, 0.0, 0.0, 1.0]))], None, &[], |_| Ok(()))
    }
}

/// The pass of one projector, for images of one format.
pub(crate) struct Present {
    format: ImageFormat,
    pixels: Pixels,
    pipeline: Arc<GraphicsPipeline>,
    bindings: Arc<Bindings>,
}

impl Present {
    pub(crate) fn new(
        device: &Arc<Device>,
        targets: &Targets,
        mapped: bool,
        target: &Target<'_>,
    ) -> Result<Present, GpuError> {
        let pixels = match target.pixels {
            Pixels::Bits8 => 0,
            Pixels::Bits10 => 1,
            Pixels::Hdr10 => 2,
        };
        let format = target.image.format();
        let pipeline = GraphicsPipeline::new(
            device,
            &GraphicsDesc {
                name: "present",
                vertex: &shaders::COMPOSITE_VERT,
                fragment: &shaders::PRESENT_FRAG,
                constants: &[(MAPPED, u32::from(mapped)), (PIXELS, pixels)],
                colors: &[format],
                depth: None,
                depth_test: DepthTest::Always,
            },
        )?;
        let bindings = targets.list(Catalogue::default()).bind(&*pipeline)?;
        Ok(Present { format, pixels: target.pixels, pipeline, bindings })
    }

    /// Whether it was made for such an image.
    pub(crate) fn serves(&self, target: &Target<'_>) -> bool {
        self.format == target.image.format() && self.pixels == target.pixels
    }

    pub(crate) fn record(
        &self,
        recorder: &mut Recorder,
        targets: &Targets,
        is_pattern: bool,
        target: &Target<'_>,
    ) -> Result<(), GpuError> {
        let push = Push { white_nits: target.white_nits, columns: targets.size_px[0], is_pattern: is_pattern.into() };
        let black = Load::Clear([0.0, 0.0, 0.0, 1.0]);
        recorder.span("present", |recorder| {
            recorder.render("present", &[(target.image, black)], None, &[&self.bindings], |draws| {
                draws.draw(&self.pipeline, &self.bindings, bytemuck::bytes_of(&push), 3, 1)
            })
        })
    }
}
