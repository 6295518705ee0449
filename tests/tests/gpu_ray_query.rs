//! The two ways to trace, ray queries and our own walk, show the same pictures. Where the device has no ray queries this says so and is
//! silent; `packaging/test-ray-query` runs it on one that has.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::sync::Arc;

use glam::{DVec3, UVec2};
use lantern_calibration::Calibration;
use lantern_gpu::{Device, GpuError, Instance, RayTracing, Validation};
use lantern_render::{Layer, LayerImage, Settings};
use lantern_scene::Scene;
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, float_image},
    image::{FloatImage, percentile},
    stage::{Stand, demo, editor_of, edits_of, scene_of, shared_data},
};
use serde_json::{Value, json};

/// Small: a processor that imitates ray queries makes some ten thousand a second.
const SIZE_PX: UVec2 = UVec2::new(72, 48);
const EYE_M: DVec3 = DVec3::new(0.8, 1.4, 3.0);

/// A device for each way.
struct Both {
    instance: Arc<Instance>,
    walk: Arc<Device>,
    query: Arc<Device>,
}

impl Both {
    fn open(skipped: &str) -> Option<Both> {
        let instance = Instance::new(Validation::On).unwrap();
        let query = match Device::open_for(&instance, None, 2, None, RayTracing::RayQuery) {
            Ok(device) => device,
            Err(GpuError::Unsupported { missing, .. }) => {
                println!("skipped, since the device lacks {missing}: {skipped}");
                return None;
            }
            Err(error) => panic!("{error}"),
        };
        let walk = Device::open_for(&instance, None, 2, None, RayTracing::Bvh).unwrap();
        assert!(query.has_ray_queries() && !walk.has_ray_queries());
        Some(Both { instance, walk, query })
    }

    /// A renderer on each.
    fn rigs(&self, scene: &Arc<Scene>, projectors: &[(&str, Calibration)], settings: Settings) -> [Rig; 2] {
        [&self.walk, &self.query].map(|device| Rig::on(device, scene, projectors, settings))
    }

    /// Closes both, so that objects that outlive them are heard of, and demands silence of the validation layer.
    fn close(self) {
        drop((self.walk, self.query));
        assert_eq!(self.instance.validation_messages(), Vec::<String>::new());
    }
}

/// How far two pictures of one thing may differ: only where a ray meets the very edge of a triangle, which either way may take for the
/// next one, or the nearer of two that it cannot tell apart; and in what follows from that by reflection.
struct Bounds {
    other_node: f64,
    other_radiance: f64,
}

/// Absolute differences of a layer, pixel for pixel (the largest of its channels), where `counts`.
fn differences(a: &FloatImage, b: &FloatImage, counts: impl Fn(usize) -> bool) -> Vec<f64> {
    let channels = a.channels;
    let of = |at: usize| {
        let range = at * channels..(at + 1) * channels;
        let pairs = a.values[range.clone()].iter().zip(&b.values[range]);
        pairs.map(|(a, b)| if a == b { 0.0 } else { f64::from((a - b).abs()) }).fold(0.0, f64::max)
    };
    let mut all: Vec<f64> = (0..a.width * a.height).filter(|at| counts(*at)).map(of).collect();
    all.sort_by(f64::total_cmp);
    all
}

