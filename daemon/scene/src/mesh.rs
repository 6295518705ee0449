//! One mesh and the bottom-level structure over its triangles.

use glam::{DQuat, DVec2, DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;

use crate::bvh::Bvh;
use crate::looks::Looks;
use crate::structures::Structures;

/// The largest coordinate of a vertex, m: far beyond any room, and far inside what f32 squares and differences bear.
pub const MAX_COORDINATE_M: f32 = 1e9;

/// What a loader hands over: plain triangles, not yet in any order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshData {
    /// Object space, m; finite, at most [`MAX_COORDINATE_M`].
    pub positions: Vec<[f32; 3]>,
    /// One a vertex. Zero where the file has none worth having; [`Mesh::new`] then takes the triangles'.
    pub normals: Vec<[f32; 3]>,
    /// One a vertex.
    pub uvs: Vec<[f32; 2]>,
    /// Three vertex numbers a triangle, counter-clockwise from its front.
    pub indices: Vec<[u32; 3]>,
    /// A material number a triangle, in its asset's materials.
    pub materials: Vec<u32>,
}

impl MeshData {
    /// Appends `other` with its own vertices.
    pub fn append(&mut self, other: Self) {
        let base = self.positions.len() as u32;
        self.positions.extend(other.positions);
        self.normals.extend(other.normals);
        self.uvs.extend(other.uvs);
        self.indices.extend(other.indices.into_iter().map(|triangle| triangle.map(|vertex| vertex + base)));
        self.materials.extend(other.materials);
    }

    /// Adds a vertex.
    pub(crate) fn push_vertex(&mut self, position_m: DVec3, normal: DVec3, uv: DVec2) {
        self.positions.push(position_m.as_vec3().to_array());
        self.normals.push(normal.as_vec3().to_array());
        self.uvs.push(uv.as_vec2().to_array());
    }

    /// Adds a triangle of vertices that are there, or will be.
    pub(crate) fn push_triangle(&mut self, triangle: [u32; 3], material: u32) {
        self.indices.push(triangle);
        self.materials.push(material);
    }
}

/// An immutable mesh. Triangles stand in the order of the structure's leaves, so that a leaf's primitive number is the
/// triangle's.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    /// Object space, m.
    pub positions: Vec<[f32; 3]>,
    /// Unit length, one a vertex.
    pub normals: Vec<[f32; 3]>,
    /// One a vertex.
    pub uvs: Vec<[f32; 2]>,
    /// Three vertex numbers a triangle, in leaf order, counter-clockwise from its front.
    pub indices: Vec<[u32; 3]>,
    /// A material number a triangle; [`crate::Instance::material_base`] added, it indexes [`crate::Scene::materials`].
    pub materials: Vec<u32>,
    /// The material numbers that occur, ascending.
    pub used_materials: Vec<u32>,
    /// Over the triangles; `bvh.order` is the identity.
    pub bvh: Bvh,
    /// Corners of the box around all triangles, object space, m; `None` without triangles.
    pub bounds_m: Option<(DVec3, DVec3)>,
    /// Of the vertices.
    pub(crate) looks: Looks,
}

impl Mesh {
    /// Builds the structure and brings the triangles into its order. Vertex numbers must be in range and positions
    /// finite; the loaders see to both. A mesh may be empty, and triangles may be degenerate: nothing hits those.
    pub fn new(data: MeshData) -> Self {
        Self::with(data, &Structures::default())
    }

    /// As [`Mesh::new`], with the structure from where it may have been kept.
    pub(crate) fn with(data: MeshData, structures: &Structures) -> Self {
        let MeshData { positions, mut normals, uvs, indices, materials } = data;
        let boxes = boxes_of(&positions, &indices);
        let mut bvh = structures.over(&boxes);
        let indices: Vec<[u32; 3]> = bvh.order.iter().map(|&triangle| indices[triangle as usize]).collect();
        let materials: Vec<u32> = bvh.order.iter().map(|&triangle| materials[triangle as usize]).collect();
        bvh.order = (0..indices.len() as u32).collect();

        let mut used_materials = materials.clone();
        used_materials.sort_unstable();
        used_materials.dedup();

        let bounds_m = bounds_of(&boxes);
        repair_normals(&positions, &indices, &mut normals);
        let looks = Looks::new(&normals, &uvs);
        Self { positions, normals, uvs, indices, materials, used_materials, bvh, bounds_m, looks }
    }

