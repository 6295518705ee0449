//! What differs between two revisions.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use lantern_proto::Role;

use crate::mesh::Mesh;
use crate::scene::{Instance, Scene, world_bounds};

/// What differs between two revisions; what that makes stale is the renderer's to decide.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Changes {
    /// A visible instance of role `prop` or `mask` moved, appeared, vanished, or has another number.
    pub props_moved: bool,
    /// The same of role `virtual`.
    pub virtual_moved: bool,
    /// The same of role `raster`.
    pub raster_moved: bool,
    /// A material's values, or which material a triangle has.
    pub materials: bool,
    /// Any light.
    pub lights: bool,
    /// What a miss sees.
    pub environment: bool,
    /// Texels, or how they are read.
    pub textures: bool,
}

/// Compares two revisions; sections by their `Arc`, instances by value.
pub fn changes(old: &Scene, new: &Scene) -> Changes {
    let shifted = old.origin_m != new.origin_m;
    let moved = |roles: &[Role]| shifted || !placed(old, roles).eq(placed(new, roles));
    Changes {
        props_moved: moved(&[Role::Prop, Role::Mask]),
        virtual_moved: moved(&[Role::Virtual]),
        raster_moved: moved(&[Role::Raster]),
        materials: !Arc::ptr_eq(&old.gpu_materials, &new.gpu_materials),
        lights: !Arc::ptr_eq(&old.lights, &new.lights),
        environment: !Arc::ptr_eq(&old.environment, &new.environment),
        textures: !Arc::ptr_eq(&old.textures, &new.textures),
    }
}

/// The visible instances of some roles with all that a stored hit depends on: their numbers, and which mesh they show.
fn placed<'a>(scene: &'a Scene, roles: &'a [Role]) -> impl Iterator<Item = (usize, *const Mesh, &'a Instance)> {
    let instances = scene.instances.iter().enumerate();
    instances
        .filter(|(_, instance)| instance.visible && roles.contains(&instance.role))
        .map(|(index, instance)| (index, Arc::as_ptr(&scene.meshes[instance.mesh]), instance))
}

/// A place that something which rays can meet has left, or has come to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moved {
    /// Whether a projector's rays can meet it: a prop or a mask, and no virtual thing.
    pub physical: bool,
    /// The corners of its box in the world's own frame, m.
    pub low_m: DVec3,
    /// See `low_m`.
    pub high_m: DVec3,
}

/// Where anything that rays can meet differs between two revisions: the box of each such instance before, and after.
///
/// Instances are compared by number, since a hit is stored as one: what is renumbered counts as moved.
pub fn moved(old: &Scene, new: &Scene) -> Vec<Moved> {
    let mut all = Vec::new();
    for index in 0..old.instances.len().max(new.instances.len()) {
        let (before, after) = (traced(old, index), traced(new, index));
        if before.map(what_a_hit_depends_on) != after.map(what_a_hit_depends_on) {
            all.extend(before.and_then(place_of));
            all.extend(after.and_then(place_of));
        }
    }
    all
}

/// An instance that rays can meet, with its mesh.
type Traced<'a> = (&'a Instance, &'a Arc<Mesh>);

fn traced(scene: &Scene, index: usize) -> Option<Traced<'_>> {
    let instance = scene.instances.get(index).filter(|instance| instance.is_traced())?;
    Some((instance, &scene.meshes[instance.mesh]))
}

fn what_a_hit_depends_on((instance, mesh): Traced<'_>) -> (*const Mesh, Role, DAffine3, u32) {
    (Arc::as_ptr(mesh), instance.role, instance.world_from_object, instance.material_base)
}

/// Where it is; `None` for a mesh without triangles.
fn place_of((instance, mesh): Traced<'_>) -> Option<Moved> {
    let (low_m, high_m) = world_bounds(mesh.bounds_m?, &instance.world_from_object);
    Some(Moved { physical: instance.role != Role::Virtual, low_m, high_m })
}
