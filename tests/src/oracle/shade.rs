//! Fresnel's equations, the GGX lobe, and which lobes a material has: twin of `microfacet.glsl`.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::surface::Surface;

/// Below this perceptual roughness a lobe is a mirror, and shows no punctual light.
pub const MIRROR_ROUGHNESS: f64 = 0.045;

/// From this roughness on, to 1, a dielectric's specular lobe fades to nothing.
pub const MATTE_FROM: f64 = 0.9;

/// Index of refraction of a clearcoat.
pub const COAT_IOR: f64 = 1.5;

/// The share of unpolarised light that a smooth dielectric reflects. `eta` is the index behind over the index in front;
/// at total internal reflection it is 1.
pub fn fresnel_dielectric(cos_i: f64, eta: f64) -> f64 {
    // Exactly nothing where there is no interface, not what rounding leaves.
    if eta == 1.0 {
        return 0.0;
    }
    let cos_i = cos_i.abs().min(1.0);
    let sin_t = (1.0 - cos_i * cos_i).sqrt() / eta;
    if sin_t >= 1.0 {
        return 1.0;
    }
    let cos_t = (1.0 - sin_t * sin_t).sqrt();
    let s_polarised = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    let p_polarised = (cos_t - eta * cos_i) / (cos_t + eta * cos_i);
    (s_polarised * s_polarised + p_polarised * p_polarised) / 2.0
}

/// Schlick's approximation, for metals (Computer Graphics Forum 13(3), 1994).
pub fn fresnel_schlick(f0: DVec3, cos_i: f64) -> DVec3 {
    f0 + (1.0 - f0) * (1.0 - cos_i).clamp(0.0, 1.0).powi(5)
}

/// The GGX distribution of microfacet normals, per steradian; `alpha` is the roughness squared.
pub fn ggx_d(n_h: f64, alpha: f64) -> f64 {
    if n_h <= 0.0 {
        return 0.0;
    }
    let cos2 = n_h * n_h;
    let tan2 = (1.0 - cos2) / cos2;
    let a2 = alpha * alpha;
    a2 / (PI * cos2 * cos2 * (a2 + tan2).powi(2))
}

/// Smith's Λ for GGX (Heitz, JCGT 3(2), 2014, equation 72).
pub fn ggx_lambda(n_x: f64, alpha: f64) -> f64 {
    let cos2 = n_x * n_x;
    let tan2 = (1.0 - cos2).max(0.0) / cos2;
    (-1.0 + (1.0 + alpha * alpha * tan2).sqrt()) / 2.0
}

/// Height-correlated masking and shadowing (the same, equation 99).
pub fn ggx_g2(n_v: f64, n_l: f64, alpha: f64) -> f64 {
    1.0 / (1.0 + ggx_lambda(n_v, alpha) + ggx_lambda(n_l, alpha))
}

/// A GGX lobe's response to a punctual light, n·l included: radiance per lux, before Fresnel; 0 where it is a mirror.
pub fn highlight(n: DVec3, v: DVec3, l: DVec3, roughness: f64) -> f64 {
    let (n_l, n_v) = (n.dot(l), n.dot(v).max(1e-4));
    if roughness < MIRROR_ROUGHNESS || n_l <= 0.0 {
        return 0.0;
    }
    let alpha = roughness * roughness;
    let h = (v + l).normalize();
    ggx_d(n.dot(h), alpha) * ggx_g2(n_v, n_l, alpha) / (4.0 * n_l * n_v) * n_l
}

/// A normal of a microfacet that `v` sees, around `n` (Heitz, JCGT 7(4), 2018). Both unit length, `random` in [0, 1)².
pub fn sample_visible_normal(n: DVec3, v: DVec3, alpha: f64, random: DVec2) -> DVec3 {
    let (t, b) = basis(n);
    let v = DVec3::new(v.dot(t), v.dot(b), v.dot(n));

    // To the hemisphere configuration, and a frame around the stretched view.
    let vh = DVec3::new(alpha * v.x, alpha * v.y, v.z).normalize();
    let across = vh.x * vh.x + vh.y * vh.y;
    let t1 = if across > 0.0 { DVec3::new(-vh.y, vh.x, 0.0) / across.sqrt() } else { DVec3::X };
    let t2 = vh.cross(t1);

    // A point of the projected half disc, back onto the hemisphere, and unstretched.
    let (r, phi) = (random.x.sqrt(), 2.0 * PI * random.y);
    let p1 = r * phi.cos();
    let blend = 0.5 * (1.0 + vh.z);
    let p2 = (1.0 - blend) * (1.0 - p1 * p1).sqrt() + blend * r * phi.sin();
    let nh = t1 * p1 + t2 * p2 + vh * (1.0 - p1 * p1 - p2 * p2).max(0.0).sqrt();
    let m = DVec3::new(alpha * nh.x, alpha * nh.y, nh.z.max(0.0)).normalize();
    t * m.x + b * m.y + n * m.z
}

/// Two vectors that make an orthonormal basis with n. Which two decides which random number makes which direction, so it
/// is the shaders' choice: Duff et al., JCGT 6(1), 2017.
fn basis(n: DVec3) -> (DVec3, DVec3) {
    let sign = if n.z >= 0.0 { 1.0 } else { -1.0 };
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (DVec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), DVec3::new(b, sign + n.y * n.y * a, -n.y))
}

/// How much of the base layer's specular lobe there is: a dielectric's fades out toward roughness 1, so that a matte
/// material looks the same from everywhere.
pub fn specular_scale(s: &Surface) -> f64 {
    let dielectric = if s.transmission > 0.0 {
        1.0
    } else {
        let x = ((s.roughness - MATTE_FROM) / (1.0 - MATTE_FROM)).clamp(0.0, 1.0);
        1.0 - x * x * (3.0 - 2.0 * x)
    };
    dielectric + (1.0 - dielectric) * s.metallic
}

