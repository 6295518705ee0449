//! Nothing stale, nothing done (DESIGN, section 4): shown by counting the rays of frames in which one thing changed.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use glam::{DVec3, UVec2};
use lantern_render::{Layer, RayCounts, Settings};
use lantern_scene::Editor;
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent},
    stage::{Stand, editor_of, edits_of},
};
use serde_json::{Value, json};

const SIZE_PX: UVec2 = UVec2::new(160, 100);
const PIXELS: u32 = SIZE_PX.x * SIZE_PX.y;
const EYE_M: DVec3 = DVec3::new(0.8, 1.4, 3.0);
const MOVED_M: DVec3 = DVec3::new(0.9, 1.4, 3.0);

/// Two projectors before a ball of some material; a virtual ball and a rasterised box beside it.
struct Setting {
    editor: Editor,
    rig: Rig,
}

impl Setting {
    fn new(material: Value, others: bool) -> Self {
        let mut material = material;
        material["name"] = json!("ball/sphere");
        let mut edits = vec![
            json!({"add": {"node": "floor", "uri": "lantern:checker", "scale": [0.4, 0.4, 0.4]}}),
            json!({"add": {"node": "ball", "uri": "lantern:sphere", "translation_m": [0, 0.5, 0], "scale": [0.5, 0.5, 0.5]}}),
            json!({"material": material}),
            json!({"light": {"name": "lamp", "kind": "point", "position_m": [1, 3, 1], "intensity": 8.0}}),
            json!({"environment": {"color": [0.2, 0.3, 0.4]}}),
        ];
        if others {
            let add = |name: &str, shape: &str, role: &str, x: f64| json!({"add": {"node": name, "uri": shape, "role": role, "translation_m": [x, 0.6, 0.9], "scale": [0.2, 0.2, 0.2]}});
            edits.push(add("ghost", "lantern:sphere", "virtual", 0.5));
            edits.push(add("drawn", "lantern:cube", "raster", -0.8));
        }
        let editor = editor_of(Value::Array(edits), Vec::new());
        let at = |x: f64| Stand::new(DVec3::new(x, 1.6, 3.2), DVec3::new(0.0, 0.5, 0.0), SIZE_PX).calibration();
        let settings = Settings { blend: true, count_rays: true, ..ONE_SAMPLE };
        let rig = Rig::new(&editor.current(), &[("left", at(-1.0)), ("right", at(1.0))], settings);
        Self { editor, rig }
    }

    /// The rays of both projectors' parts of a frame; `None` where there was nothing to do.
    fn frame(&mut self, eye_m: DVec3) -> Option<RayCounts> {
        let report = self.rig.show(&[eye_m])?;
        assert_eq!(report.projectors.len(), 2, "what changed here changes both pictures");
        let zero = RayCounts::default();
        Some(report.projectors.iter().map(|projector| projector.rays.unwrap()).fold(zero, |a, b| RayCounts {
            primary: a.primary + b.primary,
            secondary: a.secondary + b.secondary,
            shadow: a.shadow + b.shadow,
            blend: a.blend + b.blend,
            most_steps: a.most_steps.max(b.most_steps),
        }))
    }

    fn edited(&mut self, edit: Value) -> Option<RayCounts> {
        self.rig.renderer.set_scene(self.editor.apply(&edits_of(json!([edit]))).unwrap());
        self.frame(EYE_M)
    }
}

