//! New boxes for a structure whose primitives have moved: from the leaves up, each node's grid is laid anew.
//!
//! obvhs refits binary trees alone, and converting one again costs most of a build (MEASURED.md), so this is ours. Which
//! primitives share a leaf stays, and so does their order.

use glam::{DVec3, Vec3};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::node::CwBvhNode;

use crate::bvh::{Bvh, child_box, padded};

impl Bvh {
    /// The same tree over boxes that took the place of those that it was built over, padded as those were.
    pub fn refitted(&self, boxes: &[Aabb]) -> Self {
        let padded = padded(boxes);
        let mut refitted = self.clone();
        // obvhs puts children behind their parents, so that backwards every child's box is known before its parent's. A tree
        // that came from elsewhere need not keep to that, hence the list.
        let mut from_the_root = if self.nodes.is_empty() { vec![] } else { vec![0usize] };
        let mut next = 0;
        while let Some(node) = from_the_root.get(next).map(|&index| self.nodes[index]) {
            from_the_root.extend(inner_children(&node).map(|(_, below)| below));
            next += 1;
        }
        let mut box_of = vec![Aabb::empty(); self.nodes.len()];
        for &index in from_the_root.iter().rev() {
            let node = &mut refitted.nodes[index];
            let children: [Aabb; 8] = std::array::from_fn(|child| {
                if node.is_child_empty(child) {
                    Aabb::empty()
                } else if node.is_leaf(child) {
                    let (first, count) = node.child_primitives(child);
                    let numbers = &self.order[first as usize..(first + count) as usize];
                    numbers.iter().fold(Aabb::empty(), |all, &number| all.union(&padded[number as usize]))
                } else {
                    box_of[node.child_node_index(child) as usize]
                }
            });
            box_of[index] = children.iter().fold(Aabb::empty(), |all, child| all.union(child));
            lay_grid(node, &box_of[index], &children);
        }
        refitted
    }

    /// What a ray that meets the root pays on average, in boxes of the root's size: the areas of all boxes in the tree over the
    /// root's (the surface area heuristic without its constants). 0 for an empty one.
    pub fn cost(&self) -> f64 {
        let area = |(min, max): (DVec3, DVec3)| {
            let d = max - min;
            d.x * d.y + d.y * d.z + d.z * d.x
        };
        let boxes = |node: &CwBvhNode| {
            let children = (0..8).filter(|&child| !node.is_child_empty(child));
            children.map(|child| child_box(node, child)).collect::<Vec<_>>()
        };
        let Some(root) = self.nodes.first() else { return 0.0 };
        let whole = boxes(root).into_iter().reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).map_or(0.0, area);
        let all: f64 = self.nodes.iter().flat_map(boxes).map(area).sum();
        if whole > 0.0 { all / whole } else { self.nodes.len() as f64 }
    }
}

fn inner_children(node: &CwBvhNode) -> impl Iterator<Item = (usize, usize)> {
    let inner = (0..8).filter(|&child| !node.is_child_empty(child) && !node.is_leaf(child));
    inner.map(|child| (child, node.child_node_index(child) as usize))
}

/// Writes a node's origin and steps, and its children's boxes on that grid, rounded outward. Decoding is exact in f64 but for
/// the last place, which the boxes' padding covers many times over.
fn lay_grid(node: &mut CwBvhNode, whole: &Aabb, children: &[Aabb; 8]) {
    node.p = Vec3::from(whole.min);
    let (low, extent) = (whole.min.as_dvec3(), whole.max.as_dvec3() - whole.min.as_dvec3());
    let mut steps = [0.0; 3];
    for axis in 0..3 {
        // The smallest power of two of which 255 reach across, no smaller than f32 has.
        let exponent = (extent[axis] / 255.0).log2().ceil().max(-126.0);
        let reaches = |exponent: f64| 255.0 * exponent.exp2() >= extent[axis];
        let exponent = if reaches(exponent) { exponent } else { exponent + 1.0 };
        node.e[axis] = (exponent + 127.0) as u8;
        steps[axis] = exponent.exp2();
    }
    let grid = |value: f64, axis: usize| (value - low[axis]) / steps[axis];
    let planes = [
        (&mut node.child_min_x, &mut node.child_max_x),
        (&mut node.child_min_y, &mut node.child_max_y),
        (&mut node.child_min_z, &mut node.child_max_z),
    ];
    for (axis, (mins, maxs)) in planes.into_iter().enumerate() {
        for (child, held) in children.iter().enumerate() {
            let empty = held.min.x > held.max.x;
            mins[child] = if empty { 0 } else { grid(f64::from(held.min[axis]), axis).floor() as u8 };
            maxs[child] = if empty { 0 } else { grid(f64::from(held.max[axis]), axis).ceil() as u8 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::soundness;
    use glam::Vec3A;
    use proptest::prelude::*;

    type Box3 = ([f32; 3], f32);

    fn boxes(of: &[(Box3, Box3)], which: fn(&(Box3, Box3)) -> Box3, scale: f32) -> Vec<Aabb> {
        let one = |(centre, half): Box3| {
            let centre = Vec3A::from(centre) * scale;
            Aabb::new(centre - half * scale, centre + half * scale)
        };
        of.iter().map(which).map(one).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn moved_boxes_lie_inside_their_nodes_again(
            pairs in prop::collection::vec({
                let one = || (prop::array::uniform3(-1e4f32..1e4), 0f32..10.0);
                (one(), one())
            }, 1..200),
            scale in -12i32..6,
        ) {
            let (before, after) = (boxes(&pairs, |p| p.0, 1.0), boxes(&pairs, |p| p.1, 10f32.powi(scale)));
            let bvh = Bvh::build(&before);
            let refitted = bvh.refitted(&after);
            prop_assert_eq!(soundness::check(&refitted, &after), Ok(()));
            prop_assert_eq!(&refitted.order, &bvh.order);
        }
    }

    #[test]
    fn what_has_not_moved_costs_what_it_did() {
        let at = |i: u32| Vec3A::new((i % 40) as f32, (i / 40) as f32, ((i * 7) % 5) as f32);
        let boxes: Vec<Aabb> = (0..1600).map(|i| Aabb::new(at(i), at(i) + 1.0)).collect();
        let bvh = Bvh::build(&boxes);
        let same = bvh.refitted(&boxes);
        assert!((same.cost() / bvh.cost() - 1.0).abs() < 0.02, "{} and {}", same.cost(), bvh.cost());
        // Where neighbours part, every box is large.
        let scattered: Vec<Aabb> = (0..1600).map(|i| boxes[(i * 997) % 1600]).collect();
        assert!(bvh.refitted(&scattered).cost() > 2.0 * bvh.cost());
        assert_eq!(Bvh::default().refitted(&[]), Bvh::default());
        assert_eq!(Bvh::default().cost(), 0.0);
    }
}
