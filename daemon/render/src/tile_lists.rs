//! The image in tiles of a workgroup's size, and lists of those that a pass is to visit.

/// Side of a tile, px. Twin of `TILE_PX` in `include/tiles.glsl`.
pub const TILE_PX: u32 = 8;

/// Tiles around a changed one in which the distance to occlusion edges may differ. Twin of `EDGE_TILES` in `include/tiles.glsl`.
pub const EDGE_TILES: i32 = 2;

/// A list of tiles. Twin of the constants in `include/tiles.glsl`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TileList {
    /// What the pixels land on.
    Seen = 0,
    /// Where occlusion edges are looked for again.
    Marked = 1,
    /// Where the distance to them may differ.
    Edged = 2,
    /// Light that does not depend on the eye.
    Lit = 3,
    /// Blend weights.
    Shared = 4,
}

/// How many there are.
pub const TILE_LISTS: usize = 5;

/// Bytes of a list's head: the workgroups of an indirect dispatch, and how long it is.
const HEAD_BYTES: u64 = 16;

/// Bytes of `GpuTileBounds` in `tiles.comp`.
pub const TILE_BOUNDS_BYTES: u64 = 32;

/// Bytes of the lists of an image of so many tiles.
pub(crate) fn bytes_for(tiles: u64) -> u64 {
    TILE_LISTS as u64 * (HEAD_BYTES + 4 * tiles)
}

impl TileList {
    /// Where its head stands in `Tiles`, bytes.
    pub(crate) fn offset(self) -> u64 {
        self as u64 * HEAD_BYTES
    }

    pub(crate) const fn bit(self) -> u32 {
        1 << self as u32
    }
}
