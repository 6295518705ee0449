//! The buffers and images of one projector.

use std::sync::Arc;

use lantern_calibration::{Calibration, Optics};
use lantern_gpu::{Buffer, BufferKind, Device, GpuError, Image, ImageFormat, ImageUsage};

use crate::catalogue::Catalogue;
use crate::frame::FrameBlocks;
use crate::record;
use crate::settings::Settings;
use crate::tile_lists::{self, TILE_PX, TileList};

/// What a projector's passes write, a row of the image after the other. Bytes a pixel: 8 for each sample plane, and 120.
pub(crate) struct Targets {
    /// Columns and rows.
    pub(crate) size_px: [u32; 2],
    /// What shaders read of a frame.
    pub(crate) frame: FrameBlocks,
    /// One word a stratum, from which jitter is generated.
    pub(crate) sample_state: Arc<Buffer>,
    /// A buffer a group of sample planes: instance and triangle, 8 bytes a sample.
    pub(crate) hits: Vec<Arc<Buffer>>,
    /// Sample planes a group.
    pub(crate) planes_a_group: u32,
    /// What a pixel's samples make of it, as `include/live.glsl` has it.
    pub(crate) classes: Arc<Buffer>,
    /// Lists of the pixels whose look depends on the eye: where one sample stands for all, and where each is looked at; 20 bytes
    /// and 4 a pixel.
    pub(crate) once: Arc<Buffer>,
    pub(crate) each: Arc<Buffer>,
    /// The head of `each` before a frame adds to it.
    pub(crate) each_head: Arc<Buffer>,
    /// Lists of the tiles that are to be made anew; 20 bytes a tile.
    pub(crate) tiles: Arc<Buffer>,
    /// Around what the samples of each tile have met; 32 bytes a tile.
    pub(crate) tile_bounds: Arc<Buffer>,
    /// Distance, sample, instance and triangle of the closest sample; of the farthest hit the distance.
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
    /// What the pixels' alpha and beta maps say, 12 bytes a pixel; one pixel where there are none.
    pub(crate) maps: Arc<Buffer>,
    /// Where each tile lies in the ideal image behind a lens, 16 bytes a tile; one tile where there is none.
    pub(crate) ideal_tiles: Arc<Buffer>,
    /// Rays by kind.
    pub(crate) counters: Arc<Buffer>,
    /// Rays themselves, where they are recorded.
    pub(crate) records: Arc<Buffer>,
}

/// Bytes of `Live` before its list: workgroups of the indirect dispatch, and how many pixels are listed from the list's beginning and
/// from its end.
pub(crate) const LIVE_HEAD: u64 = 20;

/// What an empty list begins with.
pub(crate) const LIVE_EMPTY: [u32; 5] = [0, 1, 1, 0, 0];

/// Words of `Counters` in `shaders-glsl/include/counters.glsl`.
pub(crate) const COUNTER_WORDS: u64 = 5;

impl Targets {
    pub(crate) fn new(
        device: &Arc<Device>,
        name: &str,
        calibration: &Calibration,
        settings: &Settings,
    ) -> Result<Self, GpuError> {
        let size_px = calibration.resolution_px().to_array();
        let has_lens = *calibration.optics() != Optics::Pinhole;
        let samples = settings.samples;
        let pixels = u64::from(size_px[0]) * u64::from(size_px[1]);
        let tiles = u64::from(size_px[0].div_ceil(TILE_PX)) * u64::from(size_px[1].div_ceil(TILE_PX));
        let storage =
            |what: &str, bytes: u64| Buffer::new(device, &format!("{name}/{what}"), BufferKind::Storage, bytes);
        let image = |what: &str, format, usage| {
            Image::new(device, &format!("{name}/{what}"), size_px[0], size_px[1], format, usage)
        };
        let hits_bytes = device.info().max_storage_buffer_bytes.min(settings.walk.hits_bytes.unwrap_or(u64::MAX));
        let planes_a_group = planes_a_group(samples, pixels * 8, hits_bytes);
        let color_usage = ImageUsage::COLOR | ImageUsage::SAMPLED;
        Ok(Self {
            size_px,
            frame: FrameBlocks::new(device, name)?,
            sample_state: storage("sample state", u64::from(samples) * 4)?,
            hits: (0..samples / planes_a_group)
                .map(|g| storage(&format!("hits {g}"), pixels * 8 * u64::from(planes_a_group)))
                .collect::<Result<_, _>>()?,
            planes_a_group,
            classes: storage("classes", pixels * 4)?,
            once: storage("once", LIVE_HEAD + pixels * 4)?,
            each: storage("each", LIVE_HEAD + pixels * 4)?,
            each_head: storage("each, head", LIVE_HEAD)?,
            tiles: storage("tiles", tile_lists::bytes_for(tiles))?,
            tile_bounds: storage("tile bounds", tiles * tile_lists::TILE_BOUNDS_BYTES)?,
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
            maps: storage("maps", if calibration.maps().is_empty() { 1 } else { pixels } * 12)?,
            ideal_tiles: storage("ideal tiles", if has_lens { tiles } else { 1 } * 16)?,
            counters: storage("counters", COUNTER_WORDS * 4)?,
            records: record::buffer(device, name, settings.record_rays)?,
        })
    }

