//! Compressed wide BVHs (Ylitie, Karras and Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide
//! BVHs", HPG 2017), built by obvhs.

use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::bvh2::{Bvh2, node::Bvh2Node};
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::cwbvh::node::CwBvhNode;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

/// The deepest binary tree that is handed to the converter, which recurses once a level; past it the tree is rebuilt
/// balanced.
const MAX_BINARY_DEPTH: usize = 96;

/// So many boxes or fewer are worth the best tree even if it is to last for a single frame.
const FEW: usize = 128;

/// The deepest wide tree that comes out of [`Bvh::build`]. A walker puts at most one group a level on its stack, and two
/// where it goes from the top level into a mesh: 2 × 22 + 2 places are enough.
pub const MAX_DEPTH: usize = 22;

/// A compressed wide BVH over boxes numbered from 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bvh {
    /// obvhs's nodes, the root first; empty over nothing.
    pub nodes: Vec<CwBvhNode>,
    /// A leaf's primitive number → the box's number.
    pub order: Vec<u32>,
}

impl Bvh {
    /// Builds over `boxes` (finite, min ≤ max) by the medium preset of obvhs with its search distance kept at every
    /// depth, which MEASURED.md found 2.3 times faster to walk, and without splitting primitives.
    ///
    /// The crate's quantisation rounds in f32, so every box is first padded by more than that rounding can lose; see
    /// `padding`.
    pub fn build(boxes: &[Aabb]) -> Self {
        Self::build_with(boxes, PlocSearchDistance::Medium, true)
    }

    /// As [`Bvh::build`], for a top level, which is built anew with every move: where there are many boxes, without the
    /// optimiser, which takes most of the time and gains least on a tree of a few levels.
    pub fn build_top(boxes: &[Aabb]) -> Self {
        if boxes.len() <= FEW { Self::build(boxes) } else { Self::build_with(boxes, PlocSearchDistance::Low, false) }
    }

    fn build_with(boxes: &[Aabb], distance: PlocSearchDistance, optimise: bool) -> Self {
        if boxes.is_empty() {
            return Self::default();
        }
        let padded = padded(boxes);
        let indices = (0..padded.len() as u32).collect();
        let mut binary =
            PlocBuilder::with_capacity(padded.len()).build(distance, &padded, indices, SortPrecision::U64, 0);

        // Nested or degenerate boxes can make a list of a tree; reinsertion and conversion both walk it by recursion.
        if depth_of_binary(&binary) <= MAX_BINARY_DEPTH {
            if optimise {
                ReinsertionOptimizer::default().run(&mut binary, 0.05, None);
            }
            if depth_of_binary(&binary) <= MAX_BINARY_DEPTH {
                let wide = Self::from_binary(&binary);
                if wide.depth() <= MAX_DEPTH {
                    return wide;
                }
            }
        }
        Self::from_binary(&balanced(&padded))
    }

    fn from_binary(binary: &Bvh2) -> Self {
        let wide = bvh2_to_cwbvh(binary, 3, true, false);
        Self { nodes: wide.nodes, order: wide.primitive_indices }
    }

    /// Nodes on the longest way from the root down; 0 when empty.
    pub fn depth(&self) -> usize {
        let mut deepest = 0;
        let mut open = if self.nodes.is_empty() { vec![] } else { vec![(0usize, 1usize)] };
        while let Some((index, depth)) = open.pop() {
            deepest = deepest.max(depth);
            let node = &self.nodes[index];
            for child in 0..8 {
                if !node.is_child_empty(child) && !node.is_leaf(child) {
                    open.push((node.child_node_index(child) as usize, depth + 1));
                }
            }
        }
        deepest
    }

    /// The nodes as the GPU reads them: five `uvec4` each.
    pub fn packed(&self) -> &[[u32; 4]] {
        bytemuck::cast_slice(&self.nodes)
    }

