//! What differs between two revisions.

use std::sync::Arc;

use lantern_proto::Role;

use crate::scene::{Instance, Scene};

/// What differs between two revisions; what that makes stale is the renderer's to decide.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Changes {
    /// Triangles or bottom-level structures.
    pub geometry: bool,
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

impl Changes {
    /// Everything: what a renderer that has seen nothing yet starts from.
    pub const ALL: Self = Self {
        geometry: true,
        props_moved: true,
        virtual_moved: true,
        raster_moved: true,
        materials: true,
        lights: true,
        environment: true,
        textures: true,
    };

    /// Whether there is any.
    pub fn any(&self) -> bool {
        *self != Self::default()
    }
}

/// Compares two revisions; sections by their `Arc`, instances by value.
pub fn changes(old: &Scene, new: &Scene) -> Changes {
    let shifted = old.origin_m != new.origin_m;
    let moved = |roles: &[Role]| shifted || !placed(old, roles).eq(placed(new, roles));
    Changes {
        geometry: !Arc::ptr_eq(&old.geometry, &new.geometry),
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
fn placed<'a>(scene: &'a Scene, roles: &'a [Role]) -> impl Iterator<Item = (usize, *const crate::Mesh, &'a Instance)> {
    let instances = scene.instances.iter().enumerate();
    instances
        .filter(|(_, instance)| instance.visible && roles.contains(&instance.role))
        .map(|(index, instance)| (index, Arc::as_ptr(&scene.meshes[instance.mesh]), instance))
}
