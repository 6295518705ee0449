//! Raster nodes behind a lens: drawn onto the ideal image, where what is straight stays straight, and met there by each pixel's own ray.
//!
//! The ideal image says which triangles a pixel may show; its ray decides, so that coverage, look and depth are those of a traced
//! triangle. A triangle that covers the middle of a texel within one texel of a ray's place is never missed; smaller ones may be, at an
//! outline, by as much. A texel is at most half a pixel wide, but where that would take more than four of them for each.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use lantern_gpu::{Bindings, Device, Draws, GpuError, Image, ImageFormat, ImageUsage, Load, Recorder};

use crate::catalogue::Catalogue;
use crate::ideal_tiles::IdealTiles;
use crate::pipelines::{Pipelines, SEEN};
use crate::raster::RasterNode;
use crate::targets::Targets;
use crate::tile_lists::TILE_PX;

/// Texels of the ideal image for each of the real one's pixels, on each axis, at most.
const MOST_TEXELS_A_PX: f32 = 4.0;

/// Texels that a pixel shows, on each axis, at least.
const TEXELS_A_PX: f32 = 2.0;

/// Twin of `Push` in `visible.vert` and `visible.frag`, whose last word is the instance; and, with the offset instead, of that in
/// `warped.frag`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Push {
    low_px: [f32; 2],
    texels_a_px: [f32; 2],
    size: [f32; 2],
}

/// The ideal image of one projector.
pub(crate) struct Visible {
    place: Push,
    instance: Arc<Image>,
    triangle: Arc<Image>,
    depth: Arc<Image>,
    drawn: Arc<Bindings>,
    warped: Arc<Bindings>,
}

impl Visible {
    pub(crate) fn new(
        device: &Arc<Device>,
        name: &str,
        (targets, tiles): (&Targets, &IdealTiles),
        catalogue: &Catalogue,
        pipelines: &Pipelines,
    ) -> Result<Self, GpuError> {
        let place = place(targets.size_px, tiles);
        let image = |what: &str, format: ImageFormat, usage| {
            let [width, height] = place.size.map(|size| size as u32);
            Image::new(device, &format!("{name}/{what}"), width, height, format, usage)
        };
        let color = ImageUsage::COLOR | ImageUsage::SAMPLED;
        let instance = image("seen instance", SEEN[0], color)?;
        let triangle = image("seen triangle", SEEN[1], color)?;
        let all = targets.list(catalogue.clone());
        let seen =
            all.clone().with_image("seen_instance_image", &instance).with_image("seen_triangle_image", &triangle);
        Ok(Self {
            place,
            depth: image("seen depth", ImageFormat::Depth32, ImageUsage::DEPTH)?,
            drawn: all.bind(&*pipelines.visible)?,
            warped: seen.bind(&*pipelines.warped)?,
            instance,
            triangle,
        })
    }

    /// Draws the nodes onto the ideal image.
    pub(crate) fn record(
        &self,
        recorder: &mut Recorder,
        pipelines: &Pipelines,
        nodes: &[RasterNode],
    ) -> Result<(), GpuError> {
        let none = Load::Clear([0.0; 4]);
        let colors = [(&self.instance, none), (&self.triangle, none)];
        let depth = Some((&self.depth, Load::Clear([1.0; 4])));
        recorder.render("visible", &colors, depth, &[&self.drawn], |draws| {
            for node in nodes {
                let mut push = bytemuck::bytes_of(&self.place).to_vec();
                push.extend_from_slice(bytemuck::bytes_of(&node.instance));
                draws.draw(&pipelines.visible, &self.drawn, &push, node.triangles * 3, 1)?;
            }
            Ok(())
        })
    }

    /// What [`Visible::draw`] binds.
    pub(crate) fn bindings(&self) -> &Arc<Bindings> {
        &self.warped
    }

    /// Draws what the rays meet of it, at `offset_px` from the pixels' centres.
    pub(crate) fn draw(
        &self,
        draws: &mut Draws<'_>,
        pipelines: &Pipelines,
        offset_px: [f32; 2],
    ) -> Result<(), GpuError> {
        let mut push = bytemuck::bytes_of(&self.place).to_vec();
        push.extend_from_slice(bytemuck::bytes_of(&offset_px));
        draws.draw(&pipelines.warped, &self.warped, &push, 3, 1)
    }
}

/// Which part of the ideal image is drawn and how finely: all that the real one shows, a texel half as wide as a pixel is there.
fn place(size_px: [u32; 2], tiles: &IdealTiles) -> Push {
    let [left, top, right, bottom] = tiles.around([0, 0, i32::MAX, i32::MAX]);
    if left > right {
        return Push { low_px: [0.0; 2], texels_a_px: [1.0; 2], size: [1.0; 2] };
    }
    // Tiles that the image's edges cut off are narrower for no other reason.
    let columns = size_px[0].div_ceil(TILE_PX);
    let whole =
        |index: u32| (index % columns + 1) * TILE_PX <= size_px[0] && (index / columns + 1) * TILE_PX <= size_px[1];
    let lit = || (0..).zip(tiles.around_px()).filter(|(index, around)| whole(*index) && around[0] <= around[2]);
    let narrowest =
        |low: usize, high: usize| lit().map(|(_, around)| around[high] - around[low]).fold(f32::INFINITY, f32::min);
    let of_axis = |low: f32, high: f32, narrowest: f32, size_px: u32| {
        let texels_a_px = TEXELS_A_PX * (TILE_PX as f32 / narrowest.max(1e-3)).max(1.0);
        let most = (MOST_TEXELS_A_PX * size_px as f32 / (high - low)).max(f32::MIN_POSITIVE);
        let texels_a_px = texels_a_px.min(most);
        (texels_a_px, ((high - low) * texels_a_px).ceil().max(1.0))
    };
    let (x, width) = of_axis(left, right, narrowest(0, 2), size_px[0]);
    let (y, height) = of_axis(top, bottom, narrowest(1, 3), size_px[1]);
    Push { low_px: [left, top], texels_a_px: [x, y], size: [width, height] }
}
