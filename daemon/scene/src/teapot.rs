//! Newell's teapot, tessellated with exact normals.

use glam::{DVec2, DVec3};

use crate::mesh::MeshData;
use crate::teapot_data::{PATCHES, POINTS};

/// Height of the finished teapot, m.
pub(crate) const HEIGHT_M: f64 = 0.3;

/// Squares along each side of a patch.
const SEGMENTS: u32 = 16;
/// The patches that make the lid, knob included.
const LID: std::ops::Range<usize> = 20..28;
/// The lid is made this much wider than its data say: as they stand it leaves a gap to the rim that shows the inside.
const LID_STRETCH: f64 = 1.077;
/// Height of the data, from the bottom's rim to the knob's top.
const DATA_HEIGHT: f64 = 3.15;

/// All 32 patches, each with vertices of its own: the creases between rim, body and lid stay sharp. Points on a border
/// that two patches share are equal to the bit. Stands on y = 0 with its spout toward +X.
pub(crate) fn tessellate() -> MeshData {
    let mut data = MeshData::default();
    for (number, patch) in PATCHES.iter().enumerate() {
        let stretch = if LID.contains(&number) { LID_STRETCH } else { 1.0 };
        let control = patch.map(|point| {
            let [x, y, z] = POINTS[usize::from(point)];
            DVec3::new(x * stretch, z, -y * stretch) * (HEIGHT_M / DATA_HEIGHT)
        });
        append_patch(&control, &mut data);
    }
    // The bottom bulges below the rim that the body stands on; the lowest point comes to lie on the floor.
    let lowest = data.positions.iter().fold(f32::INFINITY, |lowest, p| lowest.min(p[1]));
    for position in &mut data.positions {
        position[1] -= lowest;
    }
    data
}

fn append_patch(control: &[DVec3; 16], data: &mut MeshData) {
    let first = data.positions.len() as u32;
    for row in 0..=SEGMENTS {
        for column in 0..=SEGMENTS {
            let (position, normal) = evaluate(control, row, column);
            let uv = DVec2::new(f64::from(column), f64::from(row)) / f64::from(SEGMENTS);
            data.push_vertex(position, normal, uv);
        }
    }
    // Toward a pole a row is one point; the triangles that lose their area there are left out.
    let point = |data: &MeshData, vertex: u32| DVec3::from(data.positions[vertex as usize].map(f64::from));
    for row in 0..SEGMENTS {
        for column in 0..SEGMENTS {
            let a = first + row * (SEGMENTS + 1) + column;
            let (b, c, d) = (a + 1, a + SEGMENTS + 2, a + SEGMENTS + 1);
            for triangle in [[a, b, c], [a, c, d]] {
                let [p, q, r] = triangle.map(|vertex| point(data, vertex));
                if p != q && q != r && r != p {
                    data.push_triangle(triangle, 0);
                }
            }
        }
    }
}

/// Position and unit normal at (row, column) of a patch's grid. The normal is ∂/∂column × ∂/∂row, outward for every
/// patch of the set.
fn evaluate(control: &[DVec3; 16], row: u32, column: u32) -> (DVec3, DVec3) {
    let (across, across_slope) = bernstein(column);
    let (down, down_slope) = bernstein(row);
    let sum = |down: [f64; 4], across: [f64; 4]| {
        let rows: [DVec3; 4] =
            std::array::from_fn(|r| combine(across, std::array::from_fn(|column| control[4 * r + column])));
        combine(down, rows)
    };
    let position = sum(down, across);
    let along_column = sum(down, across_slope);
    let along_row = sum(down_slope, across);

    // At a pole the rows shrink to a point: ∂/∂column is 0 there and grows like its own slope along the rows, inward
    // from either end.
    let normal = if along_column.length() > 1e-9 {
        along_column.cross(along_row)
    } else {
        let inward = if row == SEGMENTS { -1.0 } else { 1.0 };
        (sum(down_slope, across_slope) * inward).cross(along_row)
    };
    (position, normal.normalize_or(DVec3::Y))
}

