//! A mesh as the GPU reads it, in parts: made when it is uploaded, so that the host keeps no second copy of it.

use std::ops::Range;

use glam::Vec3;

use crate::looks::texel;
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
    /// One `uvec4` a triangle: the mesh's own numbers of its three vertices' looks, and its material's. One texel, hence one load.
    Indices,
    /// One `uvec4` a look, which neighbouring vertices share that have the same: normal (octahedral, two snorm16, x in the low half), u, v (f32 bits), 0.
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
            MeshPart::Vertices => self.looks.count(self.normals.len()),
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
                let look = |vertex: u32| self.looks.of(vertex);
                rows.map(|(t, material)| [look(t[0]), look(t[1]), look(t[2]), *material]).collect()
            }
            MeshPart::Vertices => {
                let vertices = elements.map(|look| self.looks.vertex(look));
                vertices.map(|vertex| texel(self.normals[vertex], self.uvs[vertex])).collect()
            }
        }
    }

    fn triangle_texels(&self, triangle: &[u32; 3]) -> [[u32; 4]; 3] {
        let [a, b, c] = triangle.map(|vertex| Vec3::from(self.positions[vertex as usize]));
        [a, b - a, c - a].map(|v| v.extend(0.0).to_array().map(f32::to_bits))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::MeshData;

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
