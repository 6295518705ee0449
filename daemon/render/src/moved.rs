//! Where things have moved since the last frame: few boxes in the world, and the tiles of each projector's image in which they may
//! show. What of a picture they reach, `tiles.comp` decides.

use bytemuck::{Pod, Zeroable};
use glam::{DVec2, DVec3, IVec2};
use lantern_calibration::Frustum;
use lantern_scene::Moved;

use crate::ideal_tiles::IdealTiles;
use crate::tile_lists::{EDGE_TILES, TILE_PX};

/// Boxes of physical things, and as many of virtual ones; beyond that, boxes are joined. Twin of `MAX_BOXES` in
/// `include/reach.glsl`.
pub const MAX_BOXES: usize = 16;

/// What rounding can do to places of the device, m, and as a share of a coordinate. The first covers also how far an
/// offset origin lies from its surface near the world's origin, the second how far elsewhere (`offset_origin` in `surface.glsl`: 2⁻¹⁵).
const PAD_M: f64 = 1e-4;
const PAD_SHARE: f64 = 1e-4;

/// What rounding can do to a place in an image, px.
const PAD_PX: f64 = 1.0;

/// Beside the largest clip w of a box's corners, a clip w below this is at the projector's centre, where all is in view.
const CENTRE_BELOW: f64 = 1e-6;

/// A box in the world's own frame, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Box3 {
    /// Its lowest coordinates.
    pub low_m: DVec3,
    /// Its highest.
    pub high_m: DVec3,
}

impl Box3 {
    fn join(self, other: Self) -> Self {
        Self { low_m: self.low_m.min(other.low_m), high_m: self.high_m.max(other.high_m) }
    }

    /// Half of its surface, m²: in proportion to what it hides, on the mean over all directions.
    fn area_m2(self) -> f64 {
        let size_m = self.high_m - self.low_m;
        size_m.x * size_m.y + size_m.y * size_m.z + size_m.z * size_m.x
    }

    /// Grown by what rounding on the device can do, where places are relative to `origin_m`.
    fn padded(self, origin_m: DVec3) -> Self {
        let pad = |at_m: DVec3| DVec3::splat(PAD_M) + (at_m - origin_m).abs() * PAD_SHARE;
        Self { low_m: self.low_m - pad(self.low_m), high_m: self.high_m + pad(self.high_m) }
    }

    fn corners_m(self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let of = |bit: usize, low: f64, high: f64| if i & bit == 0 { low } else { high };
            DVec3::new(
                of(1, self.low_m.x, self.high_m.x),
                of(2, self.low_m.y, self.high_m.y),
                of(4, self.low_m.z, self.high_m.z),
            )
        })
    }
}

/// The boxes of what has moved and was not yet shown.
#[derive(Clone, Debug, Default)]
pub(crate) struct MovedBoxes {
    physical: Vec<Box3>,
    virtual_: Vec<Box3>,
}

impl MovedBoxes {
    pub(crate) fn add(&mut self, moved: &Moved) {
        let boxes = if moved.physical { &mut self.physical } else { &mut self.virtual_ };
        add(boxes, Box3 { low_m: moved.low_m, high_m: moved.high_m });
    }

    pub(crate) fn clear(&mut self) {
        self.physical.clear();
        self.virtual_.clear();
    }