#[test]
fn each_change_redoes_what_it_must_and_no_more() {
    let mut setting = Setting::new(json!({"roughness": 0, "metallic": 1}), true);
    let full = setting.frame(EYE_M).unwrap();
    println!("all: {full:?}");
    assert_eq!(full.primary, 2 * PIXELS);
    assert!(full.secondary > 0 && full.shadow > 0 && full.blend > 0, "{full:?}");

    // Nothing, nothing.
    assert_eq!(setting.frame(EYE_M), None);

    // The eye: what depends on it alone, and the shadow rays of what the ball shows, which is little of the picture.
    let eye = setting.frame(MOVED_M).unwrap();
    println!("the eye: {eye:?}");
    assert_eq!((eye.primary, eye.blend), (0, 0));
    assert!(eye.secondary > 0 && eye.shadow < full.shadow / 8, "{eye:?} {full:?}");
    assert_eq!(setting.frame(MOVED_M), None);
    setting.frame(EYE_M).unwrap();

    // A virtual thing: no ray of a projector.
    let ghost = setting.edited(json!({"set": {"node": "ghost", "translation_m": [0.6, 0.7, 0.9]}})).unwrap();
    println!("a virtual thing: {ghost:?}");
    assert_eq!((ghost.primary, ghost.blend), (0, 0));
    assert!(
        ghost.secondary > 0 && ghost.shadow > 0 && ghost.shadow < full.shadow / 2,
        "where its shadow falls: {ghost:?}"
    );

    // A material, a light or the environment: nor.
    for edit in [
        json!({"light": {"name": "lamp", "intensity": 9.0}}),
        json!({"material": {"name": "ball/sphere", "base_color": [0.9, 0.8, 0.7]}}),
        json!({"environment": {"color": [0.3, 0.2, 0.1]}}),
    ] {
        let rays = setting.edited(edit.clone()).unwrap();
        assert_eq!((rays.primary, rays.blend), (0, 0), "{edit}");
        assert!(rays.secondary > 0 && rays.shadow > 0, "{edit}");
    }

    // What is rasterised: no ray at all, and a new picture.
    let before = setting.rig.color(0);
    let drawn = setting.edited(json!({"set": {"node": "drawn", "translation_m": [-0.7, 0.6, 0.9]}})).unwrap();
    assert_eq!(drawn, RayCounts::default());
    assert!(setting.rig.color(0) != before);

    // A prop: the tiles that it covered or covers, what its shadow falls on, and every reflection.
    let prop = setting.edited(json!({"set": {"node": "ball", "translation_m": [0.1, 0.5, 0]}})).unwrap();
    println!("a prop: {prop:?}");
    assert!(prop.primary > 0 && prop.primary < full.primary / 2, "{prop:?}");
    assert!(prop.blend > 0 && prop.blend < full.blend && prop.secondary > 0);
    assert!(prop.shadow > 0 && prop.shadow < full.shadow, "{prop:?}");
    assert_eq!(setting.edited(json!({"set": {"node": "ball", "translation_m": [0.1, 0.5, 0]}})), None);
    assert_validation_is_silent();
}

#[test]
fn a_moving_eye_costs_a_diffuse_scene_no_ray() {
    let mut setting = Setting::new(json!({"roughness": 1, "metallic": 0}), false);
    let full = setting.frame(EYE_M).unwrap();
    assert!(full.primary > 0 && full.shadow > 0 && full.secondary == 0, "{full:?}");
    if let Some(rays) = setting.frame(MOVED_M) {
        assert_eq!((rays.primary, rays.secondary, rays.shadow, rays.blend), (0, 0, 0, 0));
    }
    assert_validation_is_silent();
}

/// A projector that is calibrated anew is traced anew; of the other one, the weights alone are.
#[test]
fn a_calibration_redoes_its_own_picture_and_the_others_weights() {
    let mut setting = Setting::new(json!({"roughness": 1}), false);
    setting.frame(EYE_M).unwrap();
    let renderer = &mut setting.rig.renderer;
    let mut specs: Vec<_> = renderer.projectors().cloned().collect();
    renderer.set_projectors(specs.clone()).unwrap();
    assert!(renderer.render(|| vec![EYE_M]).unwrap().is_none(), "the same projectors are nothing new");

    // The left one stands elsewhere now.
    let at = Stand::new(DVec3::new(-1.3, 1.7, 3.0), DVec3::new(0.0, 0.5, 0.0), SIZE_PX).calibration();
    specs[0].calibration = at;
    renderer.set_projectors(specs.clone()).unwrap();
    let report = renderer.render(|| vec![EYE_M]).unwrap().unwrap();
    let rays: Vec<_> = report.projectors.iter().map(|p| p.rays.unwrap()).collect();
    println!("left, which moved: {:?}; right: {:?}", rays[0], rays[1]);
    assert_eq!((rays[0].primary, rays[1].primary), (PIXELS, 0));
    assert!(rays[0].shadow > 0 && rays[0].blend > 0 && rays[1].blend > 0);
    assert_eq!(rays[1].shadow, 0);

    // What comes of it is what a renderer shows that never knew anything else, to the bit; also after one has gone.
    for count in [2, 1] {
        specs.truncate(count);
        renderer.set_projectors(specs.clone()).unwrap();
        renderer.render(|| vec![EYE_M]).unwrap();
        let named: Vec<_> = specs.iter().map(|s| (s.name.as_str(), s.calibration.clone())).collect();
        let settings = *renderer.settings();
        let anew = Rig::shown(renderer.scene(), &named, settings, &[EYE_M]);
        for projector in 0..count {
            for layer in [Layer::Color, Layer::Weight] {
                let shown = renderer.read(projector, layer).unwrap();
                assert!(
                    shown == anew.renderer.read(projector, layer).unwrap(),
                    "{count} projectors, {projector}, {layer:?}"
                );
            }
        }
    }
    assert_validation_is_silent();
}
