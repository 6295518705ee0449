//! What a miss sees, and what a diffuse surface receives from all around: twin of `environment.glsl`.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};
use lantern_scene::pack::GpuEnvironment;

fn texel(environment: &GpuEnvironment, x: i64, y: i64) -> DVec3 {
    let x = x.rem_euclid(i64::from(environment.width));
    let y = y.clamp(0, i64::from(environment.height) - 1);
    let [r, g, b, _] = environment.texels[(y * i64::from(environment.width) + x) as usize].map(f64::from);
    DVec3::new(r, g, b)
}

/// Linear radiance from a unit direction: the map's middle is −Z, its top row is +Y (CONTRACT, Config).
pub fn environment_radiance(environment: &GpuEnvironment, direction: DVec3) -> DVec3 {
    let u = 0.5 + direction.x.atan2(-direction.z) / (2.0 * PI);
    let v = direction.y.clamp(-1.0, 1.0).acos() / PI;
    let at = DVec2::new(u * f64::from(environment.width), v * f64::from(environment.height)) - 0.5;
    let corner = at.floor();
    let f = at - corner;
    let (x, y) = (corner.x as i64, corner.y as i64);
    let top = texel(environment, x, y).lerp(texel(environment, x + 1, y), f.x);
    let bottom = texel(environment, x, y + 1).lerp(texel(environment, x + 1, y + 1), f.x);
    top.lerp(bottom, f.y)
}

/// What a white diffuse surface of a normal shows under the whole environment: its irradiance over π, from nine
/// coefficients (Ramamoorthi and Hanrahan, SIGGRAPH 2001). Never below 0, which a truncated series may be.
pub fn irradiance_over_pi(environment: &GpuEnvironment, n: DVec3) -> DVec3 {
    let polynomials =
        [1.0, n.y, n.z, n.x, n.x * n.y, n.y * n.z, 3.0 * n.z * n.z - 1.0, n.x * n.z, n.x * n.x - n.y * n.y];
    let sum: DVec3 = environment
        .irradiance
        .iter()
        .zip(polynomials)
        .map(|([r, g, b, _], p)| DVec3::new(f64::from(*r), f64::from(*g), f64::from(*b)) * p)
        .sum();
    sum.max(DVec3::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four columns of two rows; the lower row is brighter by 10.
    fn compass() -> GpuEnvironment {
        let row = [[3.0; 4], [4.0; 4], [1.0; 4], [2.0; 4]];
        let (up, down) = (row, row.map(|texel: [f32; 4]| texel.map(|c| c + 10.0)));
        GpuEnvironment { width: 4, height: 2, texels: [up, down].concat(), irradiance: [[0.0; 4]; 9] }
    }

    #[test]
    fn the_middle_looks_along_minus_z_and_the_seam_is_closed() {
        let look = |x: f64, y: f64, z: f64| environment_radiance(&compass(), DVec3::new(x, y, z).normalize()).x;
        // Between columns 1 and 2, half way between the rows.
        assert!((look(0.0, 0.0, -1.0) - (2.5 + 5.0)).abs() < 1e-9);
        assert!((look(1e-12, 0.0, 1.0) - look(-1e-12, 0.0, 1.0)).abs() < 1e-9);
        assert!((look(1.0, 0.0, 0.0) - (1.5 + 5.0)).abs() < 1e-9, "+X is a quarter to the right of the middle");
        assert!(look(0.0, 1.0, 0.0) < look(0.0, -1.0, 0.0));
    }

    #[test]
    fn a_constant_is_its_own_irradiance() {
        let mut environment = compass();
        environment.irradiance[0] = [0.7, 0.8, 0.9, 0.0];
        let seen = irradiance_over_pi(&environment, DVec3::new(0.6, -0.8, 0.0));
        assert!((seen - DVec3::new(0.7, 0.8, 0.9)).length() < 1e-6);
    }
}
