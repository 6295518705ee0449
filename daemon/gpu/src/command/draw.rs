//! Renderings: draws into colour and depth attachments.

use std::sync::Arc;

use ash::vk;

use super::{Recorder, Uses};
use crate::access::{Access, AccessSet};
use crate::binding::Bindings;
use crate::error::GpuError;
use crate::format::ImageFormat;
use crate::image::{Image, ImageUsage};
use crate::pipeline::GraphicsPipeline;

/// What an attachment holds when a rendering begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Load {
    /// What it held before.
    Keep,
    /// This in every pixel: four channels; depth takes the first, an integer format the nearest integers.
    Clear([f32; 4]),
}

impl Recorder {
    /// Renders into attachments of one size: `f` draws, with viewport and scissor over all of it.
    ///
    /// `uses` are the bindings of all draws inside. Barriers stand before the rendering alone, so no draw may read what
    /// another draw of the same rendering writes to storage.
    ///
    /// # Errors
    /// [`GpuError::Misuse`] for no attachment, for attachments that differ in size, appear twice or were not created
    /// as such, [`GpuError::Unwritten`] for one that is kept and was never written; and those of `f`.
    pub fn render(
        &mut self,
        name: &str,
        colors: &[(&Arc<Image>, Load)],
        depth: Option<(&Arc<Image>, Load)>,
        uses: &[&Arc<Bindings>],
        f: impl FnOnce(&mut Draws<'_>) -> Result<(), GpuError>,
    ) -> Result<(), GpuError> {
        self.check_outside()?;
        self.check_draws_and_computes()?;
        let extent = check_targets(name, self.device().limits().max_color_attachments, colors, depth)?;
        let mut all = Uses::default();
        let targets = colors.iter().map(|target| (target, Access::ColorTarget));
        for ((image, load), access) in targets.chain(depth.iter().map(|target| (target, Access::DepthTarget))) {
            // An image that is there twice, as target or in a binding, is caught by its layouts.
            if all.images.iter().any(|used| Arc::ptr_eq(&used.image, image)) {
                return Err(GpuError::misuse(image.name(), format!("twice a target of {name:?}")));
            }
            all.add_image(image, AccessSet::of(access), *load == Load::Keep)?;
        }
        for bindings in uses {
            all.add_bindings(bindings)?;
        }
        self.apply(&all)?;
        self.begin_rendering(name, extent, colors, depth);

        // Kept now, so that they are kept whatever becomes of `f`.
        for (image, _) in colors.iter().chain(depth.iter()) {
            self.keep(image);
        }
        for bindings in uses {
            self.keep(bindings);
        }
        self.in_rendering = true;
        let mut draws = Draws {
            recorder: self,
            uses,
            colors: colors.iter().map(|(image, _)| image.format()).collect(),
            depth: depth.map(|(image, _)| image.format()),
        };
        let result = f(&mut draws);
        self.in_rendering = false;

        let commands = self.recording.commands();
        // SAFETY: the rendering and its label were opened above in this command buffer: `draws` lent the recorder to
        // `f` without letting it be replaced.
        unsafe {
            self.raw().cmd_end_rendering(commands);
            self.device().handle().naming.end(commands);
        }
        result
    }

    /// Hands an image of a surface over to be shown, where `taken` and `drawn` are the semaphores by which it was taken and is
    /// given away. A recording draws one such image at most.
    pub(crate) fn hand_over(&mut self, image: &Arc<Image>, [taken, drawn]: [vk::Semaphore; 2]) -> Result<(), GpuError> {
        self.check_outside()?;
        let mut all = Uses::default();
        all.add_image(image, AccessSet::of(Access::Shown), true)?;
        self.apply(&all)?;
        self.keep(image);
        self.recording.surface = Some([taken, drawn]);
        Ok(())
    }

    fn begin_rendering(
        &self,
        name: &str,
        extent: vk::Extent2D,
        colors: &[(&Arc<Image>, Load)],
        depth: Option<(&Arc<Image>, Load)>,
    ) {
        let attachment = |(image, load): &(&Arc<Image>, Load), access: Access| {
            let info = vk::RenderingAttachmentInfo::default()
                .image_view(image.view)
                .image_layout(access.scope().layout)
                .store_op(vk::AttachmentStoreOp::STORE);
            match load {
                Load::Keep => info.load_op(vk::AttachmentLoadOp::LOAD),
                Load::Clear(value) => {
                    info.load_op(vk::AttachmentLoadOp::CLEAR).clear_value(clear_value(image.format(), *value))
                }
            }
        };
        let color_infos: Vec<_> = colors.iter().map(|target| attachment(target, Access::ColorTarget)).collect();
        let depth_info = depth.map(|target| attachment(&target, Access::DepthTarget));
        let area = vk::Rect2D { offset: vk::Offset2D::default(), extent };
        let mut info = vk::RenderingInfo::default().render_area(area).layer_count(1).color_attachments(&color_infos);
        if let Some(depth_info) = &depth_info {
            info = info.depth_attachment(depth_info);
        }
        let viewport = vk::Viewport {
            x: 0.0,
            y: 0.0,
            width: extent.width as f32,
            height: extent.height as f32,
            min_depth: 0.0,
            max_depth: 1.0,
        };
        let commands = self.recording.commands();
        // SAFETY: the command buffer is being recorded, outside of a rendering; the attachments are of this device,
        // of one size, created as attachments, and in these layouts by the barrier before.
        unsafe {
            self.device().handle().naming.begin(commands, name);
            self.raw().cmd_begin_rendering(commands, &info);
            self.raw().cmd_set_viewport(commands, 0, &[viewport]);
            self.raw().cmd_set_scissor(commands, 0, &[area]);
        }
    }
}

/// Draws inside a rendering.
pub struct Draws<'a> {
    recorder: &'a mut Recorder,
    uses: &'a [&'a Arc<Bindings>],
    colors: Vec<ImageFormat>,
    depth: Option<ImageFormat>,
}

