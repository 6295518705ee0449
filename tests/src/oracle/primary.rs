//! What a projector's ray lands on: twin of `primary.comp`.

use glam::{DVec2, UVec2};
use lantern_calibration::Frustum;

use super::{
    geometry::Ray,
    surface::Surface,
    world::{Hit, Meets, World},
};

/// A primary hit, both normals turned to the side that the projector lights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrimaryHit {
    /// The projector's ray.
    pub ray: Ray,
    /// Where it met what.
    pub hit: Hit,
    /// Index of the node in `scene.get` order.
    pub node: usize,
    /// The point.
    pub surface: Surface,
    /// Whether the projector stands inside of the body that it hit.
    pub inside: bool,
}

/// The primary ray of a place in a pixel; `None` where the frustum has none.
pub fn primary_ray(frustum: &Frustum, pixel: UVec2, offset_px: DVec2) -> Option<Ray> {
    let ray = frustum.ray(pixel.as_dvec2() + offset_px)?;
    Some(Ray { origin_m: ray.origin_m, direction: ray.direction, t_max_m: ray.t_max_m })
}

/// The first prop or mask on a ray, from the near to the far plane.
pub fn primary_hit(world: &World, ray: Ray) -> Option<PrimaryHit> {
    let hit = world.closest(&ray, Meets::Physical)?;
    let mut surface = Surface::at(world, &hit);
    let inside = surface.turn_to(ray.direction);
    Some(PrimaryHit { ray, hit, node: world.scene().instances[hit.instance].node, surface, inside })
}
