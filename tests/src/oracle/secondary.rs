//! The part of a point's look that depends on the eye: twin of `secondary.comp`.
//!
//! Rays start from the eye's line of sight, never from the projector's ray (Broecker, Smith and Thomas, ISMAR 2013, Figure
//! 8). The tree is Whitted's (CACM 23(6), 1980) with glTF's materials, walked by a stack of pending rays.

use glam::{DVec3, UVec2};
use lantern_scene::Role;

use super::{
    environment::environment_radiance,
    geometry::Ray,
    jitter::secondary_random,
    light::{arriving, eye_independent, offset_origin},
    primary::PrimaryHit,
    shade::{
        COAT_IOR, MIRROR_ROUGHNESS, base_fresnel, fresnel_dielectric, ggx_g2, ggx_lambda, highlight,
        sample_visible_normal, specular_scale,
    },
    surface::Surface,
    world::{Meets, World},
};

/// A sample follows at most this many rays.
pub const MAX_RAYS: u32 = 24;
/// A ray that carries less is not followed.
pub const MIN_THROUGHPUT: f64 = 1.0 / 256.0;

/// Who looks.
#[derive(Clone, Debug, PartialEq)]
pub enum Eye {
    /// Tracked viewers, m: each point belongs to the nearest one in front of it.
    Viewers(Vec<DVec3>),
    /// Nobody: every ray is mirrored as it came from the projector. The method that the paper warns of, for tests that show why.
    Projector,
}

/// What a sample's random numbers depend on, and how deep its tree may grow.
#[derive(Clone, Copy, Debug)]
pub struct Sample<'a> {
    /// Of the projector's image.
    pub pixel: UVec2,
    /// Its number in the pixel.
    pub index: u32,
    /// The projector's state, a word a sample.
    pub seed_words: &'a [u32],
    /// Secondary rays deep.
    pub max_depth: u32,
}

/// What the eye makes of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Look {
    /// Add it to the eye-independent light.
    Add(DVec3),
    /// A virtual thing stands before the point: this is all that shows.
    Hidden(DVec3),
}

/// A ray that waits to be followed.
#[derive(Clone, Copy, Debug)]
struct Pending {
    ray: Ray,
    throughput: DVec3,
    depth: u32,
    absorption_per_m: DVec3,
}

/// A surface as it is looked at.
struct View<'a> {
    s: &'a Surface,
    /// The way back to whoever looks; unit length.
    v: DVec3,
    /// Whether the look comes from within the body.
    inside: bool,
    throughput: DVec3,
    depth: u32,
    /// Of the medium in front of the surface.
    absorption_per_m: DVec3,
}

struct Tree<'a> {
    world: &'a World<'a>,
    sample: Sample<'a>,
    pending: Vec<Pending>,
    rays_made: u32,
    radiance: DVec3,
}

/// The nearest viewer in front of the shading normal.
pub fn viewer_of(s: &Surface, viewers_m: &[DVec3]) -> Option<DVec3> {
    let before = |eye_m: &&DVec3| {
        let way = **eye_m - s.position_m;
        way.dot(s.normal) > 0.0
    };
    let nearer = |a: &&DVec3, b: &&DVec3| a.distance(s.position_m).total_cmp(&b.distance(s.position_m));
    viewers_m.iter().filter(before).min_by(nearer).copied()
}

/// The eye-dependent look of a primary hit. Nothing is added where no viewer is in front of it, and to a mask.
pub fn eye_dependent(world: &World, hit: &PrimaryHit, eye: &Eye, sample: Sample) -> Look {
    let s = &hit.surface;
    if s.role == Role::Mask {
        return Look::Add(DVec3::ZERO);
    }
    let mut tree = Tree { world, sample, pending: Vec::new(), rays_made: 0, radiance: DVec3::ZERO };
    let v = match eye {
        Eye::Projector => -hit.ray.direction,
        Eye::Viewers(viewers_m) => {
            let Some(eye_m) = viewer_of(s, viewers_m) else { return Look::Add(DVec3::ZERO) };
            let (v, distance_m) = ((eye_m - s.position_m).normalize(), eye_m.distance(s.position_m));

            // A virtual thing in the line of sight is all that the eye sees. The ray that looks for one is the first made.
            if world.has_virtual() {
                tree.rays_made = 1;
                let sight = Ray { origin_m: eye_m, direction: -v, t_max_m: distance_m * (1.0 - 1e-9) };
                if tree.meet(&Pending::first(sight), Meets::Virtual) {
                    tree.follow_all();
                    return Look::Hidden(tree.radiance);
                }
            }
            v
        }
    };
    tree.scatter(&View { s, v, inside: hit.inside, throughput: DVec3::ONE, depth: 0, absorption_per_m: DVec3::ZERO });
    tree.follow_all();
    Look::Add(tree.radiance)
}

