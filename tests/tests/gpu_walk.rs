//! However rays are walked, they find the same: to the bit, in every layer.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{f64::consts::FRAC_1_SQRT_2, sync::Arc};

use glam::{DVec3, UVec2};
use lantern_render::{Layer, Settings};
use lantern_scene::Scene;
use lantern_tests::{
    gpu::{Rig, assert_validation_is_silent},
    stage::{Stand, demo, scene_of},
};
use serde_json::json;

const LAYERS: [Layer; 4] = [Layer::Color, Layer::Depth, Layer::Radiance, Layer::Node];

/// The bits of every layer of a projector, and how many primary rays there were.
fn seen(scene: &Arc<Scene>, stand: Stand, eye_m: DVec3, settings: Settings) -> (Vec<Vec<u32>>, u32) {
    let settings = Settings { count_rays: true, ..settings };
    let mut rig = Rig::new(scene, &[("left", stand.calibration())], settings);
    let report = rig.show(&[eye_m]).unwrap();
    let bits = |layer| rig.layer(0, layer).values.iter().map(|v| v.to_bits()).collect();
    (LAYERS.into_iter().map(bits).collect(), report.projectors[0].rays.unwrap().primary)
}

/// Things that touch, cross and stand turned, before a wall that is there twice: which of two equally near ones is met must not
/// depend on the order of a walk.
fn corner() -> Arc<Scene> {
    let wall = |name: &str| {
        json!({"add": {"node": name, "uri": "lantern:quad", "scale": [3, 1, 3], "rotation": [FRAC_1_SQRT_2, 0, 0, FRAC_1_SQRT_2],
                       "translation_m": [0, 0, -1]}})
    };
    scene_of(json!([
        {"add": {"node": "floor", "uri": "lantern:checker", "scale": [0.2, 0.2, 0.2]}},
        wall("wall"),
        wall("wall again"),
        {"add": {"node": "ball", "uri": "lantern:sphere", "scale": [0.3, 0.3, 0.3], "translation_m": [0, 0.3, 0]}},
        {"add": {"node": "egg", "uri": "lantern:sphere", "scale": [0.1, 0.4, 0.2], "translation_m": [0.4, 0.3, 0.2],
                 "rotation": [0.1825742, 0.3651484, 0.5477226, 0.7302967]}},
        {"add": {"node": "mirrored", "uri": "lantern:teapot", "scale": [-0.8, 0.8, 0.8], "translation_m": [-0.5, 0, 0.2]}},
        {"light": {"name": "lamp", "kind": "point", "position_m": [0.5, 2, 1], "intensity": 9.0}},
    ]))
}

#[test]
fn beams_find_what_single_rays_find() {
    let size_px = UVec2::new(173, 101);
    let eye_m = DVec3::new(0.3, 1.2, 1.5);

    // The second looks straight down an axis: its beams in the middle run both up and down along the others.
    let stands = [
        Stand::new(DVec3::new(-1.1, 1.5, 1.5), DVec3::new(0.0, 0.2, 0.0), size_px),
        Stand::new(DVec3::new(0.0, 0.3, 2.0), DVec3::new(0.0, 0.3, 0.0), size_px),
    ];
    for stand in stands {
        for samples in [1, 4, 9] {
            let of = |beams| Settings { samples, blend: false, beams: Some(beams), ..Settings::default() };
            let (alone, rays) = seen(&corner(), stand, eye_m, of(false));
            assert_eq!(rays, samples * size_px.x * size_px.y);
            assert_eq!(seen(&corner(), stand, eye_m, of(true)), (alone, rays), "{samples} samples");
        }
    }
    let (scene, projectors, eye_m) = demo(size_px);
    let shown = |beams| {
        let projectors: Vec<_> = projectors.iter().map(|(name, of)| (name.as_str(), of.clone())).collect();
        let rig = Rig::shown(&scene, &projectors, Settings { beams: Some(beams), ..Settings::default() }, &[eye_m]);
        [0, 1].map(|projector| LAYERS.map(|layer| rig.layer(projector, layer).values))
    };
    assert!(shown(true) == shown(false), "the demo differs");
    assert_validation_is_silent();
}
