//! The traced image with its depth, in the projector's own depth convention, and the rasterised nodes before or after it.
//!
//! Reads `Closest`, `Light`, `Look` and `Weight`; writes the attachments. PAPER.md, Hybrid Rendering, equations 4 to 7.

use lantern_gpu::{GpuError, Load, Recorder};

use crate::bound::Bound;
use crate::raster::{self, RasterNode};
use crate::settings::RasterOrder;
use crate::targets::Targets;

/// Records one composite, with the raster nodes sampled at `offset_px` from the pixels' centres.
pub(crate) fn record(
    recorder: &mut Recorder,
    bound: &Bound,
    targets: &Targets,
    nodes: &[RasterNode],
    order: RasterOrder,
    offset_px: [f32; 2],
) -> Result<(), GpuError> {
    let miss = Load::Clear([-1.0; 4]);
    let colors = [(&targets.radiance_image, Load::Clear([0.0; 4])), (&targets.node_image, miss)];
    let depth = Some((&targets.depth_image, Load::Clear([1.0; 4])));
    let uses = [&bound.composite, &bound.raster];
    recorder.render("composite", &colors, depth, &uses, |draws| match order {
        RasterOrder::After => {
            draws.draw(&bound.pipelines.composite_first, &bound.composite, &[], 3, 1)?;
            raster::draw(draws, bound, nodes, offset_px)
        }
        RasterOrder::Before => {
            raster::draw(draws, bound, nodes, offset_px)?;
            draws.draw(&bound.pipelines.composite_over, &bound.composite, &[], 3, 1)
        }
    })
}
