//! A plain acceleration structure: boxes split at the median of the longest axis.

use glam::DVec3;

use super::geometry::{Meeting, Ray, Tri};

const LEAF_TRIANGLES: usize = 4;

#[derive(Clone, Copy, Debug)]
struct Node {
    min: DVec3,
    max: DVec3,
    /// Of a leaf: its first triangle. Of an inner node: its second child; the first one follows it.
    first: u32,
    /// 0 for an inner node.
    count: u32,
}

/// Triangles in the order of the tree's leaves.
#[derive(Clone, Debug, Default)]
pub struct Bvh {
    nodes: Vec<Node>,
    triangles: Vec<Tri>,
}

impl Bvh {
    /// Builds over triangles in any order.
    pub fn new(mut triangles: Vec<Tri>) -> Self {
        let mut nodes = Vec::new();
        if !triangles.is_empty() {
            build(&mut nodes, &mut triangles, 0);
        }
        Self { nodes, triangles }
    }

    /// All triangles.
    pub fn triangles(&self) -> &[Tri] {
        &self.triangles
    }

    /// The closest meeting among the triangles that `counts` accepts.
    pub fn closest(&self, ray: &Ray, counts: impl Fn(&Tri) -> bool) -> Option<(Tri, Meeting)> {
        let mut ray = *ray;
        let mut found = None;
        self.walk(&mut ray, |triangle, ray| {
            if let Some(meeting) = triangle.meet(ray).filter(|_| counts(triangle)) {
                ray.t_max_m = meeting.t_m;
                found = Some((*triangle, meeting));
            }
            true
        });
        found
    }

    /// Every meeting, in no order, until `each` returns false.
    pub fn each(&self, ray: &Ray, mut each: impl FnMut(&Tri, Meeting) -> bool) {
        self.walk(&mut ray.clone(), |triangle, ray| triangle.meet(ray).is_none_or(|meeting| each(triangle, meeting)));
    }

    /// Visits the triangles of all leaves that the ray enters; `visit` may shorten the ray, and ends the walk by false.
    fn walk(&self, ray: &mut Ray, mut visit: impl FnMut(&Tri, &mut Ray) -> bool) {
        let reciprocal = ray.direction.recip();
        let mut waiting: Vec<usize> = if self.nodes.is_empty() { Vec::new() } else { vec![0] };
        while let Some(at) = waiting.pop() {
            let node = &self.nodes[at];
            if !enters(node, ray, reciprocal) {
                continue;
            }
            if node.count == 0 {
                waiting.extend([node.first as usize, at + 1]);
                continue;
            }
            let first = node.first as usize;
            for triangle in &self.triangles[first..first + node.count as usize] {
                if !visit(triangle, ray) {
                    return;
                }
            }
        }
    }
}

/// Slabs (Kay and Kajiya, SIGGRAPH 1986), with room for rounding on the far side: Ize, JCGT 2(2), 2013.
fn enters(node: &Node, ray: &Ray, reciprocal: DVec3) -> bool {
    let (mut enter, mut leave) = (0.0f64, ray.t_max_m);
    for axis in 0..3 {
        let a = (node.min[axis] - ray.origin_m[axis]) * reciprocal[axis];
        let b = (node.max[axis] - ray.origin_m[axis]) * reciprocal[axis];
        // A ray inside of a slab's very plane gives 0 × ∞; f64's min and max pass over the NaN, which keeps the box.
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b) * (1.0 + 4.0 * f64::EPSILON));
    }
    enter <= leave
}

fn build(nodes: &mut Vec<Node>, triangles: &mut [Tri], first: usize) {
    let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (min, max) = triangles.iter().map(Tri::bounds).fold(empty, |a, b| (a.0.min(b.0), a.1.max(b.1)));
    let at = nodes.len();
    nodes.push(Node { min, max, first: first as u32, count: triangles.len() as u32 });
    if triangles.len() <= LEAF_TRIANGLES {
        return;
    }

    // Half of the triangles on either side, by the middle of their box along the longest axis.
    let axis = (max - min).max_position();
    let middle = triangles.len() / 2;
    let key = |triangle: &Tri| {
        let (min, max) = triangle.bounds();
        min[axis] + max[axis]
    };
    triangles.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)));
    let (left, right) = triangles.split_at_mut(middle);
    build(nodes, left, first);
    nodes[at].count = 0;
    nodes[at].first = nodes.len() as u32;
    build(nodes, right, first + middle);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::SplitMix64;

    #[test]
    fn it_finds_what_trying_every_triangle_finds() {
        let mut random = SplitMix64(7);
        let mut vector = |size: f64| DVec3::from_array(std::array::from_fn(|_| (random.unit() * 2.0 - 1.0) * size));
        let triangles: Vec<Tri> = (0..3000)
            .map(|triangle| {
                let middle = vector(1.0);
                Tri { corners_m: std::array::from_fn(|_| middle + vector(0.1)), instance: triangle % 3, triangle }
            })
            .collect();
        let bvh = Bvh::new(triangles.clone());
        let mut hits = 0;
        for i in 0..2000 {
            // Some rays run along an axis, where a slab's reciprocal is infinite.
            let mut direction = vector(1.0).normalize();
            if i % 4 == 0 {
                direction = [DVec3::X, DVec3::NEG_Y, DVec3::Z][i / 4 % 3];
            }
            let ray = Ray::new(vector(1.5), direction);
            let counts = |triangle: &Tri| triangle.instance != 1;
            let expected = triangles
                .iter()
                .filter(|triangle| counts(triangle))
                .filter_map(|triangle| triangle.meet(&ray).map(|meeting| (triangle.triangle, meeting.t_m)))
                .min_by(|a, b| a.1.total_cmp(&b.1));
            let found = bvh.closest(&ray, counts).map(|(triangle, meeting)| (triangle.triangle, meeting.t_m));
            assert_eq!(found, expected);
            hits += usize::from(found.is_some());

            let mut all = 0;
            bvh.each(&ray, |_, _| {
                all += 1;
                true
            });
            assert_eq!(all, triangles.iter().filter(|triangle| triangle.meet(&ray).is_some()).count());
        }
        assert!(hits > 400, "{hits}");
    }
}
