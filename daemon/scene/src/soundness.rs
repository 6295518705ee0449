//! Whether a structure may be walked and loses nothing: asked of every one that was read from a file.

use glam::DVec3;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::node::CwBvhNode;

use crate::bvh::{Bvh, MAX_DEPTH, child_box};

/// The first thing found wrong with a structure.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Flaw {
    #[error("node {0} is reached twice, or lies beyond the end")]
    Node(usize),
    #[error("node {0} is reached at a depth above {MAX_DEPTH}")]
    Depth(usize),
    #[error("node {0} has no finite box")]
    Box(usize),
    #[error("child {1} of node {0} is encoded as nothing that there is")]
    Child(usize, usize),
    #[error("a leaf of node {0} has a primitive that another one has, or that is beyond the end")]
    Primitive(usize),
    #[error("box {0} leaves the box of a node that holds it")]
    Outside(usize),
    #[error("there are nodes or primitives that nothing leads to")]
    Unreached,
}

/// Whether `bvh` holds every one of `boxes` once, inside of every node box on its way down (compared in f64), within
/// [`MAX_DEPTH`], and encodes nothing that a walker does not expect.
///
/// # Errors
/// The first [`Flaw`].
pub(crate) fn check(bvh: &Bvh, boxes: &[Aabb]) -> Result<(), Flaw> {
    if bvh.order.len() != boxes.len() || bvh.nodes.is_empty() != boxes.is_empty() {
        return Err(Flaw::Unreached);
    }
    let (mut nodes, mut slots, mut held) = (vec![false; bvh.nodes.len()], vec![false; boxes.len()], 0);
    let mut numbers = vec![false; boxes.len()];
    let everything = (DVec3::NEG_INFINITY, DVec3::INFINITY);
    let mut open = if bvh.nodes.is_empty() { vec![] } else { vec![(0, everything, 1)] };
    while let Some((index, (outer_min, outer_max), depth)) = open.pop() {
        if !nodes.get_mut(index).is_some_and(first_time) {
            return Err(Flaw::Node(index));
        }
        if depth > MAX_DEPTH {
            return Err(Flaw::Depth(index));
        }
        let node = &bvh.nodes[index];
        if !node.p.is_finite() || node.e.contains(&255) {
            return Err(Flaw::Box(index));
        }
        for child in 0..8 {
            let Some(kind) = kind(node, child).map_err(|()| Flaw::Child(index, child))? else { continue };
            let (min, max) = child_box(node, child);
            let (min, max) = (min.max(outer_min), max.min(outer_max));
            let (first, count) = match kind {
                Kind::Inner(below) => {
                    open.push((below, (min, max), depth + 1));
                    continue;
                }
                Kind::Leaf(first, count) => (first, count),
            };
            for slot in first..first + count {
                if !slots.get_mut(slot).is_some_and(first_time) {
                    return Err(Flaw::Primitive(index));
                }
                held += 1;
                let number = bvh.order[slot] as usize;
                if !numbers.get_mut(number).is_some_and(first_time) {
                    return Err(Flaw::Primitive(index));
                }
                let held = &boxes[number];
                if !(held.min.as_dvec3().cmpge(min).all() && held.max.as_dvec3().cmple(max).all()) {
                    return Err(Flaw::Outside(number));
                }
            }
        }
    }
    if held == boxes.len() && nodes.iter().all(|reached| *reached) { Ok(()) } else { Err(Flaw::Unreached) }
}

/// True the first time that it is asked of a mark.
fn first_time(mark: &mut bool) -> bool {
    !std::mem::replace(mark, true)
}

enum Kind {
    /// The number of the node below.
    Inner(usize),
    /// First slot, and how many.
    Leaf(usize, usize),
}

/// What a node says of a child; `None` for an empty place. What is encoded as obvhs never does it is an error.
fn kind(node: &CwBvhNode, child: usize) -> Result<Option<Kind>, ()> {
    let (meta, inner_bit) = (node.child_meta[child], node.imask & 1 << child);
    let low = usize::from(meta & 0b11111);
    match (meta >> 5, inner_bit != 0) {
        (0, false) if low == 0 => Ok(None),
        (0b001, true) if low == 24 + child => {
            let before = (node.imask & ((1 << child) - 1)).count_ones() as usize;
            Ok(Some(Kind::Inner(node.child_base_idx as usize + before)))
        }
        (unary @ (0b001 | 0b011 | 0b111), false) if low + unary.count_ones() as usize <= 24 => {
            Ok(Some(Kind::Leaf(node.primitive_base_idx as usize + low, unary.count_ones() as usize)))
        }
        _ => Err(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3A;
    use proptest::prelude::*;

    fn some_boxes() -> Vec<Aabb> {
        let at = |i: u32| Vec3A::new((i % 10) as f32, (i / 10) as f32 * 0.7, (i % 7) as f32);
        (0..200).map(|i| Aabb::new(at(i), at(i) + 0.4)).collect()
    }

    #[test]
    fn what_was_built_is_sound_and_of_these_boxes_alone() {
        let mut boxes = some_boxes();
        let bvh = Bvh::build(&boxes);
        assert_eq!(check(&bvh, &boxes), Ok(()));
        assert_eq!(check(&Bvh::default(), &[]), Ok(()));
        assert_eq!(check(&bvh, &boxes[1..]), Err(Flaw::Unreached));
        boxes[17].max.x += 1.0;
        assert_eq!(check(&bvh, &boxes), Err(Flaw::Outside(17)));
    }

    proptest! {
        /// Whatever is done to the bytes, what passes can be walked and holds every box.
        #[test]
        fn damage_is_found_or_does_no_harm(at in 0usize..1 << 20, bit in 0u8..8, in_order in any::<bool>()) {
            let boxes = some_boxes();
            let mut bvh = Bvh::build(&boxes);
            if in_order {
                let length = bvh.order.len();
                bvh.order[at % length] ^= 1 << bit;
                prop_assert!(check(&bvh, &boxes).is_err());
                return Ok(());
            }
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut bvh.nodes);
            let length = bytes.len();
            bytes[at % length] ^= 1 << bit;
            if check(&bvh, &boxes).is_ok() {
                prop_assert!(bvh.depth() <= MAX_DEPTH);
                for (number, held) in boxes.iter().enumerate() {
                    let centre = held.center().as_dvec3();
                    let ray = crate::bvh::BoxRay::new(centre - DVec3::Y * 1e-3, DVec3::Y, 0.0);
                    let (mut found, mut t_max) = (false, 2e-3);
                    bvh.walk(&ray, &mut t_max, |slot, _| found |= bvh.order[slot] as usize == number);
                    prop_assert!(found);
                }
            }
        }
    }
}
