//! Keeping what is not stale changes no picture: two renderers show one random sequence of edits and poses, one of them keeping
//! nothing from frame to frame, and every layer of theirs is the same to the bit.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use glam::{DVec3, UVec2};
use lantern_calibration::Calibration;
use lantern_render::{Layer, Pattern, ProjectorSpec, RayCounts, Settings, Texels};
use lantern_scene::Editor;
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent},
    lenses,
    random::SplitMix64,
    stage::{Stand, editor_of, edits_of},
};
use serde_json::{Value, json};

const STEPS: usize = 500;
/// Making everything anew takes long, and what was wrongly kept stays wrong for a while: so not every step is compared.
const COMPARED_EVERY: usize = 5;
const SIZE_PX: UVec2 = UVec2::new(80, 48);
const LAYERS: [Layer; 6] = [Layer::Color, Layer::Radiance, Layer::Distance, Layer::Depth, Layer::Node, Layer::Weight];
const SHAPES: [&str; 3] = ["sphere", "cube", "quad"];

/// A room with one of everything. The rug lies in the floor's own plane, so that which of the two a ray meets hangs on the last bit.
fn room() -> Value {
    let add = |name: &str, shape: &str, role: &str, at: [f64; 3], scale: [f64; 3]| json!({"add": {"node": name, "uri": format!("lantern:{shape}"), "role": role, "translation_m": at, "scale": scale}});
    json!([
        add("floor", "quad", "prop", [0.0, 0.0, 0.0], [4.0, 1.0, 4.0]),
        add("rug", "quad", "prop", [0.5, 0.0, 0.5], [1.0, 1.0, 1.0]),
        add("wall", "cube", "prop", [0.0, 0.5, -1.2], [2.0, 1.0, 0.1]),
        add("ball", "sphere", "prop", [-0.5, 0.3, 0.0], [0.3, 0.3, 0.3]),
        add("box", "cube", "prop", [0.4, 0.2, 0.2], [0.3, 0.4, 0.3]),
        add("glass", "sphere", "prop", [0.1, 0.2, 0.7], [0.2, 0.2, 0.2]),
        add("ghost", "sphere", "virtual", [0.6, 0.8, 0.3], [0.15, 0.15, 0.15]),
        add("drawn", "cube", "raster", [-0.8, 0.4, 0.5], [0.2, 0.2, 0.2]),
        add("screen", "cube", "mask", [-0.2, 0.1, 0.9], [0.3, 0.2, 0.1]),
        add("pebble", "sphere", "prop", [0.9, 0.1, -0.3], [0.1, 0.1, 0.1]),
        {"material": {"name": "ball/sphere", "roughness": 0, "metallic": 1}},
        {"material": {"name": "glass/sphere", "roughness": 0, "transmission": 1, "thickness": 0.4, "base_color": [0.8, 0.9, 1]}},
        {"light": {"name": "lamp", "kind": "point", "position_m": [1, 2.5, 1], "intensity": 8.0}},
        {"light": {"name": "sun", "kind": "directional", "direction": [-0.4, -1, -0.3], "intensity": 0.7}},
        {"environment": {"color": [0.2, 0.3, 0.4]}},
    ])
}

fn any_place(random: &mut SplitMix64) -> [f64; 3] {
    random.point(DVec3::new(-1.3, 0.0, -1.0), DVec3::new(1.3, 1.0, 1.2)).to_array()
}

fn any_stand(random: &mut SplitMix64, x: f64) -> Stand {
    let at_m = DVec3::new(x, 1.8, 2.6) + random.point(DVec3::splat(-0.3), DVec3::splat(0.3));
    Stand { fov_y_rad: 0.75, ..Stand::new(at_m, random.point(DVec3::splat(-0.2), DVec3::splat(0.3)), SIZE_PX) }
}

/// The one in the middle is a pinhole; the others stand behind a lens, now this one and now that.
fn any_calibration(random: &mut SplitMix64, x: f64) -> Calibration {
    let calibration = any_stand(random, x).calibration();
    let [(_, barrel), (_, pincushion), (_, coarse), (_, fine)] = lenses::all(SIZE_PX);
    match (x, random.below(2)) {
        (-1.0, 0) => calibration.with_lens(barrel).unwrap(),
        (-1.0, _) => calibration.with_lens(coarse).unwrap(),
        (1.0, 0) => calibration.with_lens(fine).unwrap(),
        (1.0, _) => calibration.with_lens(pincushion).unwrap(),
        _ => calibration,
    }
}

