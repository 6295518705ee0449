//! Jittered samples: how fast their error falls, and that a seed fixes a picture to the bit.

use std::sync::Arc;

use glam::{DVec3, UVec2};
use lantern_render::{Layer, Settings};
use lantern_scene::Scene;
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent},
    image::FloatImage,
    stage::{Stand, scene_of},
};
use serde_json::{Value, json};

const SIZE_PX: UVec2 = UVec2::new(96, 60);
const EYE_M: DVec3 = DVec3::new(0.8, 1.4, 3.0);

/// A ball on a checkered floor; `size` is that of the floor, in tenths of its squares.
fn ball(size: f64, material: Value) -> Arc<Scene> {
    let mut material = material;
    material["name"] = json!("ball/sphere");
    scene_of(json!([
        {"add": {"node": "floor", "uri": "lantern:checker", "scale": [size, size, size]}},
        {"add": {"node": "ball", "uri": "lantern:sphere", "translation_m": [0, 0.5, 0], "scale": [0.5, 0.5, 0.5]}},
        {"material": material},
        {"environment": {"uri": "lantern:studio"}},
    ]))
}

/// Frames, every sample shaded, of projectors that stand in one place and differ in their seeds, which are their names'.
fn rig(scene: &Arc<Scene>, names: &[&str], samples: u32) -> Rig {
    let stand = Stand { fov_y_rad: 0.4, ..Stand::new(DVec3::new(-0.4, 1.6, 3.2), DVec3::new(0.0, 0.5, 0.0), SIZE_PX) };
    let projectors: Vec<_> = names.iter().map(|name| (*name, stand.calibration())).collect();
    Rig::shown(scene, &projectors, Settings { samples, shade_once: false, ..ONE_SAMPLE }, &[EYE_M])
}

/// The mean squared error against a picture of 256 samples, for 1, 4 and 16 of them, inside of a node.
fn falling(scene: &Arc<Scene>, node: f32) -> [f64; 3] {
    let reference = rig(scene, &["reference"], 256).layer(0, Layer::Radiance);
    let seeds = ["a", "b", "c", "d"];
    let mut inside: Vec<bool> = Vec::new();
    [1, 4, 16].map(|samples| {
        let rig = rig(scene, &seeds, samples);
        if inside.is_empty() {
            let shown = rig.layer(0, Layer::Node);
            inside =
                shown.silhouettes(1).into_iter().zip(&shown.values).map(|(edge, of)| !edge && *of == node).collect();
            assert!(inside.iter().filter(|inside| **inside).count() > 300);
        }
        let pictures: Vec<FloatImage> = (0..seeds.len()).map(|i| rig.layer(i, Layer::Radiance)).collect();
        let of = pictures.iter().flat_map(|picture| picture.values.iter().zip(&reference.values).enumerate());
        let squares = of.filter(|(at, _)| inside[at / 3]).map(|(_, (a, b))| f64::from(a - b) * f64::from(a - b));
        let squares: Vec<f64> = squares.collect();
        squares.iter().sum::<f64>() / squares.len() as f64
    })
}

/// Independent samples' variance falls as 1/n; jittered ones' at least as fast, and near an edge, which crosses √n of the n
/// strata, as n^−1.5 (Mitchell, SIGGRAPH 1996). A quarter more is left to chance.
fn assert_falls(what: &str, [one, four, sixteen]: [f64; 3]) {
    println!(
        "{what}: squared error {one:.2e}, {four:.2e}, {sixteen:.2e}: ratios {:.2}, {:.2}",
        one / four,
        four / sixteen
    );
    assert!(one > 1e-5, "{what}: nothing varies");
    assert!(four <= one / 4.0 * 1.25, "{what}: from {one} to {four}");
    assert!(sixteen <= four / 4.0 * 1.25, "{what}: from {four} to {sixteen}");
}

#[test]
fn the_error_of_edges_falls_as_it_should() {
    // The floor's squares are a few pixels wide.
    assert_falls("checker", falling(&ball(0.11, json!({"roughness": 1, "metallic": 0})), 0.0));
    assert_validation_is_silent();
}

#[test]
fn the_error_of_a_rough_lobe_falls_as_it_should() {
    assert_falls("rough metal", falling(&ball(0.4, json!({"roughness": 0.5, "metallic": 1})), 1.0));
    assert_validation_is_silent();
}

#[test]
fn a_seed_is_a_picture() {
    let scene = ball(0.4, json!({"roughness": 0.3, "metallic": 0.5, "clearcoat": 1}));
    let rigs = [rig(&scene, &["left", "right"], 4), rig(&scene, &["left"], 4)];
    for layer in [Layer::Radiance, Layer::Distance, Layer::Color] {
        let bits = |rig: &Rig, projector: usize| -> Vec<u32> {
            rig.layer(projector, layer).values.iter().map(|value| value.to_bits()).collect()
        };
        assert!(bits(&rigs[0], 0) == bits(&rigs[1], 0), "{layer:?} differs from itself");
        assert!(bits(&rigs[0], 0) != bits(&rigs[0], 1), "{layer:?}: another seed, another picture");
    }
    assert_validation_is_silent();
}
