//! A measured warp: a grid over the real image that says where each node looks in the ideal one, and the way back.

use std::sync::Arc;

use glam::{DVec2, IVec2, UVec2, Vec2};

use crate::warp_blocks::Blocks;

/// Of the cells of a warp this share may be turned over, as the noise of a measured map turns them; more is a fold.
const TURNED_SHARE: f64 = 0.01;

/// Nodes of an inverse grid on each axis that are always allowed.
const MOST_INVERSE_NODES: f64 = 256.0;

/// How far beyond its rim, in its own widths, a cell still counts as met: rounding.
const RIM: f64 = 1e-9;

/// The geometry warp of a projector. A node lies in the middle of its cell of the image (as the pixels of an MPCDI map
/// do: node (i, j) of `size` stands at ((i + ½)·W / size.x, (j + ½)·H / size.y) of an image of W × H), and what is between
/// nodes is bilinear.
#[derive(Clone, Debug)]
pub struct Warp {
    /// Columns and rows of nodes.
    pub size: UVec2,
    /// The place of each node in the ideal image, continuous pixels from its top left corner, row 0 on top; NaN where no
    /// light goes.
    pub ideal_px: Vec<Vec2>,
}

/// Bit by bit, so that a warp with holes is equal to itself.
impl PartialEq for Warp {
    fn eq(&self, other: &Self) -> bool {
        let bits = |warp: &Self| warp.ideal_px.iter().map(|at| at.to_array().map(f32::to_bits)).collect::<Vec<_>>();
        self.size == other.size && bits(self) == bits(other)
    }
}

/// Why a warp cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WarpError {
    /// Too few nodes, or not as many as the size says.
    #[error(
        "the warp of {columns} × {rows} has {nodes} nodes; hint: it needs at least 2 × 2, and as many as its header says"
    )]
    Size {
        /// Columns.
        columns: u32,
        /// Rows.
        rows: u32,
        /// Nodes.
        nodes: usize,
    },
    /// An infinite place.
    #[error("the warp's node in column {column}, row {row} is infinite; hint: a node without light is NaN")]
    Infinite {
        /// From 0.
        column: u32,
        /// From 0.
        row: u32,
    },
    /// Nothing is lit.
    #[error(
        "no node of the warp looks anywhere that its neighbours do not; hint: every node is NaN, or all are the same"
    )]
    Dark,
    /// It folds.
    #[error(
        "the warp folds over: {turned} of its {cells} cells are turned against the others, the first one in column \
         {column}, row {row}; hint: nodes without light must be NaN, and neighbours must look at neighbouring places"
    )]
    Folds {
        /// Cells that are turned over.
        turned: usize,
        /// Cells that are lit.
        cells: usize,
        /// From 0.
        column: u32,
        /// From 0.
        row: u32,
    },
}

/// A checked warp over an image, with what finds the way back.
#[derive(Clone, Debug)]
pub struct Grid {
    warp: Arc<Warp>,
    /// The image's pixels a node.
    step_px: DVec2,
    /// As the warp's, and at dark nodes beside lit ones what continues these: a pixel that is lit is lit all over.
    nodes_px: Vec<Vec2>,
    /// Which cells show what.
    blocks: Blocks,
}

/// What it shows follows from these two.
impl PartialEq for Grid {
    fn eq(&self, other: &Self) -> bool {
        self.step_px == other.step_px && (Arc::ptr_eq(&self.warp, &other.warp) || self.warp == other.warp)
    }
}

/// A grid over the ideal image that says where about the real one shows each node: where the search of a shader starts.
#[derive(Clone, Debug)]
pub(crate) struct Inverse {
    /// Columns and rows.
    pub(crate) nodes: UVec2,
    /// The first node's place in the ideal image, px.
    pub(crate) low_px: DVec2,
    /// From node to node, px.
    pub(crate) step_px: f64,
    /// The real place of each node; NaN where none is known and no neighbour's continues to it.
    pub(crate) real_px: Vec<Vec2>,
}

/// Four nodes, and how bilinear they are: `at_00 + u·per_u + v·per_v + u·v·twist`, u and v from 0 to 1 between them.
#[derive(Clone, Copy, Debug)]
struct Cell {
    at_00: DVec2,
    per_u: DVec2,
    per_v: DVec2,
    twist: DVec2,
}