impl std::fmt::Debug for Draws<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Draws({:?}, {:?})", self.colors, self.depth)
    }
}

impl Draws<'_> {
    /// Draws `vertices` vertices, three to a triangle, `instances` times.
    ///
    /// # Errors
    /// [`GpuError::Misuse`] for a pipeline made for other attachments, or bindings that the rendering was not told of;
    /// [`GpuError::Binding`] and [`GpuError::PushConstants`] as for [`Recorder::dispatch`].
    pub fn draw(
        &mut self,
        pipeline: &Arc<GraphicsPipeline>,
        bindings: &Arc<Bindings>,
        push: &[u8],
        vertices: u32,
        instances: u32,
    ) -> Result<(), GpuError> {
        if pipeline.colors != self.colors || pipeline.depth != self.depth {
            let problem = format!(
                "made for attachments {:?} and {:?}, and these are {:?} and {:?}",
                pipeline.colors, pipeline.depth, self.colors, self.depth
            );
            return Err(GpuError::misuse(pipeline.name(), problem));
        }
        if !self.uses.iter().any(|known| Arc::ptr_eq(known, bindings)) {
            return Err(GpuError::misuse(pipeline.name(), "drawn with bindings that the rendering was not told of"));
        }
        self.recorder.check_pipeline(&pipeline.layout, bindings, push)?;
        self.recorder.bind(vk::PipelineBindPoint::GRAPHICS, pipeline.raw, &pipeline.layout, bindings, push);
        // SAFETY: inside a rendering whose attachments have the pipeline's formats; pipeline, bindings and push
        // constants are bound for this layout, viewport and scissor are set, and there is no vertex input.
        unsafe { self.recorder.raw().cmd_draw(self.recorder.recording.commands(), vertices, instances, 0, 0) };
        self.recorder.recording.dispatches += 1;
        self.recorder.keep(pipeline);
        Ok(())
    }
}

/// Refuses attachments that cannot be rendered into together; else their common size.
fn check_targets(
    name: &str,
    max_colors: u32,
    colors: &[(&Arc<Image>, Load)],
    depth: Option<(&Arc<Image>, Load)>,
) -> Result<vk::Extent2D, GpuError> {
    for (image, _) in colors {
        image.require(ImageUsage::COLOR, "a colour attachment")?;
    }
    if let Some((image, _)) = depth {
        image.require(ImageUsage::DEPTH, "a depth attachment")?;
    }
    if colors.len() > max_colors as usize {
        return Err(GpuError::TooLarge {
            object: name.into(),
            asked: colors.len() as u64,
            limit: max_colors.into(),
            unit: "colour attachments",
        });
    }
    let mut targets = colors.iter().chain(depth.iter()).map(|(image, _)| *image);
    let first = targets.next().ok_or_else(|| GpuError::misuse(name, "a rendering without an attachment"))?;
    match targets.find(|image| image.extent() != first.extent()) {
        Some(other) => Err(GpuError::misuse(name, format!("attachments differ in size: {first:?}, {other:?}"))),
        None => Ok(first.extent()),
    }
}

fn clear_value(format: ImageFormat, value: [f32; 4]) -> vk::ClearValue {
    match format {
        ImageFormat::Depth32 => {
            // Window z lies in 0 to 1; what is no number clears to the far end.
            let depth = if value[0].is_nan() { 1.0 } else { value[0].clamp(0.0, 1.0) };
            vk::ClearValue { depth_stencil: vk::ClearDepthStencilValue { depth, stencil: 0 } }
        }
        ImageFormat::R32Uint => {
            vk::ClearValue { color: vk::ClearColorValue { uint32: value.map(|channel| channel.round() as u32) } }
        }
        _ => vk::ClearValue { color: vk::ClearColorValue { float32: value } },
    }
}
