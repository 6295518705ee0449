//! Rays against a scene on the CPU, in f64: what `lanternd check` counts its shares with.

use glam::{DVec3, Vec2, Vec3};
use lantern_proto::Role;

use crate::bvh::BoxRay;
use crate::pack::{ROLE_MASK, ROLE_PROP, ROLE_RASTER, ROLE_VIRTUAL};
use crate::scene::Scene;

/// What a ray met first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The ray's parameter: the point is origin + t × direction.
    pub t: f64,
    /// Index into [`Scene::instances`].
    pub instance: usize,
    /// Index into [`Scene::nodes`].
    pub node: usize,
    /// The mesh's own number.
    pub triangle: usize,
    /// Weights of corners 1 and 2.
    pub barycentric: [f64; 2],
    /// Unit length, outward in the sense of [`crate::Instance`], never turned toward the ray.
    pub geometric_normal: DVec3,
}

/// A role's bit in a mask for [`Scene::cast`]; the values are those of [`crate::pack::GpuInstance::flags`].
pub fn role_bit(role: Role) -> u32 {
    match role {
        Role::Prop => ROLE_PROP,
        Role::Virtual => ROLE_VIRTUAL,
        Role::Raster => ROLE_RASTER,
        Role::Mask => ROLE_MASK,
    }
}

/// What a projector's primary rays hit (CONTRACT, "Roles").
pub const PRIMARY_ROLES: u32 = ROLE_PROP | ROLE_MASK;
/// What secondary and eye rays hit.
pub const SECONDARY_ROLES: u32 = ROLE_PROP | ROLE_MASK | ROLE_VIRTUAL;

impl Scene {
    /// The closest hit of a ray in the world's own frame with t in [`t_min`, `t_max`], on visible instances whose role
    /// is in the mask. Both sides of a triangle are hit. `direction` may have any length but zero. Raster nodes are
    /// never in the structure and so never hit.
    pub fn cast(&self, origin_m: DVec3, direction: DVec3, t_min: f64, t_max: f64, roles: u32) -> Option<Hit> {
        let mut hit = None;
        let mut t_max = t_max;
        let ray = BoxRay::new(origin_m - self.origin_m, direction, t_min);
        self.top_walk.bvh.walk(&ray, &mut t_max, |leaf, t_max| {
            let index = self.top.order[leaf] as usize;
            let instance = &self.instances[index];
            if role_bit(instance.role) & roles == 0 {
                return;
            }
            let object_from_world = instance.world_from_object.inverse();
            let origin = object_from_world.transform_point3(origin_m);
            let along = object_from_world.transform_vector3(direction);
            let mesh = &self.meshes[instance.mesh];
            mesh.bvh.walk(&BoxRay::new(origin, along, t_min), t_max, |triangle, t_max| {
                let corners = mesh.corners(triangle);
                let Some((t, barycentric)) = meet(corners, origin, along) else { return };
                // A hit at the very limit counts, unless one was found there already.
                if t < t_min || t > *t_max || (t == *t_max && hit.is_some()) {
                    return;
                }
                *t_max = t;
                let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                let normal = object_from_world.matrix3.transpose() * normal;
                hit = Some(Hit {
                    t,
                    instance: index,
                    node: instance.node,
                    triangle,
                    barycentric,
                    geometric_normal: normal.normalize_or_zero(),
                });
            });
        });
        hit
    }

    /// The vertex normal (world, unit length) and texture coordinates at a hit.
    pub fn shading_at(&self, hit: &Hit) -> (DVec3, Vec2) {
        let instance = &self.instances[hit.instance];
        let mesh = &self.meshes[instance.mesh];
        let [b, c] = hit.barycentric;
        let weights = [1.0 - b - c, b, c];
        let mut normal = DVec3::ZERO;
        let mut uv = Vec2::ZERO;
        for (vertex, weight) in mesh.indices[hit.triangle].iter().zip(weights) {
            normal += Vec3::from(mesh.normals[*vertex as usize]).as_dvec3() * weight;
            uv += Vec2::from(mesh.uvs[*vertex as usize]) * weight as f32;
        }
        let normal = instance.world_from_object.matrix3.inverse().transpose() * normal;
        (normal.normalize_or(hit.geometric_normal), uv)
    }
}

/// Möller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection" (1997), both sides: t and the weights of
/// corners 1 and 2.
fn meet([a, b, c]: [DVec3; 3], origin: DVec3, direction: DVec3) -> Option<(f64, [f64; 2])> {
    let (e1, e2) = (b - a, c - a);
    let p = direction.cross(e2);
    let determinant = e1.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let from_a = origin - a;
    let u = from_a.dot(p) / determinant;
    let q = from_a.cross(e1);
    let v = direction.dot(q) / determinant;
    let t = e2.dot(q) / determinant;
    // A hair beyond the edge still counts, so that a ray through a shared edge meets one of the two triangles.
    const SLACK: f64 = 1e-12;
    (u >= -SLACK && v >= -SLACK && u + v <= 1.0 + SLACK && t.is_finite()).then_some((t, [u, v]))
}
