//! Distance and depth where the samples of a pixel land on different things: the closest sample's, never a mean, which would
//! lie on no surface (PAPER.md, Hybrid Rendering).

use glam::{DVec3, UVec2};
use lantern_render::{Layer, Settings};
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent},
    oracle::{
        World,
        jitter::{sample_offset, seed_words},
        primary::{primary_hit, primary_ray},
    },
    stage::{Stand, scene_of},
};
use serde_json::json;

const SIZE_PX: UVec2 = UVec2::new(320, 200);
/// Of window z: four units of a depth buffer of 24 bits, since surfaces that are seen edge-on are steep.
const FOUR_UNITS: f64 = 4.0 / 16_777_216.0;

#[test]
fn the_closest_sample_counts_and_no_mean() {
    let scene = scene_of(json!([
        {"add": {"node": "floor", "uri": "lantern:quad", "scale": [8, 1, 8]}},
        {"add": {"node": "ball", "uri": "lantern:sphere", "translation_m": [-0.4, 0.5, 0.2], "scale": [0.3, 0.3, 0.3]}},
        {"add": {"node": "box", "uri": "lantern:cube", "translation_m": [0.4, 0.4, 0], "scale": [0.5, 0.8, 0.5]}},
    ]));
    let world = World::new(&scene);
    let stand = Stand { fov_y_rad: 0.4, ..Stand::new(DVec3::new(0.3, 1.2, 2.8), DVec3::new(0.0, 0.42, 0.0), SIZE_PX) };
    for samples in [4, 16] {
        let settings = Settings { samples, max_depth: 0, ..ONE_SAMPLE };
        let rig = Rig::shown(&scene, &[("left", stand.calibration())], settings, &[DVec3::Y]);
        let (distance, depth) = (rig.layer(0, Layer::Distance), rig.layer(0, Layer::Depth));
        let (frustum, words) = (&rig.frusta[0], seed_words("left", samples));
        let (mut edges, mut closest, mut of_a_sample, mut depth_fits, mut mean_is_far) = (0, 0, 0, 0, 0);
        for at in 0..distance.values.len() as u32 {
            let pixel = UVec2::new(at % SIZE_PX.x, at / SIZE_PX.x);
            let hits: Vec<(f64, f64)> = (0..samples)
                .filter_map(|sample| {
                    let ray = primary_ray(frustum, pixel, sample_offset(pixel, sample, &words))?;
                    let t_m = primary_hit(&world, ray)?.hit.t_m;
                    Some((t_m, frustum.project(ray.at(t_m))?.window_z))
                })
                .collect();
            let found_m = f64::from(distance.values[at as usize]);
            let Some(nearest) = hits.iter().copied().reduce(|a, b| if b.0 < a.0 { b } else { a }) else { continue };
            let farthest_m = hits.iter().map(|(t_m, _)| *t_m).fold(0.0, f64::max);
            if farthest_m < nearest.0 * 1.03 {
                continue;
            }

            // An edge: what was found is one of the samples, the closest.
            edges += 1;
            let near = |t_m: f64| (found_m - t_m).abs() <= 1e-5 * t_m;
            closest += usize::from(near(nearest.0));
            of_a_sample += usize::from(hits.iter().any(|(t_m, _)| near(*t_m)));
            depth_fits += usize::from((f64::from(depth.values[at as usize]) - nearest.1).abs() <= FOUR_UNITS);
            let mean_m = hits.iter().map(|(t_m, _)| t_m).sum::<f64>() / hits.len() as f64;
            mean_is_far += usize::from(mean_m > nearest.0 * 1.005);
        }
        let share = |count: usize| count as f64 / edges as f64;
        println!(
            "{samples} samples, {edges} edge pixels: closest {:.4}, one of the samples {:.4}, depth of it {:.4}; \
             a mean is off by more than 0.5 % on {:.4}",
            share(closest),
            share(of_a_sample),
            share(depth_fits),
            share(mean_is_far)
        );
        assert!(edges > 200, "{edges}");
        assert!(share(closest) >= 0.995 && share(of_a_sample) >= 0.995 && share(depth_fits) >= 0.995);
        assert!(share(mean_is_far) >= 0.9, "this would not tell a mean from the closest");
    }
    assert_validation_is_silent();
}
