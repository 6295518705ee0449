//! A pixel whose samples land on the same thing is shaded once, unless a neighbour differs: what that saves, and what it may cost.

use std::sync::Arc;

use glam::{DVec3, UVec2};
use lantern_render::{Layer, RayCounts, Settings, Walk};
use lantern_scene::Scene;
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent},
    image::FloatImage,
    stage::{Stand, scene_of},
};
use serde_json::{Value, json};

const SIZE_PX: UVec2 = UVec2::new(320, 200);
const EYE_M: DVec3 = DVec3::new(0.8, 1.4, 3.0);

/// The bound that `refine.comp` holds neighbours to, in roots of radiance.
const BOUND: f64 = 1.0 / 24.0;

/// A ball of some material on a checkered floor before the studio.
fn ball(material: Value, others: bool) -> Arc<Scene> {
    let mut material = material;
    material["name"] = json!("ball/sphere");
    let mut edits = vec![
        json!({"add": {"node": "floor", "uri": "lantern:checker", "scale": [0.4, 0.4, 0.4]}}),
        json!({"add": {"node": "ball", "uri": "lantern:sphere", "translation_m": [0, 0.5, 0], "scale": [0.5, 0.5, 0.5]}}),
        json!({"material": material}),
        json!({"light": {"name": "sun", "kind": "directional", "direction": [-0.5, -1, -0.6], "intensity": 2.0}}),
        json!({"environment": {"uri": "lantern:studio"}}),
    ];
    if others {
        edits.push(json!({"add": {"node": "ghost", "uri": "lantern:sphere", "role": "virtual", "translation_m": [0.5, 0.6, 0.9], "scale": [0.2, 0.2, 0.2]}}));
        edits.push(json!({"add": {"node": "dark", "uri": "lantern:cube", "role": "mask", "translation_m": [-0.7, 0.2, 0.6], "scale": [0.2, 0.2, 0.2]}}));
    }
    scene_of(Value::Array(edits))
}

fn shown(scene: &Arc<Scene>, settings: Settings) -> (FloatImage, RayCounts) {
    let stand = Stand { fov_y_rad: 0.5, ..Stand::new(DVec3::new(-0.4, 1.6, 3.2), DVec3::new(0.0, 0.5, 0.0), SIZE_PX) };
    let settings = Settings { count_rays: true, ..settings };
    let mut rig = Rig::new(scene, &[("left", stand.calibration())], settings);
    let mut report = rig.show(&[EYE_M]).into_iter().flat_map(|report| report.projectors);
    let rays = report.next().and_then(|projector| projector.rays).unwrap_or_default();
    (rig.layer(0, Layer::Radiance), rays)
}

/// The stated bound: of all pixels 99.5 % differ from what all their samples show by no more than the bound to which neighbours
/// are held, in roots of radiance; what differs more has a thin thing between its samples.
fn assert_within_the_bound(what: &str, scene: &Arc<Scene>, samples: u32, walk: Walk) {
    assert!(include_str!("../../shaders-glsl/refine.comp").contains("const float BOUND = 1.0 / 24.0;"));
    let settings = Settings { samples, walk, ..ONE_SAMPLE };
    let (all, rays_of_all) = shown(scene, Settings { shade_once: false, ..settings });
    let (once, rays) = shown(scene, settings);
    let apart = |(a, b): (&f32, &f32)| (f64::from(a.max(0.0)).sqrt() - f64::from(b.max(0.0)).sqrt()).abs();
    let of_channels: Vec<f64> = once.values.iter().zip(&all.values).map(apart).collect();
    let of_pixels: Vec<f64> = of_channels.chunks_exact(3).map(|c| c.iter().copied().fold(0.0, f64::max)).collect();
    let beyond = of_pixels.iter().filter(|d| **d > BOUND).count() as f64 / of_pixels.len() as f64;
    let touched: Vec<f64> = of_pixels.into_iter().filter(|d| *d > 0.0).collect();
    let rms = (touched.iter().map(|d| d * d).sum::<f64>() / touched.len() as f64).sqrt();
    println!(
        "{what}, {samples} samples: {:.2} of the rays; {} pixels differ, by {rms:.4} (root mean square); beyond the bound: {:.4} %",
        f64::from(rays.secondary) / f64::from(rays_of_all.secondary),
        touched.len(),
        beyond * 100.0
    );
    assert!(touched.len() > 500, "{what}: nothing was shaded once");
    assert!(beyond < 0.005, "{what}: {beyond}");
    assert!(rms < BOUND / 2.0, "{what}: {rms}");
    assert!(f64::from(rays.secondary) < 0.8 * f64::from(rays_of_all.secondary), "{what}: {rays:?}, {rays_of_all:?}");
}

#[test]
fn a_mirror_shaded_once_stays_within_the_bound() {
    let mirror = ball(json!({"roughness": 0, "metallic": 1, "base_color": [0.95, 0.95, 0.95]}), false);
    for samples in [4, 9, 16] {
        assert_within_the_bound("mirror", &mirror, samples, Walk::BY_DEVICE);
    }
    assert_validation_is_silent();
}

/// Where a device's buffers are too small for the hits of all of a pixel's samples, they lie in several, and are looked at one after the other.
#[test]
fn hits_in_several_buffers_show_the_same() {
    let mirror = ball(json!({"roughness": 0, "metallic": 1, "base_color": [0.95, 0.95, 0.95]}), true);
    let plane_bytes = u64::from(SIZE_PX.x) * u64::from(SIZE_PX.y) * 8;
    let of_planes = |planes: u64| Walk { hits_bytes: Some(planes * plane_bytes), ..Walk::BY_DEVICE };
    let all_of = |walk| shown(&mirror, Settings { samples: 4, shade_once: false, walk, ..ONE_SAMPLE }).0;
    let together = all_of(Walk::BY_DEVICE);
    for planes in [1, 2] {
        let apart = all_of(of_planes(planes));
        let differ =
            together.values.iter().zip(&apart.values).filter(|(a, b)| (*a - *b).abs() > 1e-5 * a.abs()).count();
        assert_eq!(differ, 0, "numbers that differ with {planes} planes a buffer");
        assert_within_the_bound("mirror, hits apart", &mirror, 4, of_planes(planes));
    }
    assert_validation_is_silent();
}

#[test]
fn glass_shaded_once_stays_within_the_bound() {
    let glass = ball(
        json!({"roughness": 0, "metallic": 0, "base_color": [1, 1, 1], "transmission": 1, "thickness": 1, "ior": 1.5}),
        false,
    );
    assert_within_the_bound("glass", &glass, 4, Walk::BY_DEVICE);
    assert_validation_is_silent();
}

/// Virtual things on the line of sight, and masks, which stay dark, beside a coated ball.
#[test]
fn virtual_things_and_masks_shaded_once_stay_within_the_bound() {
    let coated = ball(json!({"roughness": 1, "metallic": 0, "clearcoat": 1, "base_color": [0.3, 0.1, 0.1]}), true);
    assert_within_the_bound("coat, virtual ball and mask", &coated, 4, Walk::BY_DEVICE);
    assert_validation_is_silent();
}