/// Shows both rigs' next frame and compares every projector's layers, and the room.
fn compare(what: &str, rigs: &mut [Rig; 2], bounds: &Bounds) {
    for rig in rigs.iter_mut() {
        rig.show(&[EYE_M]).unwrap();
    }
    let room: [LayerImage; 2] = rigs.each_mut().map(|rig| rig.renderer.room(EYE_M, SIZE_PX.to_array()).unwrap());
    let rigs = &*rigs;
    let count = rigs[0].frusta.len();
    for projector in 0..count {
        let layers = |layer| [0, 1].map(|of: usize| rigs[of].layer(projector, layer));
        let [node, other_node] = layers(Layer::Node);
        let same = |at: usize| node.values[at] == other_node.values[at];
        let pixels = node.values.len();
        let other = (0..pixels).filter(|at| !same(*at)).count() as f64 / pixels as f64;
        let hits = node.values.iter().filter(|node| **node >= 0.0).count();
        assert!(hits * 3 > pixels, "{what}: projector {projector} sees next to nothing");

        let [distance, other_distance] = layers(Layer::Distance);
        let far = differences(&distance, &other_distance, |at| same(at) && distance.values[at].is_finite());
        let far_m = percentile(&far, 0.999);
        let [radiance, other_radiance] = layers(Layer::Radiance);
        let colors = differences(&radiance, &other_radiance, |_| true);
        // A thousandth of white is less than a step of eight bits.
        let unlike = colors.iter().filter(|d| **d > 1e-3).count() as f64 / pixels as f64;
        let mean = colors.iter().sum::<f64>() / pixels as f64;
        let [weight, other_weight] = layers(Layer::Weight);
        let weights = differences(&weight, &other_weight, same);
        let weight_off = percentile(&weights, 0.99);
        println!(
            "{what}, projector {projector}: {hits} of {pixels} pixels hit; another node {:.3} %, distance off by {far_m:.1e} m (99.9 %), \
             radiance: mean {mean:.1e}, another {:.3} %, weight off by {weight_off:.1e} (99 %)",
            other * 1e2,
            unlike * 1e2
        );
        assert!(other <= bounds.other_node, "{what}: {other} of the pixels show another node");
        assert!(far_m <= 1e-5, "{what}: distances differ by {far_m} m");
        assert!(unlike <= bounds.other_radiance, "{what}: {unlike} of the pixels have another radiance");
        assert!(weight_off <= 1e-3, "{what}: weights differ by {weight_off}");
    }
    let [a, b] = room.each_ref().map(float_image);
    let seen = differences(&a, &b, |_| true);
    let unlike = seen.iter().filter(|d| **d > 1e-2).count() as f64 / seen.len() as f64;
    println!("{what}, room: {:.3} % of the pixels differ", unlike * 1e2);
    assert!(unlike <= bounds.other_radiance, "{what}: {unlike} of the room's pixels differ");
}

#[test]
fn the_demo_is_the_same_by_both_ways() {
    let Some(both) = Both::open("the demo") else { return };
    let (scene, projectors, _) = demo(SIZE_PX);
    let projectors: Vec<_> =
        projectors.iter().map(|(name, calibration)| (name.as_str(), calibration.clone())).collect();
    let mut rigs = both.rigs(&scene, &projectors, Settings { blend: true, ..ONE_SAMPLE });
    compare("demo", &mut rigs, &Bounds { other_node: 1e-3, other_radiance: 0.01 });
    drop(rigs);
    both.close();
}

#[test]
fn the_bunny_is_the_same_by_both_ways() {
    let Some(both) = Both::open("the bunny") else { return };
    let Some(data) = shared_data("the bunny by ray queries") else { return };
    let edits = json!([
        {"add": {"node": "bunny", "uri": "models/stanford-bunny.glb"}},
        {"light": {"name": "sun", "kind": "directional", "direction": [-0.5, -1, -0.6], "intensity": 2.5}},
        {"environment": {"color": [0.2, 0.3, 0.4]}},
    ]);
    let scene = editor_of(edits, vec![data]).current();
    let (low, high) = scene.bounds_of(0).unwrap();
    let middle = (low + high) * 0.5;
    let stand = Stand::new(middle + DVec3::new(0.35, 0.45, 1.3) * (high - low).max_element(), middle, SIZE_PX);
    let mut rigs = both.rigs(&scene, &[("left", stand.calibration())], Settings { samples: 4, ..ONE_SAMPLE });
    compare("bunny", &mut rigs, &Bounds { other_node: 2e-3, other_radiance: 0.01 });
    drop(rigs);
    both.close();
}

