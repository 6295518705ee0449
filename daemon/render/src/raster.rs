//! Nodes of role raster, drawn with the projector's matrix against the traced image's depth.
//!
//! No ray knows them: they cast no shadow and stand in no reflection (PAPER.md, Figure 6).

use bytemuck::{Pod, Zeroable};
use lantern_gpu::{Draws, GpuError};
use lantern_scene::{Role, Scene};

use crate::bound::Bound;

/// One instance to draw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct RasterNode {
    pub(crate) instance: u32,
    pub(crate) triangles: u32,
}

/// Twin of `Push` in `raster.vert` and `raster.frag`; 12 bytes.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Push {
    offset_px: [f32; 2],
    instance: u32,
}

/// The visible instances that the rasteriser owns.
pub(crate) fn nodes(scene: &Scene) -> Vec<RasterNode> {
    let of_instance = |(i, instance): (usize, &lantern_scene::Instance)| {
        (instance.visible && instance.role == Role::Raster)
            .then(|| RasterNode { instance: i as u32, triangles: scene.top.instances[i].triangle_count })
    };
    scene.instances.iter().enumerate().filter_map(of_instance).filter(|n| n.triangles > 0).collect()
}

/// Draws them all.
pub(crate) fn draw(
    draws: &mut Draws<'_>,
    bound: &Bound,
    nodes: &[RasterNode],
    offset_px: [f32; 2],
) -> Result<(), GpuError> {
    for node in nodes {
        let push = Push { offset_px, instance: node.instance };
        draws.draw(&bound.pipelines.raster, &bound.raster, bytemuck::bytes_of(&push), node.triangles * 3, 1)?;
    }
    Ok(())
}