    /// Walks every leaf that the ray may meet in [`t_min`, `*t_max`]; `visit(primitive, t_max)` may lower `t_max`.
    /// Boxes are decoded and met in f64, so a box that holds a hit is never lost.
    pub fn walk(&self, ray: &BoxRay, t_max: &mut f64, mut visit: impl FnMut(usize, &mut f64)) {
        let mut open: Vec<(f64, usize)> = Vec::with_capacity(64);
        if !self.nodes.is_empty() {
            open.push((ray.t_min, 0));
        }
        while let Some((entry, index)) = open.pop() {
            if entry > *t_max {
                continue;
            }
            let node = &self.nodes[index];
            let first_pushed = open.len();
            for child in 0..8 {
                if node.is_child_empty(child) {
                    continue;
                }
                let (min, max) = child_box(node, child);
                let Some(entry) = ray.entry(min, max, *t_max) else { continue };
                if node.is_leaf(child) {
                    let (first, count) = node.child_primitives(child);
                    for primitive in first..first + count {
                        visit(primitive as usize, t_max);
                    }
                } else {
                    open.push((entry, node.child_node_index(child) as usize));
                }
            }
            // The nearest child goes on top of the stack.
            open[first_pushed..].sort_by(|a, b| b.0.total_cmp(&a.0));
        }
    }
}

/// A ray prepared for boxes.
#[derive(Clone, Copy, Debug)]
pub struct BoxRay {
    origin: DVec3,
    inverse_direction: DVec3,
    t_min: f64,
}

impl BoxRay {
    /// A ray from `origin` along `direction` (any length but zero), from parameter `t_min` on.
    pub fn new(origin: DVec3, direction: DVec3, t_min: f64) -> Self {
        Self { origin, inverse_direction: direction.recip(), t_min }
    }

    /// Where the ray enters the box, if it meets it before `t_max`.
    fn entry(&self, min: DVec3, max: DVec3, t_max: f64) -> Option<f64> {
        let to_min = (min - self.origin) * self.inverse_direction;
        let to_max = (max - self.origin) * self.inverse_direction;
        let (mut enter, mut leave) = (self.t_min, t_max);
        for axis in 0..3 {
            // 0 × ∞ is NaN where the ray runs inside a face; f64::min and max then keep the other operand.
            enter = enter.max(to_min[axis].min(to_max[axis]));
            leave = leave.min(to_min[axis].max(to_max[axis]));
        }
        // Each slab is off by at most a few roundings; the slack covers them.
        (enter <= leave + leave.abs() * 1e-12).then_some(enter)
    }
}

/// The box of a child as the walker decodes it.
pub(crate) fn child_box(node: &CwBvhNode, child: usize) -> (DVec3, DVec3) {
    let origin = node.p.as_dvec3();
    let step = DVec3::from_array(node.e.map(|e| f64::from(f32::from_bits(u32::from(e) << 23))));
    let min = [node.child_min_x[child], node.child_min_y[child], node.child_min_z[child]];
    let max = [node.child_max_x[child], node.child_max_y[child], node.child_max_z[child]];
    (origin + step * DVec3::from_array(min.map(f64::from)), origin + step * DVec3::from_array(max.map(f64::from)))
}

/// The boxes as a structure holds them.
pub(crate) fn padded(boxes: &[Aabb]) -> Vec<Aabb> {
    let pad = padding(boxes);
    boxes.iter().map(|b| Aabb::new(b.min - pad, b.max + pad)).collect()
}

/// What every box grows by on each side.
///
/// The converter takes differences of corners in f32 (an error of half an ulp of the largest coordinate) and picks each
/// node's grid step through an f32 `log2`, which can fall short of the extent by 2⁻²⁰ of it. 2⁻²² of the coordinate and
/// 2⁻¹⁹ of the extent are above both.
fn padding(boxes: &[Aabb]) -> Vec3A {
    let total = boxes.iter().fold(Aabb::empty(), |total, b| total.union(b));
    let reach = total.min.abs().max(total.max.abs());
    reach * 2f32.powi(-22) + (total.max - total.min) * 2f32.powi(-19) + Vec3A::splat(1e-12)
}

fn depth_of_binary(bvh: &Bvh2) -> usize {
    let mut deepest = 0;
    let mut open = vec![(0usize, 1usize)];
    while let Some((index, depth)) = open.pop() {
        deepest = deepest.max(depth);
        let node = &bvh.nodes[index];
        if !node.is_leaf() {
            open.push((node.first_index as usize, depth + 1));
            open.push((node.first_index as usize + 1, depth + 1));
        }
    }
    deepest
}

