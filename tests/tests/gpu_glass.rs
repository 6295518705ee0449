//! Light that goes through things, and whole pictures: the GPU's against the oracle's.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::sync::Arc;

use glam::{DVec2, DVec3, UVec2};
use lantern_calibration::Calibration;
use lantern_render::{Layer, Settings};
use lantern_scene::Scene;
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent},
    image::{FloatImage, percentile},
    oracle::{
        self, World,
        geometry::Ray,
        jitter::seed_words,
        primary::{primary_hit, primary_ray},
        secondary::{Sample, radiance},
    },
    stage::{Stand, demo, editor_of, scene_of, shared_data},
};
use serde_json::{Value, json};

const SIZE_PX: UVec2 = UVec2::new(160, 100);
const EYE_M: DVec3 = DVec3::new(0.8, 1.4, 3.0);

/// A ball on a checkered floor in the studio.
fn ball(ior: f64) -> Value {
    json!([
        {"add": {"node": "floor", "uri": "lantern:checker", "scale": [0.4, 0.4, 0.4]}},
        {"add": {"node": "ball", "uri": "lantern:sphere", "translation_m": [0, 0.5, 0], "scale": [0.5, 0.5, 0.5]}},
        {"material": {"name": "ball/sphere", "base_color": [1, 1, 1], "roughness": 0, "metallic": 0, "transmission": 1,
                      "thickness": 1, "ior": ior}},
        {"environment": {"uri": "lantern:studio"}},
        {"light": {"name": "sun", "kind": "directional", "direction": [-0.5, -1, -0.6], "intensity": 2.5}},
    ])
}

fn stand() -> Stand {
    Stand { fov_y_rad: 0.4, ..Stand::new(DVec3::new(-0.4, 1.6, 3.2), DVec3::new(0.0, 0.5, 0.0), SIZE_PX) }
}

/// Radiance of both, its absolute errors in ascending order, and their mean, over the pixels that `counts` takes.
fn errors(found: &FloatImage, expected: &FloatImage, counts: impl Fn(usize) -> bool) -> (Vec<f64>, f64) {
    let of = (0..found.values.len()).filter(|at| counts(at / 3));
    let mut errors: Vec<f64> = of.map(|at| f64::from((found.values[at] - expected.values[at]).abs())).collect();
    errors.sort_by(f64::total_cmp);
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    (errors, mean)
}

/// The oracle's picture beside the GPU's.
fn both(scene: &Arc<Scene>, name: &str, calibration: Calibration, samples: u32, eye_m: DVec3) -> [FloatImage; 3] {
    let rig = Rig::shown(scene, &[(name, calibration)], Settings { samples, ..ONE_SAMPLE }, &[eye_m]);
    let settings = oracle::Settings::new(name, samples, ONE_SAMPLE.max_depth, eye_m);
    let picture = oracle::render(&World::new(scene), &rig.frusta[0], &settings, 1);
    let expected = FloatImage::from_oracle(&picture, lantern_proto::Layer::Radiance).unwrap();
    [rig.layer(0, Layer::Radiance), expected, rig.layer(0, Layer::Node)]
}

#[test]
fn a_glass_ball_is_the_oracles() {
    let scene = scene_of(ball(1.5));
    for samples in [1, 4] {
        let [found, expected, node] = both(&scene, "left", stand().calibration(), samples, EYE_M);
        let (all, mean) = errors(&found, &expected, |at| node.values[at] == 1.0);
        println!(
            "glass, {samples} samples: {} values, mean error {mean:.2e}, 99 % {:.2e}",
            all.len(),
            percentile(&all, 0.99)
        );
        assert!(all.len() > 3 * 2000, "{}", all.len());
        assert!(mean <= 0.01, "{mean}");
        // It is a picture, and not a constant that would be met by chance.
        let (contrast, _) =
            errors(&found, &FloatImage { values: vec![0.3; found.values.len()], ..found.clone() }, |_| true);
        assert!(percentile(&contrast, 0.5) > 0.05);
    }
    assert_validation_is_silent();
}