/// All that comes to an eye along a ray: what a picture from the eye would show.
pub fn radiance(world: &World, ray: Ray, sample: Sample) -> DVec3 {
    let mut tree = Tree { world, sample, pending: vec![Pending::first(ray)], rays_made: 1, radiance: DVec3::ZERO };
    tree.follow_all();
    tree.radiance
}

impl Pending {
    fn first(ray: Ray) -> Self {
        Self { ray, throughput: DVec3::ONE, depth: 0, absorption_per_m: DVec3::ZERO }
    }
}

impl Tree<'_> {
    fn follow_all(&mut self) {
        while let Some(pending) = self.pending.pop() {
            if !self.meet(&pending, Meets::Everything) {
                let seen = environment_radiance(&self.world.scene().environment, pending.ray.direction);
                self.radiance += pending.throughput * seen;
            }
        }
    }

    /// Adds all that the ray's first hit shows; false where there is none.
    fn meet(&mut self, pending: &Pending, meets: Meets) -> bool {
        let Some(hit) = self.world.closest(&pending.ray, meets) else { return false };
        let mut s = Surface::at(self.world, &hit);
        if s.role == Role::Mask {
            return true;
        }
        let inside = s.turn_to(pending.ray.direction);
        let absorbed = (pending.absorption_per_m * -hit.t_m).exp();
        let view = View {
            s: &s,
            v: -pending.ray.direction,
            inside,
            throughput: pending.throughput * absorbed,
            depth: pending.depth,
            absorption_per_m: pending.absorption_per_m,
        };
        self.emit(&view);
        self.scatter(&view);
        true
    }

    /// The eye-independent light of a surface, under its coat.
    fn emit(&mut self, view: &View) {
        self.radiance += view.throughput * eye_independent(self.world, view.s);
    }

    /// Highlights, and a ray for each way that light leaves by.
    fn scatter(&mut self, view: &View) {
        let View { s, v, inside, .. } = *view;
        let (coat, n_v) = (view.coat(), view.n_v());
        let below = view.throughput * (1.0 - coat);

        // Highlights of the base layer and of the coat over it.
        let lights: &[_] = if specular_scale(s) > 0.0 || s.clearcoat > 0.0 { &self.world.scene().lights } else { &[] };
        for source in lights {
            let arrival = arriving(self.world, source, s);
            if arrival.lux.max_element() <= 0.0 {
                continue;
            }
            let v_h = v.dot((v + arrival.to_light).normalize()).max(0.0);
            let base = highlight(s.normal, v, arrival.to_light, s.roughness) * base_fresnel(s, v_h, inside);
            let over = highlight(s.normal, v, arrival.to_light, s.clearcoat_roughness)
                * s.clearcoat
                * fresnel_dielectric(v_h, COAT_IOR);
            self.radiance += arrival.lux * (below * base + view.throughput * over);
        }

        // Reflection by the base layer, and by the coat.
        let medium = view.absorption_per_m;
        let mirrored = base_fresnel(s, n_v, inside);
        if mirrored.max_element() > 0.0 {
            let lobe = self.lobe(view, s.roughness);
            let reflected = if s.roughness < MIRROR_ROUGHNESS { mirrored } else { base_fresnel(s, lobe.cos_i, inside) };
            self.push(view, s.normal_geometric, lobe.direction, below * reflected * lobe.share, medium);
        }
        if coat > 0.0 {
            let lobe = self.lobe(view, s.clearcoat_roughness);
            self.push(view, s.normal_geometric, lobe.direction, view.throughput * (coat * lobe.share), medium);
        }

        // Transmission: bent by Snell's law at the face of a closed body, straight on through a thin sheet.
        if s.transmission > 0.0 {
            let solid = s.thickness > 0.0;
            let eta = if inside { s.ior.recip() } else { s.ior };
            let refracted = if solid { refract(v, s.normal, eta) } else { Some(-v) };
            let passes = 1.0 - fresnel_dielectric(n_v, eta);
            if let Some(direction) = refracted {
                let weight = below * s.base * (s.transmission * (1.0 - s.metallic) * passes);
                let medium = match (solid, inside) {
                    (true, false) => s.absorption_per_m,
                    (true, true) => DVec3::ZERO,
                    (false, _) => view.absorption_per_m,
                };
                self.push(view, -s.normal_geometric, direction, weight, medium);
            }
        }
    }

    fn push(&mut self, view: &View, side: DVec3, direction: DVec3, throughput: DVec3, absorption_per_m: DVec3) {
        let depth = view.depth + 1;
        if depth > self.sample.max_depth || self.rays_made >= MAX_RAYS || throughput.max_element() < MIN_THROUGHPUT {
            return;
        }
        self.rays_made += 1;
        let ray = Ray::new(offset_origin(view.s.position_m, side), direction);
        self.pending.push(Pending { ray, throughput, depth, absorption_per_m });
    }

    /// The way in which a lobe sends the ray on.
    fn lobe(&self, view: &View, roughness: f64) -> Lobe {
        let View { s, v, .. } = *view;
        if roughness < MIRROR_ROUGHNESS {
            // A bent normal may send a mirrored ray below the true surface; it is lifted to the horizon.
            let mirrored = v.reflect(s.normal) * -1.0;
            let height = mirrored.dot(s.normal_geometric);
            let lifted = mirrored - s.normal_geometric * (height - 1e-3);
            let direction = if height > 0.0 { mirrored } else { lifted.normalize() };
            return Lobe { direction, cos_i: view.n_v(), share: 1.0 };
        }

        let alpha = roughness * roughness;
        let random = secondary_random(self.sample.pixel, self.sample.index, self.rays_made, self.sample.seed_words);
        let m = sample_visible_normal(s.normal, v, alpha, random);
        let direction = v.reflect(m) * -1.0;
        let n_l = direction.dot(s.normal);
        let above = n_l > 0.0 && direction.dot(s.normal_geometric) > 0.0;
        // What is left of the estimator when visible normals are sampled: G2 / G1 (Heitz 2018, section 3).
        let n_v = s.normal.dot(v);
        let share = if above { ggx_g2(n_v, n_l, alpha) * (1.0 + ggx_lambda(n_v, alpha)) } else { 0.0 };
        Lobe { direction, cos_i: m.dot(v).max(0.0), share }
    }
}