/// The sequence: what stands in the room, and what happens next.
struct Play {
    random: SplitMix64,
    editor: Editor,
    /// Names and shapes.
    nodes: Vec<(String, String)>,
    added: usize,
    eye_m: DVec3,
}

impl Play {
    fn any_node(&mut self) -> (String, String) {
        // The floor moves seldom.
        let first = usize::from(!self.random.once_in(12));
        let count = self.nodes.len();
        self.nodes[first + self.random.below(count - first)].clone()
    }

    fn edit(&mut self) -> Value {
        let (node, shape) = self.any_node();
        let random = &mut self.random;
        let unit = |random: &mut SplitMix64| random.between(0.0, 1.0);
        match random.below(20) {
            0..=6 => {
                // A small step, or to anywhere.
                let scene = self.editor.current();
                let now = scene.node(&node).unwrap().1.translation_m;
                let step = DVec3::splat(0.05);
                let to =
                    if random.once_in(2) { (now + random.point(-step, step)).to_array() } else { any_place(random) };
                // Now and then back into the floor's plane.
                let to = if random.once_in(4) { [to[0], 0.0, to[2]] } else { to };
                json!({"set": {"node": node, "translation_m": to}})
            }
            7 => {
                let half = random.between(0.0, 3.0);
                json!({"set": {"node": node, "rotation": [0.0, half.sin(), 0.0, half.cos()]}})
            }
            8 if node != "floor" => {
                let scale = random.between(0.1, 0.5);
                json!({"set": {"node": node, "scale": [scale, random.between(0.1, 0.5), scale]}})
            }
            9 => json!({"set": {"node": node, "visible": random.once_in(2)}}),
            10 => {
                let role = ["prop", "prop", "mask", "virtual", "raster"][random.below(5)];
                json!({"set": {"node": node, "role": role}})
            }
            11 => {
                self.added += 1;
                let (name, shape) = (format!("more {}", self.added), SHAPES[random.below(3)].to_owned());
                let (at, scale) = (any_place(random), random.between(0.1, 0.4));
                self.nodes.push((name.clone(), shape.clone()));
                json!({"add": {"node": name, "uri": format!("lantern:{shape}"), "translation_m": at, "scale": [scale, scale, scale]}})
            }
            12 if self.nodes.len() > 8 && node != "floor" => {
                self.nodes.retain(|(name, _)| *name != node);
                json!({"remove": {"node": node}})
            }
            13 | 14 => {
                let metallic = random.below(2);
                let roughness = [0.0, 0.3, 1.0][random.below(3)];
                let clearcoat = if random.once_in(5) { 1 } else { 0 };
                let transmission = if random.once_in(4) { 1 } else { 0 };
                let color = [unit(random), unit(random), unit(random)];
                json!({"material": {"name": format!("{node}/{shape}"), "base_color": color, "metallic": metallic, "roughness": roughness, "clearcoat": clearcoat, "transmission": transmission}})
            }
            15 => json!({"light": {"name": "lamp", "kind": "point", "position_m": [unit(random), 2.5, unit(random)]}}),
            16 if random.once_in(3) => {
                let light = ["lamp", "sun"][random.below(2)];
                json!({"light": {"name": light, "remove": true}})
            }
            16 => json!({"light": {"name": "sun", "kind": "directional", "intensity": unit(random)}}),
            17 => json!({"environment": {"color": [unit(random), 0.3, 0.4]}}),
            _ => {
                json!({"set": {"node": "pebble", "visible": true, "role": "prop", "translation_m": any_place(random)}})
            }
        }
    }