/// The dielectric part's reflectance at normal incidence.
pub fn dielectric_f0(s: &Surface) -> f64 {
    ((s.ior - 1.0) / (s.ior + 1.0)).powi(2) * s.specular
}

/// The diffuse albedo. It does not depend on the eye.
pub fn diffuse_color(s: &Surface) -> DVec3 {
    s.base * ((1.0 - s.metallic) * (1.0 - s.transmission) * (1.0 - dielectric_f0(s) * specular_scale(s)))
}

/// What the base layer reflects at an angle. `inside`: the light arrives from within the body.
pub fn base_fresnel(s: &Surface, cos_i: f64, inside: bool) -> DVec3 {
    let eta = if inside { s.ior.recip() } else { s.ior };
    let dielectric = DVec3::splat(fresnel_dielectric(cos_i, eta) * s.specular);
    dielectric.lerp(fresnel_schlick(s.base, cos_i), s.metallic) * specular_scale(s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::SplitMix64;

    #[test]
    fn fresnel_has_its_limits() {
        assert!((fresnel_dielectric(1.0, 1.5) - 0.04).abs() < 1e-12);
        assert!((fresnel_dielectric(1.0, 1.0 / 1.5) - 0.04).abs() < 1e-12);
        assert!((fresnel_dielectric(1e-9, 1.5) - 1.0).abs() < 1e-6);
        // An index of 1 is no surface, at any angle.
        for i in 1..=100 {
            assert_eq!(fresnel_dielectric(f64::from(i) / 100.0, 1.0), 0.0);
        }
        // Total internal reflection begins at the critical angle, 41.81° for glass.
        let critical = (1.0f64 / 1.5).asin();
        assert_eq!(fresnel_dielectric((critical + 1e-6).cos(), 1.0 / 1.5), 1.0);
        assert!(fresnel_dielectric((critical - 1e-3).cos(), 1.0 / 1.5) < 0.95);
        // At Brewster's angle only one polarisation is reflected: half of sin²(θ − θt).
        let brewster = 1.5f64.atan();
        let refracted = (brewster.sin() / 1.5).asin();
        let expected = (brewster - refracted).sin().powi(2) / 2.0;
        assert!((fresnel_dielectric(brewster.cos(), 1.5) - expected).abs() < 1e-12);
        // What enters at an angle leaves by the same share at the refracted one.
        assert!(
            (fresnel_dielectric(0.6, 1.5) - fresnel_dielectric((1.0f64 - 0.64 / 2.25).sqrt(), 1.0 / 1.5)).abs() < 1e-12
        );
    }

    /// ∫ D(h) n·h dω = 1: the microfacets cover the surface once.
    #[test]
    fn ggx_covers_the_surface_once() {
        for alpha in [0.05, 0.3, 1.0] {
            let steps = 200_000;
            let sum: f64 = (0..steps)
                .map(|i| {
                    let theta = (f64::from(i) + 0.5) / f64::from(steps) * PI / 2.0;
                    ggx_d(theta.cos(), alpha) * theta.cos() * theta.sin() * 2.0 * PI * (PI / 2.0) / f64::from(steps)
                })
                .sum();
            assert!((sum - 1.0).abs() < 1e-4, "alpha {alpha}: {sum}");
        }
    }

    /// White furnace: by sampled visible normals (weight G2/G1) and by integration of the highlight over all lights, a lobe
    /// without Fresnel reflects the same, and never more than arrives.
    #[test]
    fn no_lobe_reflects_more_than_arrives_and_sampling_agrees_with_integration() {
        let n = DVec3::Z;
        let mut random = SplitMix64(3);
        for (roughness, angle) in [(0.3, 0.2f64), (0.6, 0.9), (1.0, 1.3), (0.8, 0.0)] {
            let (v, alpha) = (DVec3::new(angle.sin(), 0.0, angle.cos()), f64::powi(roughness, 2));
            let count = 200_000;
            let (mut sampled, mut integrated) = (0.0, 0.0);
            for _ in 0..count {
                let m = sample_visible_normal(n, v, alpha, DVec2::new(random.unit(), random.unit()));
                assert!(m.dot(v) > 0.0 && (m.length() - 1.0).abs() < 1e-9);
                let l = m * (2.0 * m.dot(v)) - v;
                if l.z > 0.0 {
                    sampled += (1.0 + ggx_lambda(v.z, alpha)) * ggx_g2(v.z, l.z, alpha) / f64::from(count);
                }
                let (z, phi) = (random.unit(), 2.0 * PI * random.unit());
                let r = (1.0 - z * z).sqrt();
                let l = DVec3::new(r * phi.cos(), r * phi.sin(), z);
                integrated += highlight(n, v, l, roughness) * 2.0 * PI / f64::from(count);
            }
            assert!(
                sampled <= 1.0 + 1e-9 && (sampled - integrated).abs() < 0.02,
                "{roughness}: {sampled} {integrated}"
            );
        }
    }

    #[test]
    fn a_matte_dielectric_has_no_specular_lobe_and_a_metal_keeps_it() {
        let mut s = Surface::white();
        s.roughness = 1.0;
        assert_eq!(specular_scale(&s), 0.0);
        assert_eq!(diffuse_color(&s), DVec3::ONE);
        s.metallic = 1.0;
        assert_eq!((specular_scale(&s), diffuse_color(&s)), (1.0, DVec3::ZERO));
        s.metallic = 0.0;
        s.roughness = 0.5;
        assert!((diffuse_color(&s).x - 0.96).abs() < 1e-12);
        s.ior = 1.0;
        assert_eq!(base_fresnel(&s, 0.3, false), DVec3::ZERO);
    }
}
