//! However rays are walked, they find the same: to the bit, in every layer.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{f64::consts::FRAC_1_SQRT_2, sync::Arc};

use glam::{DVec3, UVec2};
use lantern_render::{Layer, Loads, Settings, Walk, stale::Stale};
use lantern_scene::Scene;
use lantern_tests::{
    gpu::{Rig, assert_validation_is_silent, device},
    stage::{Stand, demo, editor_of, scene_of, shared_data},
};
use serde_json::json;

const LAYERS: [Layer; 4] = [Layer::Color, Layer::Depth, Layer::Radiance, Layer::Node];

/// The bits of every layer of a projector, and how many primary rays there were.
fn seen(scene: &Arc<Scene>, stand: Stand, eye_m: DVec3, settings: Settings) -> (Vec<Vec<u32>>, u32) {
    let settings = Settings { count_rays: true, ..settings };
    let mut rig = Rig::new(scene, &[("left", stand.calibration())], settings);
    let report = rig.show(&[eye_m]).unwrap();
    (bits(&rig, 0), report.projectors[0].rays.unwrap().primary)
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

const ALONE: Walk = Walk { beams: Some(false), ..Walk::BY_DEVICE };
const BEAMS: Walk = Walk { beams: Some(true), ..Walk::BY_DEVICE };

/// The bits of every layer of a projector.
fn bits(rig: &Rig, projector: usize) -> Vec<Vec<u32>> {
    LAYERS.map(|layer| rig.layer(projector, layer).values.iter().map(|v| v.to_bits()).collect()).to_vec()
}

/// The bits of every layer of the demo's two projectors.
fn demo_seen(size_px: UVec2, walk: Walk) -> [Vec<Vec<u32>>; 2] {
    let (scene, projectors, eye_m) = demo(size_px);
    let projectors: Vec<_> = projectors.iter().map(|(name, of)| (name.as_str(), of.clone())).collect();
    let rig = Rig::shown(&scene, &projectors, Settings { walk, ..Settings::default() }, &[eye_m]);
    [0, 1].map(|projector| bits(&rig, projector))
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
        for samples in [1, 4, 9, 25] {
            let of =
                |walk| seen(&corner(), stand, eye_m, Settings { samples, blend: false, walk, ..Settings::default() });
            let alone = of(ALONE);
            assert_eq!(alone.1, samples * size_px.x * size_px.y);
            assert!(of(BEAMS) == alone, "{samples} samples in beams differ from single ones");
        }
    }
    assert!(demo_seen(size_px, ALONE) == demo_seen(size_px, BEAMS), "the demo differs in beams");
    assert_validation_is_silent();
}

fn through(loads: Loads) -> Walk {
    Walk { loads: Some(loads), ..Walk::BY_DEVICE }
}

#[test]
fn storage_buffers_show_what_texel_buffers_show() {
    let size_px = UVec2::new(97, 61);
    let [texel, storage] = [Loads::Texel, Loads::Storage].map(|loads| demo_seen(size_px, through(loads)));
    assert!(texel == storage, "the demo differs");

    // Textures, a rasterised node and an environment of many colours.
    let Some(data) = shared_data("a model with textures through storage buffers") else { return };
    let edits = json!([
        {"environment": {"uri": "lantern:studio"}},
        {"add": {"node": "helmet", "uri": "models/FlightHelmet/FlightHelmet.gltf"}},
        {"add": {"node": "ball", "uri": "lantern:sphere", "role": "raster", "scale": [0.1, 0.1, 0.1], "translation_m": [0.3, 0.3, 0.2]}},
        {"light": {"name": "lamp", "kind": "point", "position_m": [0.5, 2, 1], "intensity": 9.0}},
    ]);
    let scene = editor_of(edits, vec![data]).current();
    let stand = Stand::new(DVec3::new(-0.4, 0.7, 1.0), DVec3::new(0.0, 0.35, 0.0), size_px);
    let of = |loads| {
        seen(&scene, stand, DVec3::new(0.3, 0.6, 1.0), Settings { walk: through(loads), ..Settings::default() })
    };
    assert!(of(Loads::Texel) == of(Loads::Storage), "the helmet differs");
    assert_validation_is_silent();
}

#[test]
fn a_scene_that_outgrows_texel_buffers_goes_on_through_storage_buffers() {
    let size_px = UVec2::new(97, 61);
    let eye_m = DVec3::new(0.3, 1.2, 1.5);
    let stand = Stand::new(DVec3::new(-1.1, 1.5, 1.5), DVec3::new(0.0, 0.2, 0.0), size_px);
    let small = scene_of(json!([{"add": {"node": "floor", "uri": "lantern:checker", "scale": [0.2, 0.2, 0.2]}}]));

    // Enough for the small scene, and far too few for what else stands in the corner.
    let few = Walk { texel_elements: Some(4096), ..Walk::BY_DEVICE };
    let rig = |walk| {
        let settings = Settings { samples: 1, blend: false, walk, ..Settings::default() };
        Rig::new(&small, &[("left", stand.calibration())], settings)
    };
    let (mut outgrown, mut roomy) = (rig(few), rig(Walk::BY_DEVICE));
    let mut show = |scene: &Arc<Scene>| {
        let [loads, other] = [&mut outgrown, &mut roomy].map(|rig| {
            rig.renderer.set_scene(scene.clone());
            while rig.renderer.is_uploading() {
                rig.show(&[eye_m]);
            }
            (rig.renderer.loads(), bits(rig, 0))
        });
        assert!(loads.1 == other.1, "pictures differ");
        [loads.0, other.0]
    };
    let suits = Loads::of_device(device().info());
    assert_eq!(show(&small), [suits; 2]);
    assert_eq!(show(&corner()), [Loads::Storage, suits]);
    assert_eq!(show(&small), [suits; 2]);

    // What no way holds is refused by name, and the scene before goes on.
    let neither = Walk { loads: Some(Loads::Texel), ..few };
    let mut rig = rig(neither);
    rig.show(&[eye_m]);
    let before = bits(&rig, 0);
    let refused = rig.renderer.prepare(vec![corner()]).unwrap_err().to_string();
    assert!(refused.starts_with("blas_nodes: ") && refused.contains("the device allows 4096"), "{refused}");
    rig.renderer.make_stale(Stale::EVERYTHING);
    rig.show(&[eye_m]);
    assert!(bits(&rig, 0) == before);
    assert_validation_is_silent();
}