    /// One thing happens, to both renderers alike; says what.
    fn step(&mut self, rigs: &mut [Rig; 2]) -> String {
        if self.random.once_in(3) {
            self.eye_m = self.random.point(DVec3::new(-1.0, 1.2, 1.5), DVec3::new(1.0, 2.0, 3.0));
        }
        match self.random.below(25) {
            0 => {
                let mut specs: Vec<ProjectorSpec> = rigs[0].renderer.projectors().cloned().collect();
                let which = self.random.below(specs.len());
                specs[which].calibration = any_calibration(&mut self.random, which as f64 - 1.0);
                rigs.iter_mut().for_each(|rig| rig.renderer.set_projectors(specs.clone()).unwrap());
                format!("calibration of {which}")
            }
            1 => {
                let pattern = if self.random.once_in(3) { Pattern::Checker } else { Pattern::Off };
                let which = self.random.below(rigs[0].renderer.projectors().len());
                rigs.iter_mut().for_each(|rig| rig.renderer.set_pattern(which, pattern).unwrap());
                format!("{pattern:?} on {which}")
            }
            2 => "an eye".to_owned(),
            _ => {
                // One edit, or several, in one revision or in several before the next frame.
                let mut said = Vec::new();
                for _ in 0..=self.random.below(4) / 2 {
                    let edit = self.edit();
                    // What is gone cannot be named: the pebble may be.
                    let Ok(scene) = self.editor.apply(&edits_of(json!([edit]))) else { continue };
                    rigs.iter_mut().for_each(|rig| rig.renderer.set_scene(scene.clone()));
                    said.push(edit.to_string());
                }
                said.join(", ")
            }
        }
    }
}

/// A layer's bits.
fn bits(rig: &Rig, projector: usize, layer: Layer) -> Vec<u32> {
    match rig.renderer.read(projector, layer).unwrap().texels {
        Texels::Rgb8(texels) => texels.iter().map(|t| u32::from_le_bytes([t[0], t[1], t[2], 0])).collect(),
        Texels::Rgb(texels) => texels.iter().flatten().map(|x| x.to_bits()).collect(),
        Texels::Scalar(texels) => texels.iter().map(|x| x.to_bits()).collect(),
    }
}

#[test]
fn what_is_kept_is_what_would_be_made_anew() {
    let mut random = SplitMix64(3);
    let editor = editor_of(room(), Vec::new());
    let named =
        [("left", -1.0), ("middle", 0.0), ("right", 1.0)].map(|(name, x)| (name, any_calibration(&mut random, x)));
    let keeping = Settings { samples: 4, max_depth: 1, blend: true, count_rays: true, ..ONE_SAMPLE };
    let mut rigs = [keeping, Settings { always_full: true, ..keeping }]
        .map(|settings| Rig::new(&editor.current(), &named, settings));
    let nodes = editor.current().nodes.iter().map(|n| (n.name.clone(), n.uri.replace("lantern:", ""))).collect();
    let mut play = Play { random, editor, nodes, added: 0, eye_m: DVec3::new(0.2, 1.6, 2.2) };

    let mut cost = [RayCounts::default(); 2];
    let mut history = Vec::new();
    for step in 0..STEPS {
        history.push(play.step(&mut rigs));
        let compared = step % COMPARED_EVERY == 0;
        for (rig, cost) in rigs.iter_mut().zip(&mut cost).take(if compared { 2 } else { 1 }) {
            let Some(report) = rig.show(&[play.eye_m]) else { continue };
            for rays in report.projectors.iter().filter_map(|p| p.rays) {
                cost.primary += rays.primary;
                cost.shadow += rays.shadow;
                cost.blend += rays.blend;
            }
        }
        if !compared {
            continue;
        }
        for projector in 0..named.len() {
            for layer in LAYERS {
                let [kept, anew] = [0, 1].map(|rig| bits(&rigs[rig], projector, layer));
                if kept != anew {
                    let words = kept.len() / (SIZE_PX.x * SIZE_PX.y) as usize;
                    let differ = |(at, _): (usize, (&u32, &u32))| {
                        let pixel = at / words;
                        [pixel % SIZE_PX.x as usize, pixel / SIZE_PX.x as usize]
                    };
                    let all = kept.iter().zip(&anew).enumerate().filter(|(_, (a, b))| a != b).map(differ);
                    let all: Vec<_> = all.collect();
                    panic!(
                        "step {step}: {layer:?} of projector {projector} differs in {} numbers, at {:?} …, after\n{}",
                        all.len(),
                        &all[..all.len().min(8)],
                        history[history.len().saturating_sub(COMPARED_EVERY)..].join("\n")
                    );
                }
            }
        }
    }
    println!("{STEPS} steps; rays with what is kept {:?}, anew in every {COMPARED_EVERY}th {:?}", cost[0], cost[1]);
    // What keeps nothing would pass as well.
    let of_each = |rays: u32| rays / COMPARED_EVERY as u32;
    assert!(2 * of_each(cost[0].primary) < cost[1].primary && of_each(cost[0].blend) < cost[1].blend, "{cost:?}");
    assert_validation_is_silent();
}
