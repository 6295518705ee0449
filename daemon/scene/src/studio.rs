//! The builtin panorama `lantern:studio`: a dim sky over a dark floor, a warm key and a cool rim.

use glam::{DVec3, DVec3 as Rgb};

use crate::environment::{direction_at, from_texels};
use crate::pack::GpuEnvironment;

const WIDTH: u32 = 512;
const HEIGHT: u32 = 256;
/// Samples along each side of a texel, so that the softboxes have smooth edges.
const SUPERSAMPLES: u32 = 2;

/// A flat emitter seen from the middle, facing it.
struct Softbox {
    toward: DVec3,
    /// Half the sides as tangents of angles, sideways and upward.
    half: [f64; 2],
    radiance: Rgb,
}

/// Paints the studio.
pub(crate) fn studio() -> GpuEnvironment {
    let boxes = [
        // The warm key, high on the left; what a mirror shows first.
        Softbox { toward: DVec3::new(-0.75, 0.62, 0.55), half: [0.42, 0.3], radiance: Rgb::new(11.0, 8.6, 6.2) },
        // The cool rim, a tall strip on the right behind the things that are lit.
        Softbox { toward: DVec3::new(0.9, 0.28, -0.5), half: [0.1, 0.62], radiance: Rgb::new(3.6, 5.6, 8.4) },
        // A faint fill overhead, which draws the top edge of round things.
        Softbox { toward: DVec3::new(0.15, 1.0, -0.2), half: [0.7, 0.22], radiance: Rgb::new(1.7, 1.75, 1.9) },
    ];
    let mut texels = Vec::with_capacity((WIDTH * HEIGHT) as usize);
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let mut sum = Rgb::ZERO;
            for sample in 0..SUPERSAMPLES * SUPERSAMPLES {
                let offset = |index: u32| (f64::from(index) + 0.5) / f64::from(SUPERSAMPLES);
                let u = (f64::from(x) + offset(sample % SUPERSAMPLES)) / f64::from(WIDTH);
                let v = (f64::from(y) + offset(sample / SUPERSAMPLES)) / f64::from(HEIGHT);
                sum += radiance(direction_at(u, v), &boxes);
            }
            let mean = (sum / f64::from(SUPERSAMPLES * SUPERSAMPLES)).as_vec3();
            texels.push(mean.extend(0.0).to_array());
        }
    }
    from_texels(WIDTH, HEIGHT, texels)
}

fn radiance(d: DVec3, boxes: &[Softbox]) -> Rgb {
    // The sky darkens upward from a band of light along the horizon; the floor falls off quickly below it.
    let horizon = Rgb::new(0.62, 0.66, 0.74);
    let zenith = Rgb::new(0.07, 0.11, 0.22);
    let floor = Rgb::new(0.05, 0.045, 0.04);
    let background = if d.y >= 0.0 {
        zenith.lerp(horizon, (1.0 - d.y).powi(5))
    } else {
        floor.lerp(horizon * 0.45, (1.0 + d.y).powi(24))
    };
    // A softbox covers what is behind it.
    boxes.iter().fold(background, |behind, softbox| behind.lerp(softbox.radiance, coverage(softbox, d)))
}

/// How much of the direction a softbox covers: 1 inside, 0 outside, with an edge a few texels wide.
fn coverage(softbox: &Softbox, d: DVec3) -> f64 {
    let forward = softbox.toward.normalize();
    let right = forward.cross(DVec3::Y).normalize_or(DVec3::X);
    let up = right.cross(forward);
    let depth = d.dot(forward);
    if depth <= 0.0 {
        return 0.0;
    }
    let side = |axis: DVec3, half: f64| {
        let inside = ((half - (d.dot(axis) / depth).abs()) / 0.03).clamp(0.0, 1.0);
        inside * inside * (3.0 - 2.0 * inside)
    };
    side(right, softbox.half[0]) * side(up, softbox.half[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(environment: &GpuEnvironment, d: DVec3) -> [f32; 4] {
        let d = d.normalize();
        let u = 0.5 + d.x.atan2(-d.z) / std::f64::consts::TAU;
        let v = d.y.acos() / std::f64::consts::PI;
        let (x, y) = ((u * f64::from(WIDTH)) as usize, (v * f64::from(HEIGHT)) as usize);
        environment.texels[y.min(HEIGHT as usize - 1) * WIDTH as usize + x.min(WIDTH as usize - 1)]
    }

    #[test]
    fn the_key_is_warm_the_rim_cool_and_the_floor_dark() {
        let studio = studio();
        let key = at(&studio, DVec3::new(-0.75, 0.62, 0.55));
        let rim = at(&studio, DVec3::new(0.9, 0.28, -0.5));
        let floor = at(&studio, DVec3::NEG_Y);
        assert!(key[0] > 5.0 && key[0] > key[2], "{key:?}");
        assert!(rim[2] > 5.0 && rim[2] > rim[0], "{rim:?}");
        assert!(floor[0] < 0.1, "{floor:?}");
        assert!(studio.texels.iter().flatten().all(|c| c.is_finite() && *c >= 0.0));
    }
}
