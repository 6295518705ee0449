//! The scene in the device's own acceleration structures, for devices whose ray queries trace: what `scene_buffers` holds for the others.
//!
//! A bottom level a mesh, however often that is placed, and a top level over what rays can meet. Instances and triangles have the
//! numbers that they have in the scene's own structures, so that the passes ask the same buffers what was met.

use std::sync::Arc;

use lantern_gpu::{BottomLevel, GpuError, Placed, Recorder, TopLevel};
use lantern_scene::pack::{GpuTop, INSTANCE_OPAQUE, ROLE_MASK};
use lantern_scene::{Mesh, Scene};

use crate::catalogue::Catalogue;

/// What shaders call the top level.
const NAME: &str = "scene_structure";

/// A mesh, and its bottom level; none for one without triangles.
type Built = (Arc<Mesh>, Option<Arc<BottomLevel>>);

/// The structures of the scene as it was taken last; nothing before the first time.
#[derive(Default)]
pub(crate) struct Structures {
    top: Option<Arc<GpuTop>>,
    /// Of the scene's meshes, in their order.
    bottoms: Vec<Built>,
    structure: Option<Arc<TopLevel>>,
}

impl Structures {
    /// Builds what `scene` has and the last one had not. True when the top level is another, so that what binds it must bind it again.
    pub(crate) fn update(&mut self, recorder: &mut Recorder, scene: &Scene) -> Result<bool, GpuError> {
        let same_meshes =
            self.bottoms.iter().map(|(mesh, _)| Arc::as_ptr(mesh)).eq(scene.meshes.iter().map(Arc::as_ptr));
        if same_meshes && self.top.as_ref().is_some_and(|was| Arc::ptr_eq(was, &scene.top)) {
            return Ok(false);
        }
        self.bottoms = self.bottoms_of(recorder, scene)?;

        // What rays can meet, and for whom: an instance's role is its mask.
        let mut placed = Vec::with_capacity(scene.top.order.len());
        for &number in &scene.top.order {
            let (instance, gpu) = (&scene.instances[number as usize], &scene.top.instances[number as usize]);
            let Some((_, Some(bottom))) = self.bottoms.get(instance.mesh) else { continue };
            placed.push(Placed {
                bottom,
                world_from_object: gpu.world_from_object,
                number,
                mask: gpu.flags as u8,
                opaque: gpu.flags & (INSTANCE_OPAQUE | ROLE_MASK) != 0,
            });
        }
        self.structure = Some(recorder.build_top_level("scene", &placed)?);
        self.top = Some(scene.top.clone());
        Ok(true)
    }

    /// The bottom level of each of the scene's meshes: that which is there, or another.
    fn bottoms_of(&self, recorder: &mut Recorder, scene: &Scene) -> Result<Vec<Built>, GpuError> {
        let mut all = Vec::with_capacity(scene.meshes.len());
        for (number, mesh) in scene.meshes.iter().enumerate() {
            // Mostly in the same place, since what changes is mostly where meshes stand.
            let is_its = |built: &&Built| Arc::ptr_eq(&built.0, mesh);
            let there = self.bottoms.get(number).filter(is_its).or_else(|| self.bottoms.iter().find(is_its));
            let bottom = match there {
                Some((_, bottom)) => bottom.clone(),
                None if mesh.indices.is_empty() => None,
                None => {
                    let name = format!("mesh {number}");
                    Some(recorder.build_bottom_level(&name, &mesh.positions, &mesh.indices)?)
                }
            };
            all.push((mesh.clone(), bottom));
        }
        Ok(all)
    }

    /// Bytes of device memory that all of them take.
    pub(crate) fn bytes(&self) -> u64 {
        let bottoms = self.bottoms.iter().filter_map(|(_, bottom)| bottom.as_ref()).map(|bottom| bottom.bytes());
        bottoms.sum::<u64>() + self.structure.as_ref().map_or(0, |top| top.bytes())
    }

    /// Adds the top level.
    pub(crate) fn list(&self, catalogue: Catalogue) -> Catalogue {
        self.structure.iter().fold(catalogue, |c, structure| c.with_structure(NAME, structure))
    }
}
