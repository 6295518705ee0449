//! Which tiles of the image each pass is to visit.
//!
//! Reads `Moved`, `Closest` and the lights; writes `Tiles`, and keeps `TileBounds`. DESIGN section 4.

use bytemuck::{Pod, Zeroable};
use lantern_gpu::{GpuError, Recorder};

use crate::bound::Bound;
use crate::moved::MovedTable;
use crate::shaders;
use crate::stale::{Extent, Stale};
use crate::targets::Targets;
use crate::tile_lists::{TILE_LISTS, TileList};

/// Twin of `Push` in `tiles.comp`; 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Push {
    whole: u32,
    reached: u32,
    physical_count: u32,
    moved_count: u32,
}

impl Push {
    fn new(stale: Stale, moved: &MovedTable) -> Self {
        use TileList::{Edged, Lit, Marked, Seen, Shared};
        let lists = |extent| {
            let of = |stage: Extent, bits: u32| if stage == extent { bits } else { 0 };
            of(stale.primary, Seen.bit() | Marked.bit() | Edged.bit())
                | of(stale.light, Lit.bit())
                | of(stale.weight, Shared.bit())
        };
        Self {
            whole: lists(Extent::Whole),
            reached: lists(Extent::Reached),
            physical_count: moved.physical,
            moved_count: moved.all,
        }
    }
}

/// Records the pass.
pub(crate) fn record(
    recorder: &mut Recorder,
    bound: &Bound,
    targets: &Targets,
    stale: Stale,
    moved: &MovedTable,
) -> Result<(), GpuError> {
    recorder.upload(&targets.tiles, 0, bytemuck::cast_slice(&[[0u32, 1, 1, 0]; TILE_LISTS]))?;
    recorder.upload(&bound.moved, 0, &moved.bytes)?;
    recorder.span("tiles", |recorder| {
        let [columns, rows, _] = targets.groups();
        let push = Push::new(stale, moved);
        let groups = [(columns * rows).div_ceil(shaders::TILES_COMP.local_size[0]), 1, 1];
        recorder.dispatch(&bound.pipelines.tiles, &bound.tiles, bytemuck::bytes_of(&push), groups)
    })
}