impl Cell {
    fn at(&self, uv: DVec2) -> DVec2 {
        self.at_00 + self.per_u * uv.x + (self.per_v + self.twist * uv.x) * uv.y
    }

    /// The signed area that a step of each of u and v spans.
    fn turn(&self, uv: DVec2) -> f64 {
        (self.per_u + self.twist * uv.y).perp_dot(self.per_v + self.twist * uv.x)
    }

    /// All (u, v) that show a place, at most two.
    ///
    /// With a = at_00 − place, a + u·per_u lies along per_v + u·twist: the cross product of the two is quadratic in u.
    fn places_of(&self, place: DVec2) -> impl Iterator<Item = DVec2> + use<> {
        let &Self { at_00, per_u, per_v, twist } = self;
        let a = at_00 - place;
        let [constant, linear, square] =
            [a.perp_dot(per_v), a.perp_dot(twist) + per_u.perp_dot(per_v), per_u.perp_dot(twist)];
        // Both roots without the difference of two nearly equal numbers: Numerical Recipes, section 5.6.
        let discriminant = linear * linear - 4.0 * square * constant;
        let half = -0.5 * (linear + linear.signum() * discriminant.sqrt());
        let cell = *self;
        [constant / half, half / square].into_iter().filter(|u| u.is_finite()).filter_map(move |u| {
            let along = per_v + twist * u;
            let v = -(a + per_u * u).dot(along) / along.length_squared();
            // One step of Newton takes what the roots have lost.
            let uv = DVec2::new(u, v);
            let jacobian = glam::DMat2::from_cols(per_u + twist * v, per_v + twist * u);
            let refined = uv - jacobian.inverse() * (cell.at(uv) - place);
            refined.is_finite().then_some(refined)
        })
    }
}

impl Grid {
    /// Checks a warp for an image of so many pixels.
    ///
    /// # Errors
    /// A size that is not that of the nodes, an infinite place, nothing lit, or a fold, with the first cell of it.
    pub fn new(warp: Arc<Warp>, resolution_px: UVec2) -> Result<Self, WarpError> {
        let Warp { size, ideal_px } = warp.as_ref();
        let nodes = u64::from(size.x) * u64::from(size.y);
        if size.min_element() < 2 || nodes != ideal_px.len() as u64 {
            return Err(WarpError::Size { columns: size.x, rows: size.y, nodes: ideal_px.len() });
        }
        if let Some(index) = ideal_px.iter().position(|at| at.to_array().into_iter().any(f32::is_infinite)) {
            return Err(WarpError::Infinite { column: index as u32 % size.x, row: index as u32 / size.x });
        }

        let nodes_px = continued(&warp, Vec2::ZERO);
        let mut grid = Self {
            step_px: resolution_px.as_dvec2() / size.as_dvec2(),
            warp: Arc::clone(&warp),
            nodes_px,
            blocks: Blocks::default(),
        };
        grid.check_turns()?;
        let corners_px = |first: IVec2| {
            let (low, high) = grid.extent(first);
            let corners = [low, DVec2::new(high.x, low.y), DVec2::new(low.x, high.y), high];
            grid.cell(first).map(|cell| corners.map(|uv| cell.at(uv)))
        };
        grid.blocks = Blocks::new(size.as_ivec2() - 1, corners_px);
        Ok(grid)
    }

    /// The warp.
    pub fn warp(&self) -> &Arc<Warp> {
        &self.warp
    }

    /// The place in the ideal image; `None` where the nearest node is dark.
    pub fn ideal_px(&self, real_px: DVec2) -> Option<DVec2> {
        let at_nodes = real_px / self.step_px - 0.5;
        let last = self.warp.size.as_ivec2() - 1;
        let nearest = at_nodes.round().as_ivec2().clamp(IVec2::ZERO, last);
        if !self.lit(nearest) {
            return None;
        }
        let first = at_nodes.floor().as_ivec2().clamp(IVec2::ZERO, last - 1);
        self.cell(first).map(|cell| cell.at(at_nodes - first.as_dvec2()))
    }

