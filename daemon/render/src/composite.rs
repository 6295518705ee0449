//! The traced image with its depth, in the projector's own depth convention, and the rasterised nodes before or after it.
//!
//! Reads `Closest`, `Light`, `Look` and `Weight`; writes the attachments. PAPER.md, Hybrid Rendering, equations 4 to 7.

use lantern_gpu::{Draws, GpuError, Load, Recorder};

use crate::bound::Bound;
use crate::raster::{self, RasterNode};
use crate::settings::RasterOrder;
use crate::targets::Targets;
use crate::visible::Visible;

/// Records one composite, with the raster nodes sampled at `offset_px` from the pixels' centres; behind a lens, out of what is
/// `visible` of them.
pub(crate) fn record(
    recorder: &mut Recorder,
    bound: &Bound,
    targets: &Targets,
    (nodes, visible): (&[RasterNode], Option<&Visible>),
    order: RasterOrder,
    offset_px: [f32; 2],
) -> Result<(), GpuError> {
    let miss = Load::Clear([-1.0; 4]);
    let colors = [(&targets.radiance_image, Load::Clear([0.0; 4])), (&targets.node_image, miss)];
    let depth = Some((&targets.depth_image, Load::Clear([1.0; 4])));
    let rasterised = visible.map_or(&bound.raster, Visible::bindings);
    let uses = [&bound.composite, rasterised];
    let rasterise = |draws: &mut Draws<'_>| match visible {
        Some(visible) => visible.draw(draws, &bound.pipelines, offset_px),
        None => raster::draw(draws, bound, nodes, offset_px),
    };
    recorder.render("composite", &colors, depth, &uses, |draws| match order {
        RasterOrder::After => {
            draws.draw(&bound.pipelines.composite_first, &bound.composite, &[], 3, 1)?;
            rasterise(draws)
        }
        RasterOrder::Before => {
            rasterise(draws)?;
            draws.draw(&bound.pipelines.composite_over, &bound.composite, &[], 3, 1)
        }
    })
}
