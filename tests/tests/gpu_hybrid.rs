//! Traced and rasterised things in one picture, and what each role is seen by (CONTRACT, Roles; PAPER.md, Figure 6).

use std::sync::Arc;

use glam::{DVec2, DVec3, UVec2};
use lantern_calibration::{Calibration, Convention, Frustum};
use lantern_render::{Layer, RasterOrder, Settings};
use lantern_scene::Scene;
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent},
    image::FloatImage,
    stage::{Stand, editor_of, edits_of, scene_of, still_life},
};
use serde_json::{Value, json};

const EYE_M: DVec3 = DVec3::new(0.8, 1.4, 3.0);
/// Two units of a depth buffer of 24 bits.
const TWO_UNITS: f32 = 2.0 / 16_777_216.0;

fn stand(size_px: UVec2) -> Stand {
    Stand::new(DVec3::new(0.5, 1.7, 2.6), DVec3::new(0.0, 0.25, 0.0), size_px)
}

/// The layers of one frame: node and depth.
fn shown(scene: &Arc<Scene>, calibration: &Calibration, settings: Settings) -> [FloatImage; 2] {
    let rig = Rig::shown(scene, &[("left", calibration.clone())], settings, &[EYE_M]);
    [rig.layer(0, Layer::Node), rig.layer(0, Layer::Depth)]
}

/// A scene wholly traced, and the same with some nodes rasterised, show the same nodes.
fn compare(convention: Convention, samples: u32) {
    let calibration = Stand { convention, ..stand(UVec2::new(640, 400)) }.calibration();
    let settings = Settings { samples, max_depth: 0, ..ONE_SAMPLE };
    let [node, depth] = shown(&still_life(&[]), &calibration, settings);
    let silhouettes = node.silhouettes(1);
    let hybrid = still_life(&["box", "within", "teapot"]);
    for raster in [RasterOrder::Before, RasterOrder::After] {
        let [hybrid_node, hybrid_depth] = shown(&hybrid, &calibration, Settings { raster, ..settings });
        let pixels = node.values.len();
        let differs: Vec<usize> = (0..pixels).filter(|&at| node.values[at] != hybrid_node.values[at]).collect();
        let agreement = 1.0 - differs.len() as f64 / pixels as f64;
        let close =
            (0..pixels).filter(|&at| !silhouettes[at]).map(|at| (depth.values[at] - hybrid_depth.values[at]).abs());
        let close: Vec<bool> = close.map(|off| off <= TWO_UNITS).collect();
        let close_share = close.iter().filter(|close| **close).count() as f64 / close.len() as f64;
        println!(
            "{convention:?}, {samples} samples, {raster:?}: nodes agree on {:.4} %, depth within two units on {:.3} %",
            agreement * 100.0,
            close_share * 100.0
        );
        assert!(agreement >= 0.999, "{samples} samples, {raster:?}: {agreement}");
        assert!(differs.iter().all(|&at| silhouettes[at]), "{samples} samples, {raster:?}: away from silhouettes");
        // With one sample both look through the pixel's centre; with more, not through the same points of it.
        assert!(samples > 1 || close_share >= 0.99, "{raster:?}: {close_share}");
        for drawn in [2.0, 3.0, 4.0] {
            let share = |of: &FloatImage| of.values.iter().filter(|node| **node == drawn).count();
            assert!(share(&hybrid_node) > 500, "node {drawn} shows on {} pixels", share(&hybrid_node));
        }
    }
}

#[test]
fn hybrid_shows_what_tracing_shows_at_one_sample() {
    compare(Convention::OpenGl, 1);
    compare(Convention::Vulkan, 1);
    assert_validation_is_silent();
}

#[test]
fn hybrid_shows_what_tracing_shows_at_sixteen_samples() {
    compare(Convention::OpenGl, 16);
    assert_validation_is_silent();
}

/// A mirror, a floor and a ball before them, under a lamp.
fn before_a_mirror(role: &str) -> Value {
    json!([
        {"add": {"node": "floor", "uri": "lantern:checker", "scale": [0.25, 0.25, 0.25]}},
        {"add": {"node": "mirror", "uri": "lantern:sphere", "translation_m": [0, 0.5, 0], "scale": [0.5, 0.5, 0.5]}},
        {"add": {"node": "ball", "uri": "lantern:sphere", "role": role,
                 "translation_m": [0.5, 0.2, 0.75], "scale": [0.2, 0.2, 0.2]}},
        {"material": {"name": "mirror/sphere", "base_color": [0.9, 0.9, 0.9], "metallic": 1, "roughness": 0}},
        {"environment": {"color": [0.4, 0.6, 0.9]}},
        {"light": {"name": "lamp", "kind": "point", "position_m": [1, 3, 1.5], "intensity": 20.0}},
    ])
}