    /// As the device reads them, for the projectors of these frusta and lenses.
    pub(crate) fn table<'a>(
        &self,
        projectors: impl Iterator<Item = (&'a Frustum, Option<&'a IdealTiles>)>,
        origin_m: DVec3,
    ) -> MovedTable {
        let padded = |boxes: &[Box3]| boxes.iter().map(|b| b.padded(origin_m)).collect::<Vec<_>>();
        let (physical, virtual_) = (padded(&self.physical), padded(&self.virtual_));
        let boxes: Vec<GpuMovedBox> =
            physical.iter().chain(&virtual_).map(|b| GpuMovedBox::new(*b, origin_m)).collect();
        let mut bytes: Vec<u8> = bytemuck::cast_slice(&boxes).to_vec();
        bytes.resize(2 * MAX_BOXES * size_of::<GpuMovedBox>(), 0);
        for (frustum, ideal) in projectors {
            let mut shown = [GpuShown::zeroed(); MAX_BOXES];
            for (shown, b) in shown.iter_mut().zip(&physical) {
                *shown = GpuShown::new(frustum, ideal, *b);
            }
            bytes.extend_from_slice(bytemuck::cast_slice(&shown));
        }
        MovedTable { physical: physical.len() as u32, all: boxes.len() as u32, bytes }
    }
}

/// Joins with the box that grows least where that costs no surface, or where there is no room for another.
fn add(boxes: &mut Vec<Box3>, new: Box3) {
    let full = boxes.len() == MAX_BOXES;
    let growth = |b: &Box3| b.join(new).area_m2() - b.area_m2();
    match boxes.iter_mut().min_by(|a, b| growth(a).total_cmp(&growth(b))) {
        Some(nearest) if full || growth(nearest) <= new.area_m2() => *nearest = nearest.join(new),
        _ => boxes.push(new),
    }
}

/// [`MovedBoxes`] as the device reads them.
#[derive(Clone, Debug)]
pub(crate) struct MovedTable {
    /// Boxes of physical things, which come first.
    pub(crate) physical: u32,
    /// And of virtual ones.
    pub(crate) all: u32,
    /// `Moved` in `tiles.comp`: all boxes, and a projector after the other where the physical ones may show.
    pub(crate) bytes: Vec<u8>,
}

impl MovedTable {
    /// Bytes for so many projectors.
    pub(crate) fn bytes_for(projectors: usize) -> u64 {
        (2 * MAX_BOXES * size_of::<GpuMovedBox>() + projectors * MAX_BOXES * size_of::<GpuShown>()) as u64
    }
}

/// A box relative to the scene's origin; 32 bytes, std430.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct GpuMovedBox {
    /// Its lowest coordinates, m.
    pub low: [f32; 3],
    /// Zero.
    pub pad0: f32,
    /// Its highest, m.
    pub high: [f32; 3],
    /// Zero.
    pub pad1: f32,
}

impl GpuMovedBox {
    fn new(b: Box3, origin_m: DVec3) -> Self {
        // A padded box bears rounding to the nearest: the padding is a thousand times the last place of f32.
        let relative = |at: DVec3| (at - origin_m).as_vec3().to_array();
        Self { low: relative(b.low_m), pad0: 0.0, high: relative(b.high_m), pad1: 0.0 }
    }
}

/// Where a box may show in a projector's image; 32 bytes, std430.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct GpuShown {
    /// First column and row, and those after the last, of the real image. All 0: nowhere.
    pub tiles: [i32; 4],
    /// Around the tiles whose occlusion edges may differ for it: lowest and highest place in the ideal image, px.
    pub edged_px: [f32; 4],
}

impl GpuShown {
    fn new(frustum: &Frustum, ideal: Option<&IdealTiles>, b: Box3) -> Self {
        let tiles = tiles_of(frustum, ideal, b);
        let [first_x, first_y, end_x, end_y] = tiles;
        let edged_px = match ideal {
            None => {
                let size_px = frustum.calibration().resolution_px().as_vec2();
                let px = |tile: i32, most_px: f32| ((tile * TILE_PX as i32) as f32).clamp(0.0, most_px);
                [
                    px(first_x - EDGE_TILES, size_px.x),
                    px(first_y - EDGE_TILES, size_px.y),
                    px(end_x + EDGE_TILES, size_px.x),
                    px(end_y + EDGE_TILES, size_px.y),
                ]
            }
            // A tile more: a map of edges is read between its pixels, some of which lie beside the place that is asked for.
            Some(ideal) => {
                let around = EDGE_TILES + 1;
                ideal.around([first_x - around, first_y - around, end_x + around, end_y + around])
            }
        };
        Self { tiles, edged_px }
    }
}

