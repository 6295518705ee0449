//! Irradiance of a panorama as spherical harmonics: Ramamoorthi and Hanrahan, "An Efficient Representation for Irradiance
//! Environment Maps", SIGGRAPH 2001.

use std::f64::consts::{PI, TAU};

/// Irradiance over π as nine coefficients of order 2, for the polynomials 1; y, z, x; xy, yz, 3z²−1, xz, x²−y² of a
/// normal. The cosine lobe is convolved already and the basis' constants are folded in twice, so that the sum of
/// coefficient × polynomial is what a white diffuse surface of that normal shows.
///
/// A texel counts as constant, and each polynomial is integrated over its solid angle exactly: a panorama of one colour
/// gives that colour for every normal, whatever its size.
pub(crate) fn irradiance(width: usize, height: usize, texels: &[[f32; 4]]) -> [[f32; 4]; 9] {
    // Integrals over a texel are products of one of a row (θ from +Y) and one of a column (φ from −Z toward +X):
    // x = sin θ sin φ, y = cos θ, z = −sin θ cos φ, and dω = sin θ dθ dφ.
    let columns: Vec<[f64; 6]> = (0..width).map(|x| column_integrals(x, width)).collect();
    let mut sums = [[0f64; 3]; 9];
    for (y, row) in texels[..width * height].chunks_exact(width).enumerate() {
        // Over φ: 1, sin, cos, sin², cos², sin cos.
        let mut moments = [[0f64; 3]; 6];
        for (texel, column) in row.iter().zip(&columns) {
            for (moment, weight) in moments.iter_mut().zip(column) {
                for (sum, color) in moment.iter_mut().zip(texel) {
                    *sum += weight * f64::from(*color);
                }
            }
        }
        let [s, cs, ss, sss, css, ccs] = row_integrals(y, height);
        for channel in 0..3 {
            let [one, sin, cos, sin2, cos2, sin_cos] = moments.map(|moment| moment[channel]);
            let integrals = [
                s * one,
                cs * one,
                -ss * cos,
                ss * sin,
                css * sin,
                -css * cos,
                3.0 * sss * cos2 - s * one,
                -sss * sin_cos,
                sss * sin2 - ccs * one,
            ];
            for (sum, integral) in sums.iter_mut().zip(integrals) {
                sum[channel] += integral;
            }
        }
    }

    // The basis' constants squared (once for the projection, once for the evaluation) times the cosine lobe's share of
    // each band over π: 1, 2/3, 1/4.
    let band0 = 1.0 / (4.0 * PI);
    let band1 = 3.0 / (4.0 * PI) * 2.0 / 3.0;
    let (cross, zonal, square) = (15.0 / (4.0 * PI), 5.0 / (16.0 * PI), 15.0 / (16.0 * PI));
    let factors = [band0, band1, band1, band1, cross / 4.0, cross / 4.0, zonal / 4.0, cross / 4.0, square / 4.0];
    std::array::from_fn(|i| {
        let [r, g, b] = sums[i].map(|sum| (sum * factors[i]) as f32);
        [r, g, b, 0.0]
    })
}

/// Over one column: ∫1, ∫sin, ∫cos, ∫sin², ∫cos², ∫sin cos dφ.
fn column_integrals(x: usize, width: usize) -> [f64; 6] {
    let at = |x: usize| (x as f64 / width as f64 - 0.5) * TAU;
    let (a, b) = (at(x), at(x + 1));
    let wave = ((2.0 * b).sin() - (2.0 * a).sin()) / 4.0;
    let half = (b - a) / 2.0;
    [b - a, a.cos() - b.cos(), b.sin() - a.sin(), half - wave, half + wave, (b.sin().powi(2) - a.sin().powi(2)) / 2.0]
}

