//! The buffers and images of one projector.

use std::sync::Arc;

use lantern_gpu::{Buffer, BufferKind, Device, GpuError, Image, ImageFormat, ImageUsage};

use crate::catalogue::Catalogue;
use crate::frame::GpuFrame;
use crate::record;
use crate::settings::Settings;

/// What a projector's passes write, a row of the image after the other. Bytes a pixel: 12 for each sample plane, and 108.
pub(crate) struct Targets {
    /// Columns and rows.
    pub(crate) size_px: [u32; 2],
    /// The block that shaders read; host-visible, written right before the submission.
    pub(crate) frame: Arc<Buffer>,
    /// One word a stratum, from which jitter is generated.
    pub(crate) sample_state: Arc<Buffer>,
    /// One plane a sample: instance and triangle, 8 bytes a pixel.
    pub(crate) hits: Vec<Arc<Buffer>>,
    /// One list a sample: the pixels of the plane whose look depends on the eye; 16 bytes and 4 a pixel.
    pub(crate) live: Vec<Arc<Buffer>>,
    /// Distance, sample, instance and triangle of the closest sample.
    pub(crate) closest: Arc<Buffer>,
    /// Eye-independent light.
    pub(crate) light: Arc<Buffer>,
    /// What the eye adds.
    pub(crate) look: Arc<Buffer>,
    /// Distance to the nearest occlusion edge, px.
    pub(crate) edge: Arc<Buffer>,
    /// Reciprocal of the blend weight.
    pub(crate) weight: Arc<Buffer>,
    /// Attachments of the composite and raster passes.
    pub(crate) radiance_image: Arc<Image>,
    pub(crate) node_image: Arc<Image>,
    pub(crate) depth_image: Arc<Image>,
    /// What is shown: linear radiance and weight; window z and node; 8-bit sRGB.
    pub(crate) shown: Arc<Buffer>,
    pub(crate) depth_and_node: Arc<Buffer>,
    pub(crate) color: Arc<Buffer>,
    /// Rays by kind.
    pub(crate) counters: Arc<Buffer>,
    /// Rays themselves, where they are recorded.
    pub(crate) records: Arc<Buffer>,
}

/// Bytes of `Live` before its list: workgroups of the indirect dispatch, and how long the list is.
const LIVE_HEAD: u64 = 16;

/// What an empty list begins with.
pub(crate) const LIVE_EMPTY: [u32; 4] = [0, 1, 1, 0];

/// Words of `Counters` in `shaders-glsl/include/counters.glsl`.
pub(crate) const COUNTER_WORDS: u64 = 5;

impl Targets {
    pub(crate) fn new(
        device: &Arc<Device>,
        name: &str,
        size_px: [u32; 2],
        settings: &Settings,
    ) -> Result<Self, GpuError> {
        let samples = settings.samples;
        let pixels = u64::from(size_px[0]) * u64::from(size_px[1]);
        let storage =
            |what: &str, bytes: u64| Buffer::new(device, &format!("{name}/{what}"), BufferKind::Storage, bytes);
        let image = |what: &str, format, usage| {
            Image::new(device, &format!("{name}/{what}"), size_px[0], size_px[1], format, usage)
        };
        let color_usage = ImageUsage::COLOR | ImageUsage::SAMPLED;
        Ok(Self {
            size_px,
            frame: Buffer::new(device, &format!("{name}/frame"), BufferKind::Uniform, size_of::<GpuFrame>() as u64)?,
            sample_state: storage("sample state", u64::from(samples) * 4)?,
            hits: (0..samples).map(|s| storage(&format!("hits {s}"), pixels * 8)).collect::<Result<_, _>>()?,
            live: (0..samples)
                .map(|s| storage(&format!("live {s}"), LIVE_HEAD + pixels * 4))
                .collect::<Result<_, _>>()?,
            closest: storage("closest", pixels * 16)?,
            light: storage("light", pixels * 16)?,
            look: storage("look", pixels * 16)?,
            edge: storage("edge", pixels * 4)?,
            weight: storage("weight", pixels * 4)?,
            radiance_image: image("radiance", ImageFormat::Rgba32Float, color_usage)?,
            node_image: image("node", ImageFormat::R32Float, color_usage)?,
            depth_image: image("depth", ImageFormat::Depth32, ImageUsage::DEPTH | ImageUsage::SAMPLED)?,
            shown: storage("shown", pixels * 16)?,
            depth_and_node: storage("depth and node", pixels * 8)?,
            color: storage("color", pixels * 4)?,
            counters: storage("counters", COUNTER_WORDS * 4)?,
            records: record::buffer(device, name, settings.record_rays)?,
        })
    }

    /// Adds everything but what there is once for each sample.
    pub(crate) fn list(&self, catalogue: Catalogue) -> Catalogue {
        catalogue
            .with_buffer("Frame", &self.frame)
            .with_buffer("SampleState", &self.sample_state)
            .with_buffer("Closest", &self.closest)
            .with_buffer("Light", &self.light)
            .with_buffer("Look", &self.look)
            .with_buffer("Edge", &self.edge)
            .with_buffer("Weight", &self.weight)
            .with_image("radiance_image", &self.radiance_image)
            .with_image("node_image", &self.node_image)
            .with_image("depth_image", &self.depth_image)
            .with_buffer("Shown", &self.shown)
            .with_buffer("DepthAndNode", &self.depth_and_node)
            // Written at the end of every frame in which edges are measured, so they may use it until then.
            .with_buffer("EdgeScratch", &self.depth_and_node)
            .with_buffer("Color", &self.color)
            .with_buffer("Counters", &self.counters)
            .with_buffer("Records", &self.records)
    }

    /// Bytes of all of it on the device.
    pub(crate) fn bytes(&self) -> u64 {
        let single = [
            &self.frame,
            &self.sample_state,
            &self.closest,
            &self.light,
            &self.look,
            &self.edge,
            &self.weight,
            &self.shown,
            &self.depth_and_node,
            &self.color,
            &self.counters,
            &self.records,
        ];
        let buffers = single.into_iter().chain(&self.hits).chain(&self.live).map(|b| b.bytes());
        let images = [&self.radiance_image, &self.node_image, &self.depth_image].into_iter().map(|i| i.bytes());
        buffers.chain(images).sum()
    }

    /// Workgroups of 8 × 8 that cover the image.
    pub(crate) fn groups(&self) -> [u32; 3] {
        [self.size_px[0].div_ceil(8), self.size_px[1].div_ceil(8), 1]
    }
}
