//! What each pixel lands on, and how far away: the GPU against the oracle, on real models and on the demo.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::sync::Arc;

use glam::{DVec3, UVec2};
use lantern_calibration::Calibration;
use lantern_proto as proto;
use lantern_render::{Layer, Settings};
use lantern_scene::Scene;
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent},
    image::{FloatImage, percentile, relative_errors},
    oracle::{self, World},
    stage::{Stand, demo, editor_of, shared_data},
};
use serde_json::json;

const SIZE_PX: UVec2 = UVec2::new(320, 200);
const EYE_M: DVec3 = DVec3::new(0.3, 0.6, 1.5);

/// Compares `node` and `distance` of one projector with the oracle's, and prints how well they agree.
fn compare(what: &str, scene: &Arc<Scene>, name: &str, calibration: Calibration, samples: u32) {
    let settings = Settings { samples, max_depth: 0, ..ONE_SAMPLE };
    let rig = Rig::shown(scene, &[(name, calibration)], settings, &[EYE_M]);
    let picture =
        oracle::render(&World::new(scene), &rig.frusta[0], &oracle::Settings::new(name, samples, 0, EYE_M), 1);
    let expected = |layer| FloatImage::from_oracle(&picture, layer).unwrap();
    let (node, expected_node) = (rig.layer(0, Layer::Node), expected(proto::Layer::Node));

    // Which node: what differs stands on a silhouette.
    let silhouettes = expected_node.silhouettes(1);
    let differs: Vec<usize> =
        (0..node.values.len()).filter(|&at| node.values[at] != expected_node.values[at]).collect();
    let agreement = 1.0 - differs.len() as f64 / node.values.len() as f64;
    assert!(differs.iter().all(|&at| silhouettes[at]), "{what}: another node away from silhouettes");
    assert!(agreement >= 0.999, "{what}: nodes agree on {agreement}");

    // How far: wherever both see the same thing.
    let same = |at: usize| node.values[at] == expected_node.values[at];
    let errors = relative_errors(&rig.layer(0, Layer::Distance), &expected(proto::Layer::Distance), same).unwrap();
    let (median, high) = (percentile(&errors, 0.5), percentile(&errors, 0.99));
    assert!(errors.len() * 5 > node.values.len(), "{what}: only {} pixels see anything", errors.len());
    assert!(median <= 1e-4 && high <= 1e-3, "{what}: relative error {median:e} at the median, {high:e} at 99 %");
    println!(
        "{what}, {samples} samples: node agrees on {:.4} %, distance off by {median:.1e} (median), {high:.1e} (99 %)",
        agreement * 100.0
    );
}

/// A model on a floor, 30 to 40 cm high, from a projector at arm's length.
fn compare_model(file: &str) {
    let Some(data) = shared_data(file) else { return };
    let edits = json!([
        {"add": {"node": "floor", "uri": "lantern:quad"}},
        {"add": {"node": "model", "uri": format!("models/{file}")}},
        {"light": {"name": "lamp", "kind": "point", "position_m": [1, 2, 1], "intensity": 5.0}},
    ]);
    let scene = editor_of(edits, vec![data]).current();
    let stand = Stand { fov_y_rad: 0.45, ..Stand::new(DVec3::new(0.5, 0.6, 0.9), DVec3::new(0.0, 0.15, 0.0), SIZE_PX) };
    for samples in [1, 4] {
        compare(file, &scene, "left", stand.calibration(), samples);
    }
    assert_validation_is_silent();
}

#[test]
fn the_bunny_is_where_it_is() {
    compare_model("stanford-bunny.glb");
}

#[test]
fn spot_is_where_it_is() {
    compare_model("spot.glb");
}

#[test]
fn the_demo_is_where_it_is() {
    let (scene, projectors, _) = demo(SIZE_PX);
    for (name, calibration) in &projectors {
        for samples in [1, 4] {
            compare(&format!("demo, {name}"), &scene, name, calibration.clone(), samples);
        }
    }
    assert_validation_is_silent();
}
