//! What is brought to the device, how much beside each frame, and what is shown meanwhile.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::sync::Arc;

use glam::{DVec3, UVec2};
use lantern_render::{Layer, Settings, bytes_beyond};
use lantern_scene::{Editor, Scene};
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent},
    stage::{Stand, editor_of, edits_of},
};
use serde_json::{Value, json};

const EYE_M: DVec3 = DVec3::new(0.8, 1.4, 3.0);

/// A slice small enough that a ball needs many, and no multiple of any element.
const SLICE_BYTES: u64 = 150_001;

fn eye(frame: usize) -> DVec3 {
    EYE_M + DVec3::new(0.01 * frame as f64, 0.0, 0.0)
}

/// Two projectors, which share their light, before a floor and a mirror, so that a moving eye changes the picture.
fn setting() -> (Editor, Rig) {
    let editor = editor_of(
        json!([
            {"add": {"node": "floor", "uri": "lantern:checker", "scale": [0.4, 0.4, 0.4]}},
            {"add": {"node": "box", "uri": "lantern:cube", "translation_m": [-0.6, 0.3, 0], "scale": [0.3, 0.3, 0.3]}},
            {"material": {"name": "box/cube", "roughness": 0, "metallic": 1}},
            {"light": {"name": "lamp", "kind": "point", "position_m": [1, 3, 1], "intensity": 8.0}},
            {"environment": {"color": [0.2, 0.3, 0.4]}},
        ]),
        Vec::new(),
    );
    let rig = rig(&editor.current());
    (editor, rig)
}

fn rig(scene: &Arc<Scene>) -> Rig {
    let size_px = UVec2::new(64, 40);
    let at = |x: f64| Stand::new(DVec3::new(x, 1.6, 3.2), DVec3::new(0.0, 0.5, 0.0), size_px).calibration();
    let settings = Settings { blend: true, ..ONE_SAMPLE };
    Rig::new(scene, &[("left", at(-1.0)), ("right", at(1.0))], settings)
}

fn ball(name: &str, x: f64) -> Value {
    json!({"add": {"node": name, "uri": "lantern:sphere", "translation_m": [x, 0.5, 0], "scale": [0.3, 0.3, 0.3]}})
}

fn apply(editor: &mut Editor, edit: Value) -> Arc<Scene> {
    editor.apply(&edits_of(json!([edit]))).unwrap()
}

/// That a rig shows what one shows that never knew anything else, to the bit.
fn assert_shows(rig: &Rig, scene: &Arc<Scene>, eye_m: DVec3) {
    let mut anew = self::rig(scene);
    anew.show(&[eye_m]);
    for projector in 0..2 {
        for layer in [Layer::Color, Layer::Radiance, Layer::Distance, Layer::Node] {
            let (shown, wanted) = (rig.layer(projector, layer), anew.layer(projector, layer));
            let differ = shown.values.iter().zip(&wanted.values).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
            assert_eq!(differ, 0, "projector {projector}, {layer:?}");
        }
    }
}

#[test]
fn frames_go_on_with_the_old_revision_until_all_of_the_new_one_is_there() {
    let (mut editor, mut rig) = setting();
    rig.show(&[eye(0)]);
    rig.renderer.set_upload_budget(SLICE_BYTES);
    let old = editor.current();
    let new = apply(&mut editor, ball("ball", 0.3));
    let missing = bytes_beyond(&old, &new);
    assert!(missing > 4 * SLICE_BYTES, "{missing}");
    rig.renderer.set_scene(new.clone());

    // Every frame shows one of the two, whole, and the old one as long as slices are on their way.
    let (mut sent, mut frames) = (0, 0);
    while rig.renderer.is_pending() {
        frames += 1;
        let report = rig.show(&[eye(frames)]).unwrap();
        assert!(report.uploaded_bytes <= SLICE_BYTES, "{report:?}");
        sent += report.uploaded_bytes;
        let shown = if rig.renderer.is_pending() { &old } else { &new };
        assert_eq!((report.revision, rig.renderer.scene().revision), (shown.revision, shown.revision));
        if frames == 5 || !rig.renderer.is_pending() {
            assert_shows(&rig, shown, eye(frames));
        }
    }
    assert!(frames >= 4, "{frames} frames");
    println!("{sent} bytes over {frames} frames; {missing} were missing");

    // Nothing is left to do, and a frame in which nothing changes is none.
    while rig.renderer.is_uploading() {
        assert_eq!(rig.show(&[eye(frames)]).map(|report| report.revision), None);
    }
    assert_validation_is_silent();
}

#[test]
fn what_is_there_is_not_sent_again() {
    let (mut editor, mut rig) = setting();
    let first = rig.show(&[eye(0)]).unwrap();
    assert_eq!(
        first.uploaded_bytes,
        bytes_beyond(&Editor::new(Default::default(), vec![]).current(), &editor.current())
    );
    let before = editor.current();
    let with_ball = apply(&mut editor, ball("ball", 0.3));
    for (edit, bytes) in [
        // The same mesh again, a move, a material: nothing.
        (ball("twin", -0.3), 0),
        (json!({"set": {"node": "ball", "translation_m": [0.4, 0.5, 0]}}), 0),
        (json!({"material": {"name": "ball/sphere", "roughness": 0.5}}), 0),
        (json!({"remove": {"node": "floor"}}), 0),
    ] {
        rig.renderer.set_scene(editor.current());
        rig.show(&[eye(0)]);
        let scene = apply(&mut editor, edit.clone());
        assert_eq!(bytes_beyond(rig.renderer.scene(), &scene), bytes, "{edit}");
        rig.renderer.set_scene(scene.clone());
        let report = rig.show(&[eye(0)]).unwrap();
        // Buffers that have become too small or too large move, on the device.
        assert_eq!(report.revision, scene.revision, "{edit}");
        assert_shows(&rig, &scene, eye(0));
    }
    assert!(bytes_beyond(&before, &with_ball) > 0);
    assert_validation_is_silent();
}