    /// The place in the real image; `None` where no lit part of it looks there. Of several, the first by blocks of cells.
    pub fn real_px(&self, ideal_px: DVec2) -> Option<DVec2> {
        self.blocks.find(ideal_px, |first| {
            let (low, high) = self.extent(first);
            let inside = |uv: &DVec2| uv.cmpge(low - RIM).all() && uv.cmple(high + RIM).all();
            let lit = |uv: &DVec2| self.lit(first + uv.round().as_ivec2().clamp(IVec2::ZERO, IVec2::ONE));
            let found = self.cell(first)?.places_of(ideal_px).filter(inside).find(lit);
            found.map(|uv| (first.as_dvec2() + uv + 0.5) * self.step_px)
        })
    }

    /// A box around all that a rectangle of the real image shows. What is bilinear between nodes has its extremes at these, and
    /// where their lines cross the rectangle's sides.
    pub fn ideal_bounds(&self, low_px: DVec2, high_px: DVec2) -> Option<(DVec2, DVec2)> {
        let (low, high) = (low_px / self.step_px - 0.5, high_px / self.step_px - 0.5);
        let stops = |low: f64, high: f64| {
            let nodes = (low.ceil() as i64..=high.floor() as i64).map(|node| node as f64);
            [low, high].into_iter().chain(nodes).collect::<Vec<f64>>()
        };
        let last = self.warp.size.as_ivec2() - 2;
        let rows = stops(low.y, high.y);
        let places = stops(low.x, high.x).into_iter().flat_map(|x| rows.iter().map(move |&y| DVec2::new(x, y)));
        // A stop on a node belongs to the cells on both sides of it, of which one may be dark.
        let shown = places.flat_map(|at| {
            let (after, before) = (at.floor().as_ivec2(), at.ceil().as_ivec2() - 1);
            let cells = [after, before, IVec2::new(after.x, before.y), IVec2::new(before.x, after.y)];
            cells.map(|first| {
                let first = first.clamp(IVec2::ZERO, last);
                self.cell(first).map(|cell| cell.at(at - first.as_dvec2()))
            })
        });
        let shown = shown.flatten();
        let none = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let (low, high) = shown.fold(none, |(low, high), at| (low.min(at), high.max(at)));
        (low.x <= high.x).then_some((low, high))
    }

    /// The nodes, of which dark ones continue what is lit beside them, and whether each is lit.
    pub(crate) fn nodes(&self) -> impl Iterator<Item = (Vec2, bool)> {
        self.nodes_px.iter().copied().zip(self.warp.ideal_px.iter().map(|at| !at.is_nan()))
    }

    /// The way back as a grid of about this step over what the real image of so many pixels shows.
    pub(crate) fn inverse(&self, resolution_px: DVec2, step_px: f64) -> Inverse {
        let around = self.ideal_bounds(DVec2::ZERO, resolution_px);
        let (low_px, high_px) = around.unwrap_or((DVec2::ZERO, resolution_px));
        // As many nodes as the warp has at most, whatever it magnifies.
        let most = self.warp.size.as_dvec2().max(DVec2::splat(MOST_INVERSE_NODES));
        let step_px = ((high_px - low_px) / most).max_element().max(step_px);
        let nodes = ((high_px - low_px) / step_px).ceil().as_uvec2() + 1;
        let at = |i: u32| low_px + UVec2::new(i % nodes.x, i / nodes.x).as_dvec2() * step_px;
        let known = |i: u32| self.real_px(at(i)).map_or(Vec2::NAN, |at| at.as_vec2());
        let known = Warp { size: nodes, ideal_px: (0..nodes.x * nodes.y).map(known).collect() };
        Inverse { nodes, low_px, step_px, real_px: continued(&known, Vec2::NAN) }
    }

    fn index(&self, node: IVec2) -> usize {
        node.y as usize * self.warp.size.x as usize + node.x as usize
    }

    fn lit(&self, node: IVec2) -> bool {
        !self.warp.ideal_px[self.index(node)].is_nan()
    }

