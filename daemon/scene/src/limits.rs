//! How much of a scene is taken in before it is refused.

/// Bounds on what one scene may hold; each is checked before the memory it guards is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of one file, the buffers and images that it names included.
    pub max_file_bytes: u64,
    /// Triangles of all meshes together, each counted once however often it is placed.
    pub max_triangles: usize,
    /// Texels of all textures together; of the environment's level 0 as well, counted by itself.
    pub max_texels: usize,
    /// Placed meshes and lights, of all nodes together; their materials likewise, counted by themselves.
    pub max_nodes: usize,
    /// Lights that shine, imported ones and others together: each is asked at every hit.
    pub max_lights: usize,
}

impl Default for Limits {
    /// Sized so that no buffer passes the 128 M texel elements that the reference driver offers (MEASURED.md).
    fn default() -> Self {
        Self {
            max_file_bytes: 1 << 30,
            max_triangles: 16_000_000,
            max_texels: 1 << 26,
            max_nodes: 65_536,
            max_lights: 16,
        }
    }
}
