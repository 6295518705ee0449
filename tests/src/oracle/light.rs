//! Light straight from its sources, with hard shadows, and the part of a point's look that no eye can change: twin of
//! `light.glsl` and `light.comp`.

use std::f64::consts::PI;

use glam::DVec3;
use lantern_scene::{
    Role,
    pack::{GpuLight, LIGHT_DIRECTIONAL, LIGHT_SPOT},
};

use super::{
    environment::irradiance_over_pi,
    geometry::Ray,
    shade::{diffuse_color, fresnel_dielectric},
    surface::Surface,
    world::World,
};

/// How far a secondary ray starts from its surface, as a share of the largest coordinate (at least 1 m): f64 leaves room.
const OFFSET: f64 = 1e-9;

/// What a light sends to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// Unit length.
    pub to_light: DVec3,
    /// Infinite for a directional light.
    pub distance_m: f64,
    /// Linear RGB at normal incidence.
    pub lux: DVec3,
}

/// A point from which a secondary ray does not meet its own surface; `n` points to the side where it starts.
pub fn offset_origin(p_m: DVec3, n: DVec3) -> DVec3 {
    p_m + n * (OFFSET * p_m.abs().max_element().max(1.0))
}

/// A punctual light at a point, shadows not counted (glTF extension KHR_lights_punctual). `origin_m` is the scene's, to
/// which the light's position is relative.
pub fn light_at(light: &GpuLight, origin_m: DVec3, p_m: DVec3) -> Arrival {
    let intensity = DVec3::from(light.intensity.map(f64::from));
    let travels = DVec3::from(light.direction.map(f64::from)).normalize_or_zero();
    if light.kind == LIGHT_DIRECTIONAL {
        return Arrival { to_light: -travels, distance_m: f64::INFINITY, lux: intensity };
    }
    let way = DVec3::from(light.position.map(f64::from)) + origin_m - p_m;
    let distance_m = way.length().max(1e-4);
    let to_light = way / distance_m;
    let mut lux = intensity / (distance_m * distance_m);
    if light.range > 0.0 {
        lux *= (1.0 - (distance_m / f64::from(light.range)).powi(4)).clamp(0.0, 1.0);
    }
    if light.kind == LIGHT_SPOT {
        let (inner, outer) = (f64::from(light.cos_inner), f64::from(light.cos_outer));
        let within = ((travels.dot(-to_light) - outer) / (inner - outer).max(1e-4)).clamp(0.0, 1.0);
        lux *= within * within;
    }
    Arrival { to_light, distance_m, lux }
}

/// The share of light that comes through along a ray: nothing past an opaque surface, else the product over all crossed
/// surfaces of what each transmits. Light goes straight on; a body's absorption along the way is not counted.
pub fn trace_shadow(world: &World, ray: &Ray) -> DVec3 {
    let mut through = DVec3::ONE;
    world.each(ray, |hit| {
        let s = Surface::at(world, &hit);
        if s.role == Role::Mask || s.transmission <= 0.0 {
            through = DVec3::ZERO;
            return false;
        }
        // A body is entered against its outward normal, and left along it.
        let facing = ray.direction.dot(s.normal_geometric);
        let leaves = s.thickness > 0.0 && facing > 0.0;
        let reflected = fresnel_dielectric(facing, if leaves { s.ior.recip() } else { s.ior });
        through *= s.base * (s.transmission * (1.0 - s.metallic) * (1.0 - reflected));
        through.max_element() > 0.0
    });
    through
}

/// What arrives from one light after shadows; black from behind either normal.
pub fn arriving(world: &World, light: &GpuLight, s: &Surface) -> Arrival {
    let arrival = light_at(light, world.scene().origin_m, s.position_m);
    let behind = s.normal.dot(arrival.to_light) <= 0.0 || s.normal_geometric.dot(arrival.to_light) <= 0.0;
    if behind || arrival.lux.max_element() <= 0.0 {
        return Arrival { lux: DVec3::ZERO, ..arrival };
    }
    let origin_m = offset_origin(s.position_m, s.normal_geometric);
    let ray = Ray { origin_m, direction: arrival.to_light, t_max_m: arrival.distance_m };
    Arrival { lux: arrival.lux * trace_shadow(world, &ray), ..arrival }
}

/// Emission and diffuse light: what a point shows to everyone.
pub fn eye_independent(world: &World, s: &Surface) -> DVec3 {
    let diffuse = diffuse_color(s);
    let direct: DVec3 = world
        .scene()
        .lights
        .iter()
        .map(|light| arriving(world, light, s))
        .map(|arrival| arrival.lux * (s.normal.dot(arrival.to_light).max(0.0) / PI))
        .sum();
    let below = s.emissive + diffuse * (direct + irradiance_over_pi(&world.scene().environment, s.normal));

    // What a clear coat leaves, as at normal incidence: the eye must not matter here.
    (1.0 - 0.04 * s.clearcoat) * below
}

#[cfg(test)]
mod tests {
    use super::*;
    use lantern_scene::pack::LIGHT_POINT;

    fn light(kind: u32) -> GpuLight {
        GpuLight {
            position: [0.0, 2.0, 0.0],
            kind,
            direction: [0.0, -1.0, 0.0],
            range: 0.0,
            intensity: [8.0, 4.0, 2.0],
            cos_outer: 0.8,
            cos_inner: 0.9,
            pad: [0.0; 3],
        }
    }

    #[test]
    fn lights_fall_off_as_they_should() {
        let directional = light_at(&light(LIGHT_DIRECTIONAL), DVec3::ZERO, DVec3::ONE);
        assert_eq!((directional.lux, directional.to_light), (DVec3::new(8.0, 4.0, 2.0), DVec3::Y));

        // The position is relative to the scene's origin.
        let point = light_at(&light(LIGHT_POINT), DVec3::X * 1000.0, DVec3::X * 1000.0);
        assert!((point.lux - DVec3::new(2.0, 1.0, 0.5)).length() < 1e-12 && point.distance_m == 2.0);
        let windowed = light_at(&GpuLight { range: 2.0, ..light(LIGHT_POINT) }, DVec3::ZERO, DVec3::ZERO);
        assert_eq!(windowed.lux, DVec3::ZERO);

        let spot = |x: f64| light_at(&light(LIGHT_SPOT), DVec3::ZERO, DVec3::new(x, 0.0, 0.0)).lux.x;
        assert_eq!(spot(0.0), 2.0);
        assert_eq!(spot(2.0), 0.0, "45° is outside of the cone");
        let between = 2.0 * (1.0f64 / (0.85 * 0.85) - 1.0).sqrt();
        let full = 8.0 / (4.0 + between * between);
        assert!((spot(between) / full - 0.25).abs() < 1e-6, "{}", spot(between) / full);
    }
}
