//! What a mesh's vertices look like to shaders, which know triangles' corners from elsewhere: normals and texture coordinates. Neighbours
//! that look the same share one: of a mesh without normals, whose triangles each have three vertices of their own, one a triangle is left.

/// Which of a mesh's vertices look the same.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Looks {
    /// Of each vertex the number of its look, and of each look the first vertex that has it. Empty where no neighbours share any.
    of_vertex: Vec<u32>,
    vertex_of: Vec<u32>,
}

impl Looks {
    /// Of vertices with these normals and texture coordinates.
    pub(crate) fn new(normals: &[[f32; 3]], uvs: &[[f32; 2]]) -> Self {
        let mut looks = Self { of_vertex: Vec::with_capacity(normals.len()), vertex_of: Vec::new() };
        let mut last = None;
        for (vertex, (normal, uv)) in (0..).zip(normals.iter().zip(uvs)) {
            let look = Some(texel(*normal, *uv));
            if look != last {
                looks.vertex_of.push(vertex);
            }
            last = look;
            looks.of_vertex.push(looks.vertex_of.len() as u32 - 1);
        }
        if looks.vertex_of.len() == normals.len() { Self::default() } else { looks }
    }

    /// How many there are for so many vertices.
    pub(crate) fn count(&self, vertices: usize) -> usize {
        if self.of_vertex.is_empty() { vertices } else { self.vertex_of.len() }
    }

    /// A vertex's look.
    pub(crate) fn of(&self, vertex: u32) -> u32 {
        self.of_vertex.get(vertex as usize).copied().unwrap_or(vertex)
    }

    /// A vertex that has a look.
    pub(crate) fn vertex(&self, look: usize) -> usize {
        self.vertex_of.get(look).map_or(look, |vertex| *vertex as usize)
    }
}

/// A look as shaders read it: normal (octahedral, two snorm16, x in the low half), u, v (f32 bits), 0.
pub(crate) fn texel(normal: [f32; 3], [u, v]: [f32; 2]) -> [u32; 4] {
    [octahedral(normal), u.to_bits(), v.to_bits(), 0]
}

/// A unit vector as two snorm16 (x in the low half) on the octahedron |x| + |y| + |z| = 1 unfolded about +Z: Cigolle et
/// al., "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 2014.
fn octahedral(normal: [f32; 3]) -> u32 {
    let [x, y, z] = normal;
    let sum = x.abs() + y.abs() + z.abs();
    let (mut px, mut py) = (x / sum, y / sum);
    if z < 0.0 {
        (px, py) = ((1.0 - py.abs()).copysign(px), (1.0 - px.abs()).copysign(py));
    }
    let snorm = |v: f32| u32::from((v.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16);
    snorm(px) | snorm(py) << 16
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use proptest::prelude::*;

    use super::*;

    /// The decoder as a shader writes it.
    fn from_octahedral(packed: u32) -> Vec3 {
        let snorm = |half: u32| f32::from(half as u16 as i16) / 32767.0;
        let (x, y) = (snorm(packed & 0xffff), snorm(packed >> 16));
        let mut v = Vec3::new(x, y, 1.0 - x.abs() - y.abs());
        let t = (-v.z).max(0.0);
        v.x -= t.copysign(v.x);
        v.y -= t.copysign(v.y);
        v.normalize()
    }

    proptest! {
        #[test]
        fn packed_normals_point_where_they_did(v in prop::array::uniform3(-1f32..1.0)) {
            prop_assume!(Vec3::from(v).length() > 1e-3);
            let normal = Vec3::from(v).normalize();
            let error_rad = from_octahedral(octahedral(normal.to_array())).angle_between(normal);
            prop_assert!(error_rad < 1e-3, "{normal} off by {error_rad}");
        }
    }

    #[test]
    fn the_axes_survive_packing_exactly() {
        for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
            for axis in [axis, -axis] {
                assert!((from_octahedral(octahedral(axis.to_array())) - axis).length() < 1e-6);
            }
        }
    }

    #[test]
    fn neighbours_that_look_the_same_share_a_look() {
        let (x, y) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        let flat = Looks::new(&[x, x, x, y, y, y, x], &[[0.0; 2]; 7]);
        assert_eq!(flat.count(7), 3);
        assert_eq!([0, 1, 2, 3, 4, 5, 6].map(|vertex| flat.of(vertex)), [0, 0, 0, 1, 1, 1, 2]);
        assert_eq!([0, 1, 2].map(|look| flat.vertex(look)), [0, 3, 6]);

        // Texture coordinates tell them apart; and then nothing is kept.
        let none = Looks::new(&[x; 3], &[[0.0, 0.0], [0.5, 0.0], [0.5, 1.0]]);
        assert_eq!(none, Looks::default());
        assert_eq!((none.count(3), none.of(2), none.vertex(1)), (3, 2, 1));
    }
}