/// Where the eye sees the ball of index 1, it sees what it would see without one; and the floor does not know of it.
#[test]
fn glass_of_index_one_vanishes() {
    let scene = scene_of(ball(1.0));
    let mut without = ball(1.0);
    without.as_array_mut().unwrap().drain(1..3);
    let without = scene_of(without);
    let projectors = [("left", stand().calibration())];
    let mut rig = Rig::shown(&scene, &projectors, ONE_SAMPLE, &[EYE_M]);
    let (node, found) = (rig.layer(0, Layer::Node), rig.layer(0, Layer::Radiance));
    rig.renderer.set_scene(without.clone());
    rig.show(&[EYE_M]);
    let floor = rig.layer(0, Layer::Radiance);
    let (off, _) = errors(&found, &floor, |at| node.values[at] == 0.0);
    assert!(off.len() > 3 * 2000 && percentile(&off, 1.0) <= 1e-5, "{} {}", off.len(), percentile(&off, 1.0));

    let (world, empty) = (World::new(&scene), World::new(&without));
    let words = seed_words("left", 1);
    let mut off = Vec::new();
    for at in (0..node.values.len()).filter(|&at| node.values[at] == 1.0) {
        let pixel = UVec2::new(at as u32 % SIZE_PX.x, at as u32 / SIZE_PX.x);
        let ray = primary_ray(&rig.frusta[0], pixel, DVec2::splat(0.5)).unwrap();
        let Some(hit) = primary_hit(&world, ray).filter(|hit| hit.node == 1) else { continue };
        let (at_m, way) = (hit.surface.position_m, EYE_M - hit.surface.position_m);
        if way.normalize().dot(hit.surface.normal) < 0.05 || way.dot(hit.surface.normal_geometric) <= 0.0 {
            continue; // The eye does not see this side.
        }
        let sample = Sample { pixel, index: 0, seed_words: &words, max_depth: 8 };
        let expected = radiance(&empty, Ray::new(at_m, -way.normalize()), sample);
        let found = found.at(pixel.x as usize, pixel.y as usize);
        off.push((expected.as_vec3() - glam::Vec3::from_slice(found)).abs().max_element());
    }
    off.sort_by(f32::total_cmp);
    let mean = off.iter().sum::<f32>() / off.len() as f32;
    let close = off.iter().filter(|off| **off <= 1e-3).count() as f64 / off.len() as f64;
    println!("index 1: {} pixels, mean error {mean:.2e}, within 0.001 on {:.2} %", off.len(), close * 100.0);
    assert!(off.len() > 1000, "{}", off.len());
    assert!(mean <= 0.01 && close >= 0.99, "{mean} {close}");
    assert_validation_is_silent();
}

/// The whole demo: mirror, glass, car paint with its rough lobe and its coat, matte floor, sun and studio. Of f32 and f64
/// every ray may part at an edge, a reflected one sooner: hence a mean, and a share, and no maximum.
#[test]
fn the_demo_is_the_oracles() {
    let (scene, projectors, eye_m) = demo(SIZE_PX);
    for (name, calibration) in &projectors {
        let [found, expected, _] = both(&scene, name, calibration.clone(), 4, eye_m);
        let (all, mean) = errors(&found, &expected, |_| true);
        let close = all.iter().filter(|off| **off <= 0.01).count() as f64 / all.len() as f64;
        println!("demo, {name}: mean error {mean:.2e}, within 0.01 on {:.3} %", close * 100.0);
        assert!(mean <= 0.002 && close >= 0.99, "{name}: {mean} {close}");
    }
    assert_validation_is_silent();
}

/// A real model with textures of every kind, and glass: FlightHelmet.
#[test]
fn the_helmet_is_the_oracles() {
    let Some(data) = shared_data("FlightHelmet") else { return };
    let edits = json!([
        {"add": {"node": "floor", "uri": "lantern:quad"}},
        {"add": {"node": "helmet", "uri": "models/FlightHelmet/FlightHelmet.gltf"}},
        {"environment": {"uri": "environments/spiaggia_di_mondello_1k.hdr"}},
        {"light": {"name": "lamp", "kind": "spot", "position_m": [1, 2, 1], "direction": [-1, -1.7, -1], "intensity": 5.0,
                   "inner_cone_rad": 0.1, "outer_cone_rad": 0.4}},
    ]);
    let scene = editor_of(edits, vec![data]).current();
    let stand = Stand::new(DVec3::new(0.3, 0.6, 1.1), DVec3::new(0.0, 0.3, 0.0), SIZE_PX);
    let [found, expected, node] = both(&scene, "left", stand.calibration(), 1, DVec3::new(0.0, 0.7, 1.6));
    let (all, mean) = errors(&found, &expected, |at| node.values[at] == 1.0);
    let close = all.iter().filter(|off| **off <= 0.01).count() as f64 / all.len() as f64;
    println!("helmet: {} values, mean error {mean:.2e}, within 0.01 on {:.3} %", all.len(), close * 100.0);
    assert!(all.len() > 3 * 1500, "{}", all.len());
    assert!(mean <= 0.005 && close >= 0.98, "{mean} {close}");
    assert_validation_is_silent();
}
