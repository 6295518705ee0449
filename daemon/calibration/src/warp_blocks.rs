//! Which cells of a warp may show a place: boxes around blocks of cells, and around blocks of blocks.

use glam::{DVec2, IVec2};

/// Cells, or blocks, along each side of a block.
const SIDE: i32 = 8;

/// A box in the ideal image, px.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Bounds {
    low: DVec2,
    high: DVec2,
}

impl Bounds {
    const NOTHING: Self = Self { low: DVec2::INFINITY, high: DVec2::NEG_INFINITY };

    fn join(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    fn holds(&self, at: DVec2) -> bool {
        at.cmpge(self.low).all() && at.cmple(self.high).all()
    }
}

/// Blocks of one size.
#[derive(Clone, Debug)]
struct Level {
    size: IVec2,
    bounds: Vec<Bounds>,
}

impl Level {
    /// From what stands below, `below` many of them.
    fn new(below: IVec2, of: impl Fn(IVec2) -> Bounds) -> Self {
        let size = (below + SIDE - 1) / SIDE;
        let around = |block: IVec2| places(block, below).map(&of).fold(Bounds::NOTHING, Bounds::join);
        let bounds = (0..size.y).flat_map(|y| (0..size.x).map(move |x| IVec2::new(x, y))).map(around).collect();
        Self { size, bounds }
    }

    fn bounds(&self, block: IVec2) -> Bounds {
        self.bounds[(block.y * self.size.x + block.x) as usize]
    }
}

/// What a block holds of so many.
fn places(block: IVec2, below: IVec2) -> impl Iterator<Item = IVec2> {
    let (first, end) = (block * SIDE, (block * SIDE + SIDE).min(below));
    (first.y..end.y).flat_map(move |y| (first.x..end.x).map(move |x| IVec2::new(x, y)))
}

/// All levels, the finest first.
#[derive(Clone, Debug, Default)]
pub(crate) struct Blocks {
    cells: IVec2,
    levels: Vec<Level>,
}

impl Blocks {
    /// Over so many cells; `corners_px` gives a cell's corners in the ideal image, where what is bilinear has its extremes,
    /// or nothing where it is dark.
    pub(crate) fn new(cells: IVec2, corners_px: impl Fn(IVec2) -> Option<[DVec2; 4]>) -> Self {
        let around = |cell: IVec2| {
            corners_px(cell).map_or(Bounds::NOTHING, |corners| {
                // A little beyond, as a place found on the rim may be by rounding.
                let bounds = corners.iter().fold(Bounds::NOTHING, |b, &at| b.join(Bounds { low: at, high: at }));
                let pad = 1e-9 * (1.0 + bounds.low.abs().max(bounds.high.abs()));
                Bounds { low: bounds.low - pad, high: bounds.high + pad }
            })
        };
        let mut levels = vec![Level::new(cells, around)];
        while let Some(finer) = levels.last().filter(|level| level.size != IVec2::ONE) {
            let coarser = Level::new(finer.size, |block| finer.bounds(block));
            levels.push(coarser);
        }
        Self { cells, levels }
    }

    /// What the first cell makes of a place that it may show, of those that make something of it.
    pub(crate) fn find<T>(&self, at: DVec2, cell: impl Fn(IVec2) -> Option<T>) -> Option<T> {
        // Blocks still to be looked into, with their level; the last one first.
        let mut waiting: Vec<(usize, IVec2)> =
            self.levels.last().map(|_| (self.levels.len() - 1, IVec2::ZERO)).into_iter().collect();
        while let Some((level, block)) = waiting.pop() {
            if !self.levels[level].bounds(block).holds(at) {
                continue;
            }
            if level == 0 {
                let found = places(block, self.cells).find_map(&cell);
                if found.is_some() {
                    return found;
                }
            } else {
                let finer: Vec<_> = places(block, self.levels[level - 1].size).collect();
                waiting.extend(finer.into_iter().rev().map(|block| (level - 1, block)));
            }
        }
        None
    }
}