/// A binary tree halved at the median of the longest axis of the centres: never deeper than log₂ of the count, rounded
/// up, plus one.
fn balanced(boxes: &[Aabb]) -> Bvh2 {
    let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
    let bounds = |range: &[u32]| range.iter().fold(Aabb::empty(), |total, &i| total.union(&boxes[i as usize]));
    let mut nodes = vec![Bvh2Node::new(bounds(&order), 0, 0)];
    let mut open = vec![(0usize, 0usize, boxes.len())];
    while let Some((index, first, last)) = open.pop() {
        if last - first == 1 {
            nodes[index].prim_count = 1;
            nodes[index].first_index = first as u32;
            continue;
        }
        let centres = order[first..last].iter().fold(Aabb::empty(), |total, &i| {
            let centre = boxes[i as usize].center();
            total.union(&Aabb::from_point(centre))
        });
        let axis = centres.diagonal().to_array();
        let axis = (0..3).fold(0, |longest, a| if axis[a] > axis[longest] { a } else { longest });
        let middle = (last - first) / 2;
        order[first..last].select_nth_unstable_by(middle, |&a, &b| {
            boxes[a as usize].center()[axis].total_cmp(&boxes[b as usize].center()[axis])
        });
        let middle = first + middle;
        let left = nodes.len();
        nodes[index].first_index = left as u32;
        nodes.push(Bvh2Node::new(bounds(&order[first..middle]), 0, 0));
        nodes.push(Bvh2Node::new(bounds(&order[middle..last]), 0, 0));
        open.push((left, first, middle));
        open.push((left + 1, middle, last));
    }
    Bvh2 { nodes, primitive_indices: order, ..Bvh2::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cube(centre: [f32; 3], half: f32) -> Aabb {
        Aabb::new(Vec3A::from(centre) - half, Vec3A::from(centre) + half)
    }

    fn verify_invariants(bvh: &Bvh, boxes: &[Aabb]) {
        assert_eq!(crate::soundness::check(bvh, boxes), Ok(()));
    }

    #[test]
    fn nothing_one_and_coincident_boxes_build() {
        assert_eq!(Bvh::build(&[]), Bvh::default());
        for count in [1, 2, 3, 4, 9, 500] {
            let boxes = vec![cube([1.0, 2.0, 3.0], 0.0); count];
            verify_invariants(&Bvh::build(&boxes), &boxes);
        }
    }

    #[test]
    fn nested_boxes_that_make_a_list_of_a_tree_stay_shallow() {
        let boxes: Vec<Aabb> = (0..3000).map(|i| cube([0.0; 3], 1.01f32.powi(i) * 1e-9)).collect();
        let bvh = Bvh::build(&boxes);
        verify_invariants(&bvh, &boxes);
    }

    #[test]
    fn a_million_boxes_balanced_stay_within_the_depth() {
        let boxes: Vec<Aabb> = (0..1 << 20).map(|i| cube([0.0; 3], (i as f32 + 1.0) * 1e-3)).collect();
        assert!(Bvh::from_binary(&balanced(&boxes)).depth() <= MAX_DEPTH);
    }

    #[test]
    fn the_balanced_tree_holds_every_box_once() {
        let boxes: Vec<Aabb> = (0..1000).map(|i| cube([i as f32, 0.0, 0.0], 0.3)).collect();
        let bvh = Bvh::from_binary(&balanced(&boxes));
        let mut order = bvh.order.clone();
        order.sort_unstable();
        assert_eq!(order, (0..1000).collect::<Vec<_>>());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn boxes_lie_inside_their_nodes(
            centres in prop::collection::vec((prop::array::uniform3(-1e4f32..1e4), 0f32..10.0), 1..200),
            scale in -12i32..6,
        ) {
            let scale = 10f32.powi(scale);
            let boxes: Vec<Aabb> = centres.iter().map(|(c, half)| cube(c.map(|x| x * scale), half * scale)).collect();
            verify_invariants(&Bvh::build(&boxes), &boxes);
        }
    }
}