    /// The same triangles with their vertices at new positions (as many, finite). The structure is refitted: as what it was
    /// built for becomes something else it gets slow to walk, and where its cost has doubled it is built anew.
    ///
    /// A normal that the file says (`has_normal`) turns as the mean normal of the triangles around its vertex does, so that
    /// smooth stays smooth and creases stay creases; another one is that of its triangles.
    pub(crate) fn moved(&self, positions: Vec<[f32; 3]>, has_normal: &[bool]) -> Self {
        let (before, after) = (mean_normals(&self.positions, &self.indices), mean_normals(&positions, &self.indices));
        let turned = |vertex: usize, normal: &[f32; 3]| match (before[vertex], after[vertex]) {
            (_, Some(after)) if !has_normal[vertex] => after.as_vec3().to_array(),
            (Some(before), Some(after)) if before != after => {
                let turn = DQuat::from_rotation_arc(before, after);
                (turn * Vec3::from(*normal).as_dvec3()).normalize_or(after).as_vec3().to_array()
            }
            _ => *normal,
        };
        let normals = self.normals.iter().enumerate().map(|(vertex, normal)| turned(vertex, normal)).collect();

        let boxes = boxes_of(&positions, &self.indices);
        let bvh = self.bvh.refitted(&boxes);
        if bvh.cost() > 2.0 * self.bvh.cost() {
            let (uvs, indices, materials) = (self.uvs.clone(), self.indices.clone(), self.materials.clone());
            return Self::new(MeshData { positions, normals, uvs, indices, materials });
        }
        let looks = Looks::new(&normals, &self.uvs);
        Self { positions, normals, bvh, bounds_m: bounds_of(&boxes), looks, ..self.clone() }
    }

    /// The corners of a triangle, object space, m.
    pub fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.indices[triangle].map(|vertex| Vec3::from(self.positions[vertex as usize]).as_dvec3())
    }
}

/// The box of every triangle.
fn boxes_of(positions: &[[f32; 3]], indices: &[[u32; 3]]) -> Vec<Aabb> {
    let corners = |triangle: &[u32; 3]| triangle.map(|vertex| Vec3A::from(positions[vertex as usize]));
    indices.iter().map(|triangle| Aabb::from_points(&corners(triangle))).collect()
}

fn bounds_of(boxes: &[Aabb]) -> Option<(DVec3, DVec3)> {
    let total = boxes.iter().copied().reduce(|a, b| a.union(&b));
    total.map(|total| (total.min.as_dvec3(), total.max.as_dvec3()))
}

/// For each vertex the area-weighted mean normal of its triangles, unit length; `None` where they have none.
fn mean_normals(positions: &[[f32; 3]], indices: &[[u32; 3]]) -> Vec<Option<DVec3>> {
    let mut sums = vec![DVec3::ZERO; positions.len()];
    for triangle in indices {
        let [a, b, c] = triangle.map(|vertex| Vec3::from(positions[vertex as usize]).as_dvec3());
        let normal = (b - a).cross(c - a);
        for &vertex in triangle {
            sums[vertex as usize] += normal;
        }
    }
    sums.into_iter().map(DVec3::try_normalize).collect()
}

/// Brings normals to unit length; one that has no direction becomes the area-weighted mean of its triangles', or +Y.
fn repair_normals(positions: &[[f32; 3]], indices: &[[u32; 3]], normals: &mut [[f32; 3]]) {
    let usable = |normal: &[f32; 3]| DVec3::from(normal.map(f64::from)).length() > 1e-12;
    let broken: Vec<bool> = normals.iter().map(|normal| !usable(normal)).collect();
    if broken.contains(&true) {
        let means = mean_normals(positions, indices);
        for ((normal, mean), _) in normals.iter_mut().zip(means).zip(&broken).filter(|(_, broken)| **broken) {
            *normal = mean.unwrap_or(DVec3::Y).as_vec3().to_array();
        }
    }
    for normal in normals {
        *normal = Vec3::from(*normal).as_dvec3().normalize_or(DVec3::Y).as_vec3().to_array();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn strip(triangles: u32) -> MeshData {
        let positions: Vec<[f32; 3]> =
            (0..triangles + 2).map(|i| [i as f32 * 0.5, (i % 2) as f32, (i % 7) as f32 * 0.1]).collect();
        MeshData {
            normals: vec![[0.0; 3]; positions.len()],
            uvs: vec![[0.0; 2]; positions.len()],
            indices: (0..triangles).map(|i| [i, i + 1, i + 2]).collect(),
            materials: (0..triangles).map(|i| i % 3).collect(),
            positions,
        }
    }

    #[test]
    fn triangles_keep_their_material_through_the_reordering() {
        let data = strip(100);
        let mesh = Mesh::new(data.clone());
        assert_eq!(mesh.bvh.order, (0..100).collect::<Vec<_>>());
        assert_ne!(mesh.indices, data.indices, "the builder sorts a strip; otherwise this shows nothing");
        for (triangle, material) in mesh.indices.iter().zip(&mesh.materials) {
            assert_eq!(triangle[0] % 3, *material);
        }
        assert_eq!(mesh.used_materials, [0, 1, 2]);
    }

    #[test]
    fn empty_single_and_degenerate_meshes_build() {
        let empty = Mesh::new(MeshData::default());
        assert!(empty.bvh.nodes.is_empty() && empty.bounds_m.is_none());
        let single = Mesh::new(strip(1));
        assert_eq!((single.bvh.nodes.len(), single.indices.len()), (1, 1));
        let mut degenerate = strip(20);
        degenerate.indices.fill([3, 3, 3]);
        let degenerate = Mesh::new(degenerate);
        assert_eq!(degenerate.indices.len(), 20);
        assert!(degenerate.normals.iter().all(|n| (Vec3::from(*n).length() - 1.0).abs() < 1e-6));
    }

    #[test]
    fn a_missing_normal_becomes_that_of_its_triangles() {
        let mut data = strip(1);
        data.positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        assert_eq!(Mesh::new(data).normals, [[0.0, 0.0, 1.0]; 3]);
    }
}