/// All roles, opaque shadows and such as fall through coloured sheets and through glass, mirrors, a mirrored and a sheared instance.
fn glass() -> Value {
    let ball = |name: &str, role: &str, at: [f64; 3], size: f64| json!({"add": {"node": name, "uri": "lantern:sphere", "role": role, "translation_m": at, "scale": [size, size, size]}});
    json!([
        {"add": {"node": "floor", "uri": "lantern:checker", "scale": [0.4, 0.4, 0.4]}},
        ball("glass", "prop", [0.0, 0.5, 0.0], 0.5),
        ball("mirror", "prop", [0.9, 0.3, 0.2], -0.3),
        ball("ghost", "virtual", [0.4, 0.3, 0.9], 0.2),
        ball("mask", "mask", [-0.9, 0.25, 0.4], 0.25),
        ball("drawn", "raster", [-0.5, 0.2, 1.0], 0.2),
        {"add": {"node": "red", "uri": "lantern:quad", "translation_m": [0.3, 1.6, 0.2], "scale": [0.5, 1, 0.3]}},
        {"add": {"node": "blue", "uri": "lantern:quad", "translation_m": [0.1, 1.9, 0.1], "rotation": [0.1305262, 0, 0, 0.9914449], "scale": [0.4, 1, 0.5]}},
        {"material": {"name": "glass/sphere", "base_color": [0.9, 1, 0.9], "roughness": 0, "metallic": 0, "transmission": 1, "thickness": 1, "ior": 1.5}},
        {"material": {"name": "mirror/sphere", "base_color": [1, 1, 1], "metallic": 1, "roughness": 0}},
        {"material": {"name": "red/quad", "base_color": [1, 0.2, 0.1], "metallic": 0, "roughness": 0, "transmission": 1}},
        {"material": {"name": "blue/quad", "base_color": [0.1, 0.3, 1], "metallic": 0, "roughness": 0, "transmission": 1}},
        {"light": {"name": "lamp", "kind": "point", "position_m": [0.4, 3, 0.4], "intensity": 12.0}},
        {"environment": {"uri": "lantern:studio"}},
    ])
}

#[test]
fn glass_masks_and_moves_are_the_same_by_both_ways() {
    let Some(both) = Both::open("glass, masks and moves") else { return };
    let at = |x: f64| Stand::new(DVec3::new(x, 1.6, 3.2), DVec3::new(0.0, 0.5, 0.0), SIZE_PX).calibration();
    let mut editor = editor_of(glass(), Vec::new());
    let projectors = [("left", at(-1.0)), ("right", at(1.0))];
    let mut rigs = both.rigs(&editor.current(), &projectors, Settings { blend: true, ..ONE_SAMPLE });
    let bounds = Bounds { other_node: 1e-3, other_radiance: 0.02 };
    compare("glass", &mut rigs, &bounds);

    // Other places, another mesh, one less: the top level is another each time, over bottom levels old and new.
    for (what, edits) in [
        (
            "moved",
            json!([{"set": {"node": "mirror", "translation_m": [0.7, 0.3, 0.5]}}, {"set": {"node": "red", "visible": false}}]),
        ),
        (
            "added",
            json!([{"add": {"node": "pot", "uri": "lantern:teapot", "translation_m": [-0.5, 0.0, 0.6], "scale": [0.3, 0.3, 0.3]}}, {"remove": {"node": "glass"}}]),
        ),
    ] {
        editor.apply(&edits_of(edits)).unwrap();
        for rig in &mut rigs {
            rig.renderer.set_scene(editor.current());
        }
        compare(what, &mut rigs, &bounds);
    }
    drop(rigs);
    both.close();
}

#[test]
fn a_scene_of_nothing_is_nothing() {
    let Some(both) = Both::open("an empty scene") else { return };
    let scene = scene_of(json!([{"environment": {"color": [0.2, 0.3, 0.4]}}]));
    let stand = Stand::new(EYE_M, DVec3::ZERO, SIZE_PX);
    let mut rigs = both.rigs(&scene, &[("left", stand.calibration())], ONE_SAMPLE);
    for rig in &mut rigs {
        rig.show(&[EYE_M]).unwrap();
        assert!(rig.layer(0, Layer::Distance).values.iter().all(|d| *d == f32::INFINITY));
    }
    drop(rigs);
    both.close();
}