/// What is prepared holds up nothing: neither frames nor other revisions. And then it is shown at once.
#[test]
fn revisions_that_need_no_upload_do_not_wait_for_one_that_does() {
    let (mut editor, mut rig) = setting();
    rig.show(&[eye(0)]);
    rig.renderer.set_upload_budget(SLICE_BYTES);
    let mut ahead = editor.clone();
    let draft = apply(&mut ahead, ball("ball", 0.3));
    rig.renderer.prepare(vec![draft.clone()]).unwrap();
    let mut moves = 0;
    while !rig.renderer.is_prepared(&draft) {
        moves += 1;
        let x = -0.6 + 0.01 * f64::from(moves);
        let moved = apply(&mut editor, json!({"set": {"node": "box", "translation_m": [x, 0.3, 0]}}));
        rig.renderer.set_scene(moved.clone());
        assert_eq!(rig.show(&[eye(0)]).unwrap().revision, moved.revision);
        if moves % 5 == 0 {
            assert_shows(&rig, &moved, eye(0));
        }
    }
    assert!(moves >= 4, "{moves} moves");
    editor.learn_from(&ahead);
    let with_ball = apply(&mut editor, ball("ball", 0.3));
    rig.renderer.set_scene(with_ball.clone());
    let report = rig.show(&[eye(0)]).unwrap();
    assert_eq!((report.revision, report.uploaded_bytes), (with_ball.revision, 0));
    assert_shows(&rig, &with_ball, eye(0));

    // Given back, nothing of it stays but what is shown.
    rig.renderer.prepare(Vec::new()).unwrap();
    assert!(rig.renderer.is_prepared(&with_ball));
    assert_validation_is_silent();
}

/// A newer revision takes the place of one that is on its way, and what they share goes on.
#[test]
fn a_newer_revision_takes_over_what_was_on_its_way() {
    let (mut editor, mut rig) = setting();
    rig.show(&[eye(0)]);
    rig.renderer.set_upload_budget(SLICE_BYTES);
    let old = editor.current();
    let first = apply(&mut editor, ball("ball", 0.3));
    rig.renderer.set_scene(first.clone());
    let mut sent = 0;
    for frame in 1..4 {
        sent += rig.show(&[eye(frame)]).unwrap().uploaded_bytes;
    }
    let moved = apply(&mut editor, json!({"set": {"node": "ball", "translation_m": [0.5, 0.4, 0.1]}}));
    rig.renderer.set_scene(moved.clone());
    let mut frame = 4;
    while rig.renderer.is_pending() {
        let report = rig.show(&[eye(frame)]).unwrap();
        assert!(report.revision != first.revision, "a superseded revision was shown");
        sent += report.uploaded_bytes;
        frame += 1;
    }
    // The old meshes may have moved to a larger buffer; no byte of the ball was sent twice.
    let everything = bytes_beyond(&Editor::new(Default::default(), vec![]).current(), &moved);
    assert!(sent <= everything, "{sent} of {everything}");
    assert_shows(&rig, &moved, eye(frame - 1));

    // Back to what is shown: nothing is pending, whatever was begun.
    let other = apply(&mut editor, json!({"add": {"node": "pot", "uri": "lantern:teapot"}}));
    rig.renderer.set_scene(other);
    rig.show(&[eye(0)]);
    assert!(rig.renderer.is_pending());
    rig.renderer.set_scene(moved.clone());
    assert!(!rig.renderer.is_pending());
    while rig.renderer.is_uploading() {
        rig.show(&[eye(1)]);
    }
    assert_shows(&rig, &moved, eye(1));
    assert!(old.revision < moved.revision);
    assert_validation_is_silent();
}

/// A walk over scenes and slices of any size, revisions often superseded half way: blocks come, go and move in all orders.
#[test]
fn any_sequence_of_revisions_shows_what_a_renderer_of_the_last_one_shows() {
    let (mut editor, mut rig) = setting();
    rig.show(&[eye(0)]);
    let mut seed = 7u64;
    let mut random = |below: u64| {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (seed >> 33) % below
    };
    let shapes = ["sphere", "teapot", "cube", "checker"];
    let mut there = [false; 4];
    let (mut superseded, mut shown) = (0, 0);
    for step in 0..60 {
        let index = random(4) as usize;
        let (name, x) = (shapes[index], -0.9 + 0.5 * index as f64);
        let edit = if there[index] {
            json!({"remove": {"node": name}})
        } else {
            let uri = format!("lantern:{name}");
            json!({"add": {"node": name, "uri": uri, "translation_m": [x, 0.4, 0.3], "scale": [0.2, 0.2, 0.2]}})
        };
        there[index] = !there[index];
        rig.renderer.set_upload_budget([1_000, 20_011, 150_001, 4 << 20][random(4) as usize]);
        rig.renderer.set_scene(apply(&mut editor, edit));
        for _ in 0..random(8) {
            rig.show(&[eye(step)]);
        }
        superseded += u32::from(rig.renderer.is_pending());
        if step % 6 == 5 {
            rig.renderer.set_upload_budget(SLICE_BYTES);
            while rig.renderer.is_uploading() {
                rig.show(&[eye(step)]);
            }
            shown += 1;
            assert_eq!(rig.renderer.scene().revision, editor.current().revision);
            rig.show(&[eye(step)]);
            assert_shows(&rig, &editor.current(), eye(step));
        }
    }
    assert!(superseded >= 10 && shown == 10, "{superseded} superseded, {shown} shown");
    assert_validation_is_silent();
}
