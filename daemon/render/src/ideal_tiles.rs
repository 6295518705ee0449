//! Where the tiles of an image behind a lens lie in the ideal image, in which boxes and rays are straight.

use glam::{DVec2, UVec2};
use lantern_calibration::{Calibration, Optics};

use crate::tile_lists::TILE_PX;

/// How much more than what f64 finds each tile is taken to show, ideal px: what the shader's f32 may add.
const PAD_PX: f64 = 0.1;

/// A box around nothing.
const NOTHING: [f32; 4] = [f32::INFINITY, f32::INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY];

/// A box in the ideal image around what each tile shows, px.
#[derive(Clone, Debug)]
pub struct IdealTiles {
    columns: u32,
    around_px: Vec<[f32; 4]>,
}

impl IdealTiles {
    /// Of a projector's image; `None` where there is no lens, and a tile lies in the ideal image where it does in the real one.
    pub fn of(calibration: &Calibration) -> Option<Self> {
        let optics = calibration.optics();
        if *optics == Optics::Pinhole {
            return None;
        }
        let size_px = calibration.resolution_px();
        let tiles = UVec2::new(size_px.x.div_ceil(TILE_PX), size_px.y.div_ceil(TILE_PX));
        let around = |x: u32, y: u32| {
            let low_px = UVec2::new(x, y) * TILE_PX;
            let high_px = (low_px + TILE_PX).min(size_px);
            optics.ideal_bounds(low_px.as_dvec2(), high_px.as_dvec2()).map_or(NOTHING, |(low, high)| {
                let (low, high) = ((low - PAD_PX).as_vec2(), (high + PAD_PX).as_vec2());
                [low.x, low.y, high.x, high.y]
            })
        };
        let around_px =
            (0..tiles.y).flat_map(|y| (0..tiles.x).map(move |x| (x, y))).map(|(x, y)| around(x, y)).collect();
        Some(Self { columns: tiles.x, around_px })
    }

    /// Of each tile, row by row: the lowest and the highest place; low above high where the tile is dark.
    pub(crate) fn around_px(&self) -> &[[f32; 4]] {
        &self.around_px
    }

    /// The tiles that show anything of a box in the ideal image: first column and row, and those after the last. All 0: none.
    pub(crate) fn showing(&self, low_px: DVec2, high_px: DVec2) -> [i32; 4] {
        let (low, high) = (low_px.as_vec2(), high_px.as_vec2());
        let meets = |a: &[f32; 4]| a[0] <= high.x && a[2] >= low.x && a[1] <= high.y && a[3] >= low.y;
        let mut found = [i32::MAX, i32::MAX, 0, 0];
        for (row, tiles) in (0..).zip(self.around_px.chunks_exact(self.columns as usize)) {
            for (column, _) in (0..).zip(tiles).filter(|(_, around)| meets(around)) {
                found = [found[0].min(column), found[1].min(row), found[2].max(column + 1), found[3].max(row + 1)];
            }
        }
        if found[2] == 0 { [0; 4] } else { found }
    }

    /// A box around what a rectangle of tiles shows; low above high where all of it is dark.
    pub(crate) fn around(&self, [first_x, first_y, end_x, end_y]: [i32; 4]) -> [f32; 4] {
        let rows = self.around_px.chunks_exact(self.columns as usize);
        let rows = rows.take(end_y.max(0) as usize).skip(first_y.max(0) as usize);
        let tiles = rows.flat_map(|row| row.iter().take(end_x.max(0) as usize).skip(first_x.max(0) as usize));
        tiles.fold(NOTHING, |a, b| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])])
    }
}
