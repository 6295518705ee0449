//! What lies in the scene's large buffers: blocks that are uploaded once, however many revisions show them.

use std::collections::HashSet;
use std::ops::Range;
use std::sync::Arc;

use lantern_gpu::TexelFormat;
use lantern_scene::pack::GpuEnvironment;
use lantern_scene::{Image, Mesh, MeshPart, Scene};

/// A buffer that blocks share.
pub(crate) struct Column {
    /// What shaders call it.
    pub(crate) name: &'static str,
    /// Its texels.
    pub(crate) format: TexelFormat,
    /// Bytes of an element, which is what shaders count by.
    pub(crate) element_bytes: u64,
    part: Option<MeshPart>,
}

const UINTS: TexelFormat = TexelFormat::Rgba32Uint;
const FLOATS: TexelFormat = TexelFormat::Rgba32Float;
const COLOURS: TexelFormat = TexelFormat::R32Uint;

const fn of_mesh(name: &'static str, format: TexelFormat, part: MeshPart) -> Column {
    Column { name, format, element_bytes: part.texels() as u64 * 16, part: Some(part) }
}

/// How many spaces there are.
pub(crate) const SPACES: usize = 5;
/// Where the nodes of meshes lie.
pub(crate) const NODES: usize = 0;
/// Where their triangles lie.
pub(crate) const TRIANGLES: usize = 1;
/// Where their vertices lie.
pub(crate) const VERTICES: usize = 2;
/// Where images lie.
pub(crate) const IMAGES: usize = 3;
/// Where environments lie.
pub(crate) const ENVIRONMENTS: usize = 4;

/// The buffers of each space. Those of one space are laid out alike: shaders reach them by the same number.
pub(crate) const COLUMNS: [&[Column]; SPACES] = [
    &[of_mesh("blas_nodes", UINTS, MeshPart::Nodes)],
    &[of_mesh("triangles", FLOATS, MeshPart::Triangles), of_mesh("indices", UINTS, MeshPart::Indices)],
    &[of_mesh("vertices", UINTS, MeshPart::Vertices)],
    &[Column { name: "texels", format: COLOURS, element_bytes: 4, part: None }],
    &[Column { name: "environment_texels", format: FLOATS, element_bytes: 16, part: None }],
];

/// Something that is uploaded whole and never changes.
#[derive(Clone)]
pub(crate) enum Block {
    /// Triangles and their structure.
    Mesh(Arc<Mesh>),
    /// What textures read.
    Image(Arc<Image>),
    /// What a miss sees.
    Environment(Arc<GpuEnvironment>),
}

/// Bytes of all that one scene holds and another does not.
pub fn bytes_beyond(known: &Scene, new: &Scene) -> u64 {
    let keys: HashSet<Key> = Block::all_of(known).map(|block| block.key()).collect();
    Block::all_of(new).filter(|block| !keys.contains(&block.key())).map(|block| block.bytes()).sum()
}

/// Which block it is: an address, which is no other's while the block is held.
pub(crate) type Key = usize;

impl Block {
    /// Everything large that a scene shows, each once.
    pub(crate) fn all_of(scene: &Scene) -> impl Iterator<Item = Block> {
        let meshes = scene.meshes.iter().cloned().map(Block::Mesh);
        let images = scene.textures.images.iter().cloned().map(Block::Image);
        meshes.chain(images).chain([Block::Environment(scene.environment.clone())])
    }

    pub(crate) fn key(&self) -> Key {
        match self {
            Self::Mesh(mesh) => Arc::as_ptr(mesh).addr(),
            Self::Image(image) => Arc::as_ptr(image).addr(),
            Self::Environment(environment) => Arc::as_ptr(environment).addr(),
        }
    }

    /// How many elements of a space it takes.
    pub(crate) fn elements(&self, space: usize) -> u64 {
        let count = match self {
            Self::Mesh(mesh) => COLUMNS[space][0].part.map_or(0, |part| mesh.elements(part)),
            Self::Image(image) if space == IMAGES => image.texels.len(),
            Self::Environment(environment) if space == ENVIRONMENTS => environment.texels.len(),
            Self::Image(_) | Self::Environment(_) => 0,
        };
        count as u64
    }

    /// Bytes in all spaces.
    pub(crate) fn bytes(&self) -> u64 {
        let of_space =
            |space: usize| COLUMNS[space].iter().map(|c| c.element_bytes).sum::<u64>() * self.elements(space);
        (0..SPACES).map(of_space).sum()
    }

    /// Appends a range of its elements, as they lie in a column of a space that it takes part in.
    pub(crate) fn pack(&self, column: &Column, elements: Range<u64>, into: &mut Vec<u8>) {
        let elements = elements.start as usize..elements.end as usize;
        match (self, column.part) {
            (Self::Mesh(mesh), Some(part)) => into.extend_from_slice(bytemuck::cast_slice(&mesh.pack(part, elements))),
            (Self::Image(image), _) => into.extend_from_slice(bytemuck::cast_slice(&image.texels[elements])),
            (Self::Environment(environment), _) => {
                into.extend_from_slice(bytemuck::cast_slice(&environment.texels[elements]));
            }
            // A mesh has no elements in a space that is no part of one.
            (Self::Mesh(_), None) => {}
        }
    }
}
