//! Memory of the device over many edits, and of the process over many frames. In one program and one test: what others use would be
//! counted with it.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use glam::{DVec3, UVec2};
use lantern_scene::Editor;
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent, device},
    stage::{Stand, editor_of, edits_of},
};
use serde_json::{Value, json};

/// What 100 frames may add: a tenth of what one shader that is made anew each frame and kept would.
const FRAMES_MAY_HOLD_BYTES: u64 = 10 << 20;

const EYE_M: DVec3 = DVec3::new(0.8, 1.4, 3.0);

/// Shows an edit, and goes on until nothing is on its way any more.
fn show(editor: &mut Editor, rig: &mut Rig, edits: Value) {
    let scene = editor.apply(&edits_of(edits)).unwrap();
    rig.renderer.set_scene(scene.clone());
    while rig.renderer.is_uploading() {
        rig.show(&[EYE_M]);
    }
    assert_eq!(rig.renderer.scene().revision, scene.revision);
}

#[test]
fn hundreds_of_edits_leave_as_many_bytes_as_there_were() {
    let base = json!([
        {"add": {"node": "floor", "uri": "lantern:checker", "scale": [0.4, 0.4, 0.4]}},
        {"light": {"name": "lamp", "kind": "point", "position_m": [1, 3, 1], "intensity": 8.0}},
        {"environment": {"color": [0.2, 0.3, 0.4]}},
    ]);
    let mut editor = editor_of(base, Vec::new());
    let stand = Stand::new(DVec3::new(0.0, 1.6, 3.2), DVec3::new(0.0, 0.5, 0.0), UVec2::new(32, 20));
    let mut rig = Rig::shown(&editor.current(), &[("left", stand.calibration())], ONE_SAMPLE, &[EYE_M]);
    let empty = (device().allocated_bytes(), rig.renderer.scene_bytes());
    println!("{} bytes at the beginning, {} of them of the scene", empty.0, empty.1);

    // Many small slices, so that shows, moves and uploads mix.
    rig.renderer.set_upload_budget(100_000);
    let shapes = ["lantern:sphere", "lantern:teapot", "lantern:cube", "lantern:checker"];
    let (mut edits, mut most, mut cycles) = (0, 0, Vec::new());
    for cycle in 0..8 {
        for i in 0..16 {
            let (name, uri) = (format!("n{i}"), shapes[(i + cycle) % shapes.len()]);
            let at = [0.1 * i as f64 - 0.8, 0.2, 0.0];
            show(
                &mut editor,
                &mut rig,
                json!([{"add": {"node": name, "uri": uri, "translation_m": at, "scale": [0.1, 0.1, 0.1]}}]),
            );
            show(&mut editor, &mut rig, json!([{"set": {"node": name, "translation_m": [0.0, 0.3, at[0]]}}]));
            most = most.max(rig.renderer.scene_bytes());
            edits += 2;
        }
        // In another order than that in which they came.
        for i in 0..16 {
            show(&mut editor, &mut rig, json!([{"remove": {"node": format!("n{}", (i * 7 + cycle) % 16)}}]));
            edits += 1;
        }
        cycles.push((device().allocated_bytes(), rig.renderer.scene_bytes()));
    }
    println!("{edits} edits; the scene took {most} bytes at most; after each cycle {cycles:?}");
    assert!(most > 4 * empty.1, "the edits are to matter");
    // Small sections keep a buffer up to four times as large as they need, so cycles differ by a little, and never by more.
    assert!(cycles.iter().all(|of| of.0 < empty.0 + 4096 && of.1 < empty.1 + 4096), "{empty:?}, then {cycles:?}");
    assert!(cycles.windows(3).skip(1).all(|of| of[0] == of[2]), "the same edits, other bytes: {cycles:?}");

    // A driver that lies in the process can leak there what it compiles (ARCHITECTURE, The order of passes). The eye moves, and the light
    // changes, so that every pass runs.
    rig.show(&[EYE_M]);
    let mut frames = |count: u32| {
        for i in 0..count {
            let light = json!([{"light": {"name": "lamp", "intensity": 5.0 + f64::from(i % 7)}}]);
            rig.renderer.set_scene(editor.apply(&edits_of(light)).unwrap());
            rig.show(&[EYE_M + DVec3::X * 0.001 * f64::from(i)]);
        }
        resident_bytes()
    };
    let (before, after) = (frames(30), frames(100));
    println!("the process holds {before} bytes, and {after} after 100 more frames");
    assert!(after < before + FRAMES_MAY_HOLD_BYTES, "100 frames: from {before} to {after} bytes");
    assert_validation_is_silent();
}

/// Physical memory of this process (`proc_pid_status(5)`).
fn resident_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let kib = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    kib.trim().trim_end_matches(" kB").parse::<u64>().unwrap() * 1024
}
