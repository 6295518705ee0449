//! What a file or a builtin holds, loaded once and shared by every node that shows it.

use std::sync::Arc;

use glam::DAffine3;
use lantern_proto::{LightKind, Role};

use crate::material::Material;
use crate::mesh::Mesh;
use crate::texture::Texture;

/// A loaded file or builtin, in its own frame: metres, +Y up.
#[derive(Clone, Debug, Default)]
pub(crate) struct Asset {
    /// Each with its bottom-level structure.
    pub(crate) meshes: Vec<Arc<Mesh>>,
    /// Where the meshes' vertices come from; one a mesh.
    pub(crate) vertices: Vec<Vertices>,
    /// The placed meshes, in the file's order.
    pub(crate) parts: Vec<Part>,
    /// What the meshes' material numbers index; texture numbers are this asset's.
    pub(crate) materials: Vec<Material>,
    /// What the materials' texture numbers index.
    pub(crate) textures: Vec<Texture>,
    /// The placed lights, each under a name of its own.
    pub(crate) lights: Vec<AssetLight>,
    /// What the file holds and Lantern ignores, in words.
    pub(crate) warnings: Vec<String>,
}

/// Where a mesh's vertices come from, for those who give them new places.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Vertices {
    /// The mesh's place in the file.
    pub(crate) mesh: u32,
    /// Its name in the file.
    pub(crate) name: Option<String>,
    /// How many vertices the file has for its triangles: those of all its primitives, one after the other.
    pub(crate) count: usize,
    /// For each vertex of the mesh, the file's.
    pub(crate) of_file: Vec<u32>,
    /// For each vertex of the mesh, whether the file says its normal; else it is that of its triangle.
    pub(crate) has_normal: Vec<bool>,
}

/// One placed mesh.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Part {
    /// Index into [`Asset::meshes`].
    pub(crate) mesh: usize,
    /// From the mesh's frame to the asset's; invertible, may mirror.
    pub(crate) asset_from_object: DAffine3,
    /// What the file says of the part's role; it holds where no edit gives the node one.
    pub(crate) role: Option<Role>,
}

/// A light of KHR_lights_punctual, placed by a glTF node; it shines along its frame's −Z.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct AssetLight {
    /// Unique in the asset.
    pub(crate) name: String,
    /// From the light's frame to the asset's.
    pub(crate) asset_from_light: DAffine3,
    /// How it shines.
    pub(crate) kind: LightKind,
    /// Linear RGB.
    pub(crate) color: [f64; 3],
    /// Lux (directional) or candela.
    pub(crate) intensity: f64,
    /// Metres; 0 = infinite.
    pub(crate) range_m: f64,
    /// Where a spot's fall begins and ends, from its axis, rad.
    pub(crate) cones_rad: [f64; 2],
}

impl Asset {
    /// One mesh at the origin, as if it were the only one of a file.
    pub(crate) fn single(name: &str, mesh: Mesh, materials: Vec<Material>) -> Self {
        let count = mesh.positions.len();
        Self {
            vertices: vec![Vertices {
                mesh: 0,
                name: Some(name.to_owned()),
                count,
                of_file: (0..count as u32).collect(),
                has_normal: vec![true; count],
            }],
            meshes: vec![Arc::new(mesh)],
            parts: vec![Part { mesh: 0, asset_from_object: DAffine3::IDENTITY, role: None }],
            materials,
            ..Self::default()
        }
    }

    /// Triangles of all meshes, each mesh counted once.
    pub(crate) fn triangle_count(&self) -> usize {
        self.meshes.iter().map(|mesh| mesh.indices.len()).sum()
    }

    /// Texels of all images, each counted once.
    pub(crate) fn texel_count(&self) -> usize {
        let mut seen: Vec<*const crate::texture::Image> = vec![];
        let mut texels = 0;
        for texture in &self.textures {
            if !seen.contains(&Arc::as_ptr(&texture.image)) {
                seen.push(Arc::as_ptr(&texture.image));
                texels += texture.image.texels.len();
            }
        }
        texels
    }
}