/// A direction out of a lobe.
struct Lobe {
    direction: DVec3,
    /// Between the view and the microfacet.
    cos_i: f64,
    /// What masking leaves of it; 0 below the surface.
    share: f64,
}

impl View<'_> {
    fn n_v(&self) -> f64 {
        self.s.normal.dot(self.v).max(1e-4)
    }

    /// What the coat reflects. There is none on the inside of a body.
    fn coat(&self) -> f64 {
        if self.inside { 0.0 } else { self.s.clearcoat * fresnel_dielectric(self.n_v(), COAT_IOR) }
    }
}

/// Snell's law: the way on of a look that arrives along −v, `eta` being the index behind over the index in front; `None` at
/// total internal reflection.
pub fn refract(v: DVec3, n: DVec3, eta: f64) -> Option<DVec3> {
    let cos_i = v.dot(n);
    let sin2_t = (1.0 - cos_i * cos_i) / (eta * eta);
    (sin2_t < 1.0).then(|| ((n * cos_i - v) / eta - n * (1.0 - sin2_t).sqrt()).normalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refraction_follows_snell() {
        let n = DVec3::new(0.3, 0.9, -0.2).normalize();
        let tangent = n.any_orthonormal_vector();
        for (angle, eta) in [(0.0f64, 1.5), (0.7, 1.5), (1.4, 1.33), (0.5, 1.0 / 1.5), (1.2, 1.0)] {
            let v = n * angle.cos() + tangent * angle.sin();
            let d = refract(v, n, eta).expect("below the critical angle");
            assert!((d.length() - 1.0).abs() < 1e-12);
            assert!((d.cross(n).length() * eta - angle.sin()).abs() < 1e-12, "sin θ / sin θt is not the index");
            assert!(d.dot(n) < 0.0 && d.dot(tangent) <= 1e-12 && d.dot(v.cross(n)).abs() < 1e-12);
            // The way back is the same way.
            let back = refract(d, -n, 1.0 / eta).expect("what got in gets out");
            assert!((back - v).length() < 1e-9, "{back} {v}");
        }
        let critical = (1.0f64 / 1.5).asin();
        let beyond = critical + 1e-6;
        assert_eq!(refract(n * beyond.cos() + tangent * beyond.sin(), n, 1.0 / 1.5), None);
    }

    #[test]
    fn a_point_belongs_to_the_nearest_viewer_in_front() {
        let s = Surface::white();
        let (behind, near, far) = (DVec3::new(0.0, 0.0, -0.1), DVec3::new(0.0, 1.0, 1.0), DVec3::new(0.0, 0.0, 3.0));
        assert_eq!(viewer_of(&s, &[behind, far, near]), Some(near));
        assert_eq!(viewer_of(&s, &[behind]), None);
        let bent = Surface { normal: DVec3::new(0.0, -0.9, 0.3).normalize(), ..s };
        assert_eq!(viewer_of(&bent, &[near, far]), Some(far), "both normals count");
    }
}