/// The cubic Bernstein polynomials and their slopes at `step` / [`SEGMENTS`]. Both ends are computed alike, so that a
/// border run the other way round gives the same bits.
fn bernstein(step: u32) -> ([f64; 4], [f64; 4]) {
    let t = f64::from(step) / f64::from(SEGMENTS);
    let s = f64::from(SEGMENTS - step) / f64::from(SEGMENTS);
    let slopes = [-3.0 * s * s, 3.0 * s * s - 6.0 * s * t, 6.0 * s * t - 3.0 * t * t, 3.0 * t * t];
    ([s * s * s, 3.0 * (s * s * t), 3.0 * (t * t * s), t * t * t], slopes)
}

/// Sums the outer and the inner pair first: the same either way round.
fn combine(weights: [f64; 4], points: [DVec3; 4]) -> DVec3 {
    (points[0] * weights[0] + points[3] * weights[3]) + (points[1] * weights[1] + points[2] * weights[2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    #[test]
    fn it_is_as_high_as_said_and_stands_on_the_floor() {
        let data = tessellate();
        let heights = data.positions.iter().map(|p| p[1]);
        let (low, high) = heights.fold((f32::MAX, f32::MIN), |(low, high), y| (low.min(y), high.max(y)));
        assert_eq!(low, 0.0);
        assert!((f64::from(high) - HEIGHT_M).abs() < 0.01, "{high}");
        let spout = data.positions.iter().map(|p| p[0]).fold(f32::MIN, f32::max);
        let handle = data.positions.iter().map(|p| p[0]).fold(f32::MAX, f32::min);
        assert!(spout > 0.3 && handle < -0.25, "{spout} {handle}");
    }

    #[test]
    fn normals_are_those_of_finite_differences() {
        for patch in &PATCHES {
            let control = patch.map(|point| DVec3::from(POINTS[usize::from(point)]));
            for (row, column) in [(5, 7), (8, 8), (12, 3)] {
                let (_, normal) = evaluate(&control, row, column);
                let p = |r: u32, c: u32| evaluate(&control, r, c).0;
                let difference =
                    (p(row, column + 1) - p(row, column - 1)).cross(p(row + 1, column) - p(row - 1, column));
                assert!(difference.normalize().dot(normal) > 0.99);
            }
        }
    }

    #[test]
    fn the_normals_at_the_poles_point_along_the_axis() {
        // Patch 20 is a quarter of the knob, whose first row is its top; patch 28 one of the bottom.
        for (patch, expected) in [(20, DVec3::Z), (28, DVec3::NEG_Z)] {
            let control: [DVec3; 16] = PATCHES[patch].map(|point| DVec3::from(POINTS[usize::from(point)]));
            for column in [0, 5, SEGMENTS] {
                let (_, normal) = evaluate(&control, 0, column);
                assert!(normal.dot(expected) > 0.999, "patch {patch}: {normal}");
            }
        }
    }

    #[test]
    fn the_body_faces_away_from_the_axis() {
        let control: [DVec3; 16] = PATCHES[4].map(|point| DVec3::from(POINTS[usize::from(point)]));
        let (position, normal) = evaluate(&control, 8, 8);
        assert!(normal.x * position.x + normal.y * position.y > 0.0);
    }

    #[test]
    fn only_the_rims_of_spout_and_handle_and_lid_are_open() {
        // Each open border is one of: the rim's inside, the spout's mouth, where spout and handle enter the body, and the
        // lid's rim. Everything else must meet its neighbour to the bit.
        let data = tessellate();
        let mut edges: HashMap<[[u32; 3]; 2], u32> = HashMap::new();
        let key = |vertex: u32| data.positions[vertex as usize].map(|x| (x + 0.0).to_bits());
        for [a, b, c] in &data.indices {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                let mut edge = [key(*from), key(*to)];
                edge.sort_unstable();
                *edges.entry(edge).or_default() += 1;
            }
        }
        let open = edges.values().filter(|&&count| count == 1).count() as u32;
        // Rim 4, spout 2 + 2, handle 2 + 2, lid 4 borders of patches.
        assert_eq!(open, 16 * SEGMENTS);
    }
}
