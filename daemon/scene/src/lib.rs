//! The scene: glTF, materials, instances, edits and acceleration structures.
//!
//! An [`Editor`] turns edits into revisions, each an immutable [`Scene`] whose sections are bytes that the GPU reads
//! ([`pack`]). [`changes`] tells two revisions apart. No Vulkan here.

mod asset;
mod beneath;
mod builtin;
pub mod bvh;
mod by_name;
mod compose;
mod configured;
mod edit;
mod editor;
#[cfg(test)]
mod editor_tests;
pub mod environment;
mod file;
mod gltf;
mod irradiance;
mod library;
#[cfg(test)]
mod library_tests;
mod light;
mod limits;
#[cfg(test)]
mod limits_tests;
mod looks;
mod material;
mod mesh;
mod mesh_part;
pub mod pack;
mod raycast;
#[cfg(test)]
mod raycast_tests;
mod refit;
mod revision;
mod scene;
mod soundness;
mod structures;
mod studio;
mod teapot;
mod teapot_data;
mod texture;
mod top;
mod totals;
mod vertices;
#[cfg(test)]
mod vertices_tests;

pub use edit::EditError;
pub use editor::{Editor, Place, SceneProblem, may_take_long};
pub use lantern_proto::{Edit, Role};
pub use limits::Limits;
pub use material::{Material, absorption_per_m};
pub use mesh::{MAX_COORDINATE_M, Mesh, MeshData};
pub use mesh_part::MeshPart;
pub use raycast::{Hit, PRIMARY_ROLES, SECONDARY_ROLES, role_bit};
pub use revision::{Changes, Moved, changes, moved};
pub use scene::{Instance, Node, Scene, WorldMesh};
pub use structures::{Counts, Structures};
pub use texture::{GpuTextures, Image, Texture, Wrap};
