//! lavapipe 22.3 silently ends an invocation's loops after 65,535 turns, summed over all of them. What a frame counts must stay
//! far below, on the heaviest that we have.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{path::PathBuf, sync::Arc};

use glam::{DVec3, UVec2};
use lantern_render::{RayCounts, Settings};
use lantern_scene::{Editor, Scene};
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent},
    stage::{Stand, editor_of, edits_of, scene_of, shared_data},
};
use serde_json::{Value, json};

/// Half of what the driver does: the loops over lights and waiting rays turn as well, and are not counted.
const MOST_STEPS: u32 = 32_768;

fn counts(scene: &Arc<Scene>, stand: Stand, eye_m: DVec3) -> RayCounts {
    let settings = Settings { max_depth: 64, count_rays: true, ..ONE_SAMPLE };
    let mut rig = Rig::new(scene, &[("left", stand.calibration())], settings);
    let report = rig.show(&[eye_m]).unwrap();
    report.projectors[0].rays.unwrap()
}

/// A model in glass of which no ray is lost, in four lamps' light.
fn in_glass(model: &str, data: PathBuf) -> Editor {
    let lamp = |i: i32| {
        let at_m = [f64::from(i % 2) - 0.5, 1.5, f64::from(i / 2) - 0.5];
        json!({"light": {"name": format!("lamp {i}"), "kind": "point", "position_m": at_m, "intensity": 5.0}})
    };
    let mut edits = vec![
        json!({"add": {"node": "floor", "uri": "lantern:checker", "scale": [0.2, 0.2, 0.2]}}),
        json!({"add": {"node": "model", "uri": format!("models/{model}")}}),
        json!({"environment": {"color": [0.5, 0.5, 0.5]}}),
    ];
    edits.extend((0..4).map(lamp));
    let mut editor = editor_of(Value::Array(edits), vec![data]);
    let materials: Vec<String> = editor.current().nodes[1].material_names().map(str::to_owned).collect();
    let glass = |name: &String| {
        json!({"material": {"name": format!("model/{name}"), "base_color": [1, 1, 1], "roughness": 0, "metallic": 0,
                            "transmission": 1, "thickness": 1, "ior": 1.5}})
    };
    editor.apply(&edits_of(Value::Array(materials.iter().map(glass).collect()))).unwrap();
    editor
}

#[test]
fn no_invocation_comes_near_the_drivers_limit() {
    let size_px = UVec2::new(200, 125);
    let trivial = scene_of(json!([{"add": {"node": "floor", "uri": "lantern:quad"}}]));
    let stand = Stand::new(DVec3::new(0.2, 0.4, 0.8), DVec3::new(0.0, 0.15, 0.0), size_px);
    let eye_m = DVec3::new(-0.2, 0.5, 0.9);
    let few = counts(&trivial, stand, eye_m);
    assert_eq!(few.primary, size_px.x * size_px.y);
    assert!((1..20).contains(&few.most_steps), "{few:?}");

    let Some(data) = shared_data("the heaviest walks") else { return };
    for model in ["stanford-bunny.glb", "FlightHelmet/FlightHelmet.gltf"] {
        let scene = in_glass(model, data.clone()).current();
        let many = counts(&scene, stand, eye_m);
        println!("{model} in glass: {many:?}");
        assert!(many.most_steps < MOST_STEPS, "{model}: {many:?}");
        assert!(many.most_steps > 20 * few.most_steps && many.secondary > many.primary / 4, "{model}: {many:?}");
    }
    assert_validation_is_silent();
}