#[test]
fn what_is_rasterised_is_in_no_reflection_and_casts_no_shadow() {
    let mut editor = editor_of(before_a_mirror("raster"), Vec::new());
    let projectors = [("left", stand(UVec2::new(320, 200)).calibration())];
    let mut rig = Rig::shown(&editor.current(), &projectors, ONE_SAMPLE, &[EYE_M]);
    let mut look = |edit: Option<Value>| {
        if let Some(edit) = edit {
            rig.renderer.set_scene(editor.apply(&edits_of(json!([edit]))).unwrap());
            rig.show(&[EYE_M]);
        }
        (rig.layer(0, Layer::Node), rig.layer(0, Layer::Radiance))
    };
    let (node, rasterised) = look(None);
    let (_, gone) = look(Some(json!({"set": {"node": "ball", "visible": false}})));
    let (_, traced) = look(Some(json!({"set": {"node": "ball", "visible": true, "role": "prop"}})));

    let showing = |index: f32| node.values.iter().enumerate().filter(move |(_, of)| **of == index).map(|(at, _)| at);
    let pixel = |of: &FloatImage, at: usize| [0, 1, 2].map(|channel| of.values[at * 3 + channel].to_bits());
    let mut others = showing(-1.0).chain(showing(0.0)).chain(showing(1.0));
    assert!(others.clone().count() > 20_000 && showing(2.0).count() > 1000);
    assert!(others.all(|at| pixel(&rasterised, at) == pixel(&gone, at)), "no ray may know the raster node");

    // As a prop it is in the mirror, and its shadow on the floor.
    for (what, index) in [("floor", 0.0), ("mirror", 1.0)] {
        let changed = showing(index).filter(|&at| pixel(&traced, at) != pixel(&gone, at)).count();
        assert!(changed > 100, "{what}: only {changed} pixels change");
    }
    assert_validation_is_silent();
}

#[test]
fn a_mask_is_hit_and_stays_black() {
    let scene = scene_of(before_a_mirror("mask"));
    for samples in [1, 4] {
        let settings = Settings { samples, ..ONE_SAMPLE };
        let rig = Rig::shown(&scene, &[("left", stand(UVec2::new(320, 200)).calibration())], settings, &[EYE_M]);
        let (node, radiance, color) = (rig.layer(0, Layer::Node), rig.layer(0, Layer::Radiance), rig.color(0));
        let edges = node.silhouettes(1);
        let masked: Vec<usize> = (0..edges.len()).filter(|&at| node.values[at] == 2.0 && !edges[at]).collect();
        assert!(masked.len() > 1000);
        assert!(masked.iter().all(|&at| radiance.values[at * 3..at * 3 + 3] == [0.0; 3] && color[at] == [0; 3]));
    }
    assert_validation_is_silent();
}

/// How near the eye's line of sight to a point passes to a place.
fn passes_m(point_m: DVec3, place_m: DVec3) -> f64 {
    let way = point_m - EYE_M;
    let along = ((place_m - EYE_M).dot(way) / way.length_squared()).clamp(0.0, 1.0);
    (EYE_M + way * along).distance(place_m)
}

#[test]
fn what_is_virtual_is_seen_by_the_eye_alone() {
    let (ghost_m, radius_m) = (DVec3::new(0.3, 0.7, 1.4), 0.15);
    let mut edits = before_a_mirror("prop");
    edits.as_array_mut().unwrap().extend([
        json!({"material": {"name": "mirror/sphere", "metallic": 0, "roughness": 1}}),
        json!({"add": {"node": "ghost", "uri": "lantern:sphere", "role": "virtual",
                       "translation_m": ghost_m.to_array(), "scale": [radius_m, radius_m, radius_m]}}),
        json!({"material": {"name": "ghost/sphere", "base_color": [0, 0, 0], "emissive": [0, 7, 0], "roughness": 1}}),
        json!({"light": {"name": "lamp", "remove": true}}),
    ]);
    let mut editor = editor_of(edits, Vec::new());
    let calibration = stand(UVec2::new(320, 200)).calibration();
    let mut rig = Rig::shown(&editor.current(), &[("left", calibration.clone())], ONE_SAMPLE, &[EYE_M]);
    let layers = |rig: &Rig| [Layer::Node, Layer::Distance, Layer::Depth, Layer::Radiance].map(|of| rig.layer(0, of));
    let [node, distance, depth, radiance] = layers(&rig);
    rig.renderer.set_scene(editor.apply(&edits_of(json!([{"remove": {"node": "ghost"}}]))).unwrap());
    rig.show(&[EYE_M]);
    let [node_without, distance_without, depth_without, radiance_without] = layers(&rig);
    assert!(node.values.iter().all(|node| *node != 3.0), "a projector's ray hit what is not there");
    assert_eq!((&node, &distance, &depth), (&node_without, &distance_without, &depth_without));

    // Where the eye's line of sight to a point crosses it, it is all that the point shows; elsewhere nothing has changed.
    let frustum = Frustum::new(calibration);
    let (mut hidden, mut open) = (0, 0);
    for at in (0..node.values.len()).filter(|&at| node.values[at] >= 0.0) {
        let (x, y) = (at % node.width, at / node.width);
        let place_px = DVec2::new(x as f64, y as f64) + 0.5;
        let point_m = frustum.ray(place_px).unwrap().at(f64::from(distance.values[at]));
        let passes = passes_m(point_m, ghost_m) / radius_m;
        let (shows, showed) = (radiance.at(x, y), radiance_without.at(x, y));
        if passes < 0.99 && shows != showed {
            // It hides what faces the eye; what turns away from the eye keeps its own light.
            assert_eq!(shows, [0.0, 7.0, 0.0], "at {x}, {y}");
            hidden += 1;
        } else if passes > 1.01 {
            let off = shows.iter().zip(showed).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off <= 1e-6, "{off} at {x}, {y}");
            open += 1;
        }
    }
    println!("a virtual ball hides {hidden} pixels and leaves {open} as they were");
    assert!(hidden > 500 && open > 10_000, "{hidden} {open}");
    assert_validation_is_silent();
}