/// Over one row, sin θ of the solid angle included: ∫sin, ∫cos sin, ∫sin², ∫sin³, ∫sin² cos, ∫cos² sin dθ.
fn row_integrals(y: usize, height: usize) -> [f64; 6] {
    let at = |y: usize| y as f64 / height as f64 * PI;
    let (a, b) = (at(y), at(y + 1));
    let (sin_a, cos_a, sin_b, cos_b) = (a.sin(), a.cos(), b.sin(), b.cos());
    let cube = (cos_b.powi(3) - cos_a.powi(3)) / 3.0;
    [
        cos_a - cos_b,
        (sin_b.powi(2) - sin_a.powi(2)) / 2.0,
        (b - a) / 2.0 - ((2.0 * b).sin() - (2.0 * a).sin()) / 4.0,
        cube - (cos_b - cos_a),
        (sin_b.powi(3) - sin_a.powi(3)) / 3.0,
        -cube,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::direction_at;
    use glam::DVec3;

    fn evaluate(coefficients: &[[f32; 4]; 9], n: DVec3) -> [f64; 3] {
        let polynomials =
            [1.0, n.y, n.z, n.x, n.x * n.y, n.y * n.z, 3.0 * n.z * n.z - 1.0, n.x * n.z, n.x * n.x - n.y * n.y];
        [0, 1, 2].map(|c| coefficients.iter().zip(polynomials).map(|(k, p)| f64::from(k[c]) * p).sum())
    }

    fn normals() -> impl Iterator<Item = DVec3> {
        (0..200).map(|i| direction_at(f64::from(i) * 0.618_034 % 1.0, (f64::from(i) + 0.5) / 200.0))
    }

    fn panorama(width: usize, height: usize, radiance: impl Fn(DVec3) -> f64) -> Vec<[f32; 4]> {
        let at = |x, y| direction_at((x as f64 + 0.5) / width as f64, (y as f64 + 0.5) / height as f64);
        (0..width * height).map(|i| [radiance(at(i % width, i / width)) as f32, 0.0, 0.0, 0.0]).collect()
    }

    #[test]
    fn one_colour_gives_that_colour_for_every_normal_and_size() {
        for (width, height) in [(1, 1), (2, 1), (8, 4), (31, 7), (128, 64)] {
            let coefficients = irradiance(width, height, &vec![[0.25, 1.0, 7.0, 0.0]; width * height]);
            for n in normals() {
                for (found, expected) in evaluate(&coefficients, n).into_iter().zip([0.25, 1.0, 7.0]) {
                    assert!((found - expected).abs() < 1e-5 * expected, "{width} × {height} at {n}: {found}");
                }
            }
        }
    }

    #[test]
    fn radiance_linear_in_the_direction_gives_two_thirds_of_it() {
        // L = 1 + a·d is a band-1 function: E/π = 1 + (2/3) a·n, exactly.
        let a = DVec3::new(0.3, -0.5, 0.2);
        let coefficients = irradiance(256, 128, &panorama(256, 128, |d| 1.0 + a.dot(d)));
        for n in normals() {
            assert!((evaluate(&coefficients, n)[0] - (1.0 + 2.0 / 3.0 * a.dot(n))).abs() < 1e-3);
        }
    }

    #[test]
    fn every_band_two_function_comes_back_as_a_quarter_of_itself() {
        let functions: [fn(DVec3) -> f64; 5] =
            [|d| d.x * d.y, |d| d.y * d.z, |d| 3.0 * d.z * d.z - 1.0, |d| d.x * d.z, |d| d.x * d.x - d.y * d.y];
        for f in functions {
            let coefficients = irradiance(256, 128, &panorama(256, 128, f));
            for n in normals() {
                assert!((evaluate(&coefficients, n)[0] - f(n) / 4.0).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn a_cosine_lobe_is_within_the_method_s_error_of_its_true_irradiance() {
        // L = max(0, d.y). Facing it, E/π = (1/π) ∫ cos² dω over the half sphere = 2/3; facing away it is 0. The paper
        // bounds the error of order 2 at 9 % of the maximum.
        let coefficients = irradiance(512, 256, &panorama(512, 256, |d| d.y.max(0.0)));
        assert!((evaluate(&coefficients, DVec3::Y)[0] - 2.0 / 3.0).abs() < 0.06);
        assert!(evaluate(&coefficients, DVec3::NEG_Y)[0].abs() < 0.06);
    }
}