/// The tiles of a projector's image in which a box may show: first column and row, and those after the last. All 0: none.
///
/// A box that reaches the plane of the projector's centre may show anywhere. `ideal` says where tiles lie behind a lens.
pub fn tiles_of(frustum: &Frustum, ideal: Option<&IdealTiles>, b: Box3) -> [i32; 4] {
    let calibration = frustum.calibration();
    let size_px = calibration.resolution_px().as_dvec2();
    let clip = b.corners_m().map(|corner_m| calibration.clip_from_world() * corner_m.extend(1.0));
    let largest_w = clip.iter().map(|c| c.w.abs()).fold(0.0, f64::max);
    if clip.iter().all(|c| c.w <= 0.0) {
        return [0; 4];
    }
    let (mut low_px, mut high_px) = (DVec2::ZERO, size_px);
    if clip.iter().all(|c| c.w > CENTRE_BELOW * largest_w) {
        let places = clip.map(|c| calibration.px_from_ndc(DVec2::new(c.x, c.y) / c.w));
        let bounds = places.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(a, b), p| (a.min(*p), b.max(*p)));
        if let Some(ideal) = ideal {
            return ideal.showing(bounds.0 - PAD_PX, bounds.1 + PAD_PX);
        }
        low_px = (bounds.0 - PAD_PX).max(DVec2::ZERO);
        high_px = (bounds.1 + PAD_PX).min(size_px);
        if low_px.cmpge(high_px).any() {
            return [0; 4];
        }
    }
    let tile_px = f64::from(TILE_PX);
    let first: IVec2 = (low_px / tile_px).floor().as_ivec2();
    let end: IVec2 = (high_px / tile_px).ceil().as_ivec2();
    [first.x, first.y, end.x, end.y]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(at: f64, side: f64) -> Moved {
        let low_m = DVec3::new(at, 0.0, 0.0);
        Moved { physical: true, low_m, high_m: low_m + side }
    }

    #[test]
    fn boxes_are_joined_where_that_costs_nothing_or_must_be() {
        let mut boxes = MovedBoxes::default();
        boxes.add(&cube(0.0, 1.0));
        boxes.add(&cube(0.01, 1.0));
        assert_eq!(boxes.physical.len(), 1, "a small step is one box");
        let all: Vec<Moved> = (0..100).map(|i| cube(3.0 * f64::from(i), 1.0)).collect();
        all.iter().for_each(|moved| boxes.add(moved));
        assert_eq!(boxes.physical.len(), MAX_BOXES);
        for moved in &all {
            let holds = |b: &Box3| b.low_m.cmple(moved.low_m).all() && b.high_m.cmpge(moved.high_m).all();
            assert!(boxes.physical.iter().any(holds), "{moved:?} is in none of {boxes:?}");
        }
    }

    #[test]
    fn kinds_are_kept_apart_and_places_are_relative() {
        let mut boxes = MovedBoxes::default();
        boxes.add(&Moved { physical: false, ..cube(1000.0, 1.0) });
        boxes.add(&cube(1000.0, 1.0));
        let table = boxes.table([].into_iter(), DVec3::new(1000.0, 0.0, 0.0));
        assert_eq!((table.physical, table.all), (1, 2));
        assert_eq!(table.bytes.len() as u64, MovedTable::bytes_for(0));
        let first: GpuMovedBox = bytemuck::pod_collect_to_vec::<u8, GpuMovedBox>(&table.bytes)[0];
        // Outward, by little.
        assert!(first.low.iter().all(|x| (-1e-3..0.0).contains(x)), "{first:?}");
        assert!(first.high.iter().all(|x| (1.0..1.001).contains(&(x - 1e-9))), "{first:?}");
        boxes.clear();
        assert_eq!(boxes.table([].into_iter(), DVec3::ZERO).all, 0);
    }
}