    /// Adds everything but what there is once for each sample.
    pub(crate) fn list(&self, catalogue: Catalogue) -> Catalogue {
        self.frame
            .list(catalogue)
            .with_buffer("SampleState", &self.sample_state)
            .with_buffer("Class", &self.classes)
            .with_buffer("Once", &self.once)
            .with_buffer("Each", &self.each)
            .with_buffer("Tiles", &self.tiles)
            .with_buffer("TileBounds", &self.tile_bounds)
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
            .with_buffer("Maps", &self.maps)
            .with_buffer("IdealTiles", &self.ideal_tiles)
            .with_buffer("Counters", &self.counters)
            .with_buffer("Records", &self.records)
    }

    /// Bytes of all of it on the device.
    pub(crate) fn bytes(&self) -> u64 {
        let single = [
            &self.sample_state,
            &self.classes,
            &self.once,
            &self.each,
            &self.each_head,
            &self.tiles,
            &self.tile_bounds,
            &self.closest,
            &self.light,
            &self.look,
            &self.edge,
            &self.weight,
            &self.shown,
            &self.depth_and_node,
            &self.color,
            &self.maps,
            &self.ideal_tiles,
            &self.counters,
            &self.records,
        ];
        let buffers = single.into_iter().chain(&self.hits).map(|b| b.bytes());
        let images = [&self.radiance_image, &self.node_image, &self.depth_image].into_iter().map(|i| i.bytes());
        buffers.chain(images).sum::<u64>() + self.frame.bytes()
    }

    /// The group in which `middle_sample` of `include/random.glsl` lies.
    pub(crate) fn middle_group(&self, samples: u32) -> usize {
        let strata = samples.isqrt();
        let low = (strata - 1) / 2;
        ((low * strata + low) / self.planes_a_group) as usize
    }

    /// Workgroups that cover the image, one a tile.
    pub(crate) fn groups(&self) -> [u32; 3] {
        [self.size_px[0].div_ceil(TILE_PX), self.size_px[1].div_ceil(TILE_PX), 1]
    }

    /// The counts of an indirect dispatch over the tiles of a list.
    pub(crate) fn listed(&self, list: TileList) -> (&Arc<Buffer>, u64) {
        (&self.tiles, list.offset())
    }
}

/// Planes that lie side by side: at most four, which one invocation may trace together, as many in each group, and no buffer beyond
/// the device's limit.
fn planes_a_group(samples: u32, plane_bytes: u64, limit_bytes: u64) -> u32 {
    let fits = |planes: &u32| samples.is_multiple_of(*planes) && plane_bytes * u64::from(*planes) <= limit_bytes;
    (2..=4).rev().find(fits).unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::planes_a_group;

    #[test]
    fn groups_are_even_and_within_the_limit() {
        let at_most = |samples, limit| planes_a_group(samples, 8 << 20, limit);
        assert_eq!([1, 4, 9, 16, 25, 36, 49, 256].map(|s| at_most(s, 128 << 20)), [1, 4, 3, 4, 1, 4, 1, 4]);
        assert_eq!([4, 9, 16].map(|s| at_most(s, 20 << 20)), [2, 1, 2]);
    }
}
