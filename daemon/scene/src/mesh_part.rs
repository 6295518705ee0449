//! A mesh as the GPU reads it, in parts: made when it is uploaded, so that the host keeps no second copy of it.

use std::ops::Range;

use glam::Vec3;

use crate::mesh::Mesh;

/// One of the buffers that a mesh has a share of. Texels are 16 bytes; an element is what shaders count by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshPart {
    /// CWBVH nodes, five `uvec4` each (`CwBvhNode`'s 80 bytes as they are); child and primitive numbers are the mesh's own,
    /// from 0.
    Nodes,
    /// Three `vec4` a triangle, object space, m, 0 in w: corner 0; corner 1 − corner 0; corner 2 − corner 0. Triangles are in
    /// the order of the structure's leaves, so a leaf's primitive number is a triangle's.
    Triangles,
    /// One `uvec4` a triangle: the mesh's own numbers of its three vertices, and its material's. One texel, hence one load.
    Indices,
    /// One `uvec4` a vertex: normal (octahedral, two snorm16, x in the low half), u, v (f32 bits), 0.
    Vertices,
}

impl MeshPart {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Nodes, Self::Triangles, Self::Indices, Self::Vertices];

    /// Texels of an element.
    pub const fn texels(self) -> usize {
        match self {
            Self::Nodes => 5,
            Self::Triangles => 3,
            Self::Indices | Self::Vertices => 1,
        }
    }
}

impl Mesh {
    /// How many elements a part has.
    pub fn elements(&self, part: MeshPart) -> usize {
        match part {
            MeshPart::Nodes => self.bvh.nodes.len(),
            MeshPart::Triangles | MeshPart::Indices => self.indices.len(),
            MeshPart::Vertices => self.normals.len(),
        }
    }

    /// Bytes of all parts.
    pub fn device_bytes(&self) -> u64 {
        MeshPart::ALL.into_iter().map(|part| (self.elements(part) * part.texels() * 16) as u64).sum()
    }

    /// The texels of a range of a part's elements, which must lie inside it.
    pub fn pack(&self, part: MeshPart, elements: Range<usize>) -> Vec<[u32; 4]> {
        match part {
            MeshPart::Nodes => self.bvh.packed()[5 * elements.start..5 * elements.end].to_vec(),
            MeshPart::Triangles => self.indices[elements].iter().flat_map(|t| self.triangle_texels(t)).collect(),
            MeshPart::Indices => {
                let rows = self.indices[elements.clone()].iter().zip(&self.materials[elements]);
                rows.map(|(t, material)| [t[0], t[1], t[2], *material]).collect()
            }
            MeshPart::Vertices => {
                let rows = self.normals[elements.clone()].iter().zip(&self.uvs[elements]);
                rows.map(|(normal, uv)| [octahedral(*normal), uv[0].to_bits(), uv[1].to_bits(), 0]).collect()
            }
        }
    }

    fn triangle_texels(&self, triangle: &[u32; 3]) -> [[u32; 4]; 3] {
        let [a, b, c] = triangle.map(|vertex| Vec3::from(self.positions[vertex as usize]));
        [a, b - a, c - a].map(|v| v.extend(0.0).to_array().map(f32::to_bits))
    }
}

/// A unit vector as two snorm16 (x in the low half) on the octahedron |x| + |y| + |z| = 1 unfolded about +Z: Cigolle et
/// al., "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 2014.
pub fn octahedral(normal: [f32; 3]) -> u32 {
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
    use super::*;
    use crate::mesh::MeshData;
    use proptest::prelude::*;

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
    fn a_part_is_the_same_in_pieces_as_whole() {
        let positions: Vec<[f32; 3]> = (0..42).map(|i| [i as f32 * 0.5, (i % 2) as f32, (i % 7) as f32]).collect();
        let mesh = Mesh::new(MeshData {
            normals: vec![[0.0; 3]; 42],
            uvs: (0..42).map(|i| [i as f32, 0.5]).collect(),
            indices: (0..40).map(|i| [i, i + 1, i + 2]).collect(),
            materials: (0..40).map(|i| i % 3).collect(),
            positions,
        });
        for part in MeshPart::ALL {
            let count = mesh.elements(part);
            let whole = mesh.pack(part, 0..count);
            assert_eq!(whole.len(), count * part.texels(), "{part:?}");
            let pieces: Vec<_> = (0..count).step_by(7).flat_map(|i| mesh.pack(part, i..(i + 7).min(count))).collect();
            assert_eq!(whole, pieces, "{part:?}");
        }
        let corner = |texel: [u32; 4]| Vec3::from_slice(&texel.map(f32::from_bits));
        for (triangle, texels) in mesh.indices.iter().zip(mesh.pack(MeshPart::Triangles, 0..40).chunks_exact(3)) {
            let first = corner(texels[0]);
            assert_eq!(first.to_array(), mesh.positions[triangle[0] as usize]);
            assert_eq!((first + corner(texels[2])).to_array(), mesh.positions[triangle[2] as usize]);
        }
    }
}