    /// The cell right of and below a node; `None` where all of it is dark.
    fn cell(&self, first: IVec2) -> Option<Cell> {
        let corners = [IVec2::ZERO, IVec2::X, IVec2::Y, IVec2::ONE].map(|step| first + step);
        corners.iter().any(|&node| self.lit(node)).then(|| {
            let [a, b, c, d] = corners.map(|node| self.nodes_px[self.index(node)].as_dvec2());
            Cell { at_00: a, per_u: b - a, per_v: c - a, twist: d - b - c + a }
        })
    }

    /// The u and v that a cell serves: those beside the image's edges go on to these, half a step.
    fn extent(&self, first: IVec2) -> (DVec2, DVec2) {
        let last = self.warp.size.as_ivec2() - 2;
        let low = DVec2::select(first.cmpeq(IVec2::ZERO), DVec2::splat(-0.5), DVec2::ZERO);
        (low, DVec2::select(first.cmpeq(last), DVec2::splat(1.5), DVec2::ONE))
    }

    /// Refuses cells that are turned over, but for a few: mirrored or not, they are like one another.
    fn check_turns(&self) -> Result<(), WarpError> {
        let size = self.warp.size.as_ivec2();
        let corners = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE];
        let whole = |first: &IVec2| corners.iter().all(|step| self.lit(*first + step.as_ivec2()));
        let cells = (0..size.y - 1).flat_map(|y| (0..size.x - 1).map(move |x| IVec2::new(x, y))).filter(whole);
        let turns = cells
            .filter_map(|first| self.cell(first).map(|cell| (first, corners.map(|uv| cell.turn(uv)))))
            // What is flat shows nothing, and folds nothing.
            .filter(|(_, turns)| turns.iter().any(|&turn| turn != 0.0));
        let along = |turns: &[f64; 4], sign: f64| turns.iter().all(|turn| turn * sign > 0.0);

        // How many there are of either way, the first that is not of it, and how many in all.
        let (mut all, mut counts, mut firsts) = (0, [0; 2], [None; 2]);
        for (first, turns) in turns {
            all += 1;
            for (way, sign) in [1.0, -1.0].into_iter().enumerate() {
                if along(&turns, sign) {
                    counts[way] += 1;
                } else if firsts[way].is_none() {
                    firsts[way] = Some(first);
                }
            }
        }
        let most = usize::from(counts[1] > counts[0]);
        let (same, other) = (counts[most], firsts[most]);
        if same == 0 {
            return Err(WarpError::Dark);
        }
        let turned = all - same;
        match other {
            Some(first) if turned as f64 > TURNED_SHARE * all as f64 => {
                let (column, row) = (first.x as u32, first.y as u32);
                Err(WarpError::Folds { turned, cells: all, column, row })
            }
            _ => Ok(()),
        }
    }
}

/// The nodes, and at dark ones beside lit ones the mean of what continues straight on from the lit ones; `elsewhere` at others.
fn continued(warp: &Warp, elsewhere: Vec2) -> Vec<Vec2> {
    let size = warp.size.as_ivec2();
    let lit = |node: IVec2| {
        let inside = node.cmpge(IVec2::ZERO).all() && node.cmplt(size).all();
        let at = inside.then(|| warp.ideal_px[node.y as usize * size.x as usize + node.x as usize]);
        at.filter(|at| !at.is_nan())
    };
    let around = (-1..=1).flat_map(|y| (-1..=1).map(move |x| IVec2::new(x, y))).filter(|step| *step != IVec2::ZERO);
    let around: Vec<IVec2> = around.collect();
    let mean = |places: Vec<Vec2>| (!places.is_empty()).then(|| places.iter().sum::<Vec2>() / places.len() as f32);
    let continuing = |node: IVec2| {
        let straight =
            around.iter().filter_map(|&step| Some(lit(node + step)? * 2.0 - lit(node + step * 2)?)).collect();
        let beside = || around.iter().filter_map(|&step| lit(node + step)).collect();
        mean(straight).or_else(|| mean(beside()))
    };
    let nodes = (0..size.y).flat_map(|y| (0..size.x).map(move |x| IVec2::new(x, y)));
    nodes.map(|node| lit(node).or_else(|| continuing(node)).unwrap_or(elsewhere)).collect()
}
