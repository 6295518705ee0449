//! What depends on the eye, what does not, and that no projector's place shows in it (PAPER.md, Figure 8).
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::sync::Arc;

use glam::{DVec2, DVec3, UVec2};
use lantern_render::{Layer, Settings};
use lantern_scene::Scene;
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent},
    stage::{Stand, scene_of},
};
use serde_json::{Value, json};

const SIZE_PX: UVec2 = UVec2::new(320, 200);
const EYE_M: DVec3 = DVec3::new(0.8, 1.4, 3.0);

fn ball(material: Value) -> Arc<Scene> {
    let mut material = material;
    material["name"] = json!("ball/sphere");
    scene_of(json!([
        {"add": {"node": "floor", "uri": "lantern:checker", "scale": [0.4, 0.4, 0.4]}},
        {"add": {"node": "ball", "uri": "lantern:sphere", "translation_m": [0, 0.5, 0], "scale": [0.5, 0.5, 0.5]}},
        {"add": {"node": "box", "uri": "lantern:cube", "translation_m": [0.9, 0.25, 0.5], "scale": [0.3, 0.5, 0.3]}},
        {"material": material},
        {"environment": {"uri": "lantern:studio"}},
        {"light": {"name": "lamp", "kind": "point", "position_m": [1, 3, 1], "intensity": 8.0}},
    ]))
}

fn stand(x: f64) -> Stand {
    Stand { fov_y_rad: 0.4, ..Stand::new(DVec3::new(x, 1.6, 3.2), DVec3::new(0.0, 0.5, 0.0), SIZE_PX) }
}

#[test]
fn a_moving_eye_changes_a_mirror() {
    let scene = ball(json!({"roughness": 0, "metallic": 1}));
    let mut rig = Rig::shown(&scene, &[("left", stand(0.0).calibration())], ONE_SAMPLE, &[EYE_M]);
    let (node, before) = (rig.layer(0, Layer::Node), rig.layer(0, Layer::Radiance));
    rig.show(&[EYE_M + DVec3::new(0.05, 0.0, 0.0)]).expect("an eye that moved is something to render");
    let after = rig.layer(0, Layer::Radiance);
    let changed = |index: f32| {
        let of = (0..node.values.len()).filter(|&at| node.values[at] == index);
        let (all, changed): (Vec<_>, Vec<_>) = (
            of.clone().collect(),
            of.filter(|at| before.values[at * 3..at * 3 + 3] != after.values[at * 3..at * 3 + 3]).collect(),
        );
        changed.len() as f64 / all.len() as f64
    };
    println!("5 cm of the eye change {:.1} % of a mirror's pixels", changed(1.0) * 100.0);
    assert!(changed(1.0) > 0.5, "{}", changed(1.0));
    assert_eq!((changed(0.0), changed(2.0)), (0.0, 0.0), "the matte floor and box have no part in it");
    assert_validation_is_silent();
}

#[test]
fn a_diffuse_scene_is_the_same_to_the_bit_from_everywhere() {
    let scene = ball(json!({"roughness": 1, "metallic": 0}));
    for samples in [1, 4] {
        let settings = Settings { samples, ..ONE_SAMPLE };
        let mut rig = Rig::shown(&scene, &[("left", stand(0.0).calibration())], settings, &[EYE_M]);
        let bits = |rig: &Rig| rig.layer(0, Layer::Radiance).values.iter().map(|c| c.to_bits()).collect::<Vec<_>>();
        let (before, color) = (bits(&rig), rig.color(0));
        assert!(color.iter().any(|c| *c != [0; 3]));
        for eyes in [vec![DVec3::new(-2.0, 0.7, 1.0)], vec![DVec3::new(0.0, 4.0, -1.0), EYE_M], vec![]] {
            rig.show(&eyes);
            assert!(bits(&rig) == before && rig.color(0) == color, "{samples} samples, {eyes:?}");
        }
    }
    assert_validation_is_silent();
}

/// Of the points of the mirror that both projectors see, how many there are, and on what share of them the two agree: where
/// what the one shows lies within what the other shows around the same point, a pixel's width to each side, and 0.01.
fn agreement(settings: Settings) -> (usize, f64) {
    let scene = ball(json!({"roughness": 0, "metallic": 1, "base_color": [1, 1, 1]}));
    let projectors = [("left", stand(-1.2).calibration()), ("right", stand(1.2).calibration())];
    let rig = Rig::shown(&scene, &projectors, settings, &[EYE_M]);
    let layers = |p: usize| [Layer::Node, Layer::Distance, Layer::Radiance].map(|of| rig.layer(p, of));
    let ([node, distance, radiance], [its_node, its_distance, its_radiance]) = (layers(0), layers(1));
    let (mut both, mut agree) = (0, 0);
    for (x, y) in (0..node.height).flat_map(|y| (0..node.width).map(move |x| (x, y))) {
        if node.at(x, y) != [1.0] {
            continue;
        }
        let ray = rig.frusta[0].ray(DVec2::new(x as f64, y as f64) + 0.5).unwrap();
        let point_m = ray.at(f64::from(distance.at(x, y)[0]));
        let place_px = rig.frusta[1].project(point_m).unwrap().place_px;
        let its_ray = rig.frusta[1].ray(place_px).unwrap();
        let away_m = point_m.distance(its_ray.origin_m);

        // Its pixels around the point, all of which must lie on the mirror near the point.
        let at = place_px.floor().as_ivec2();
        let around: Vec<(usize, usize)> = (-1..=1)
            .flat_map(|dy| (-1..=1).map(move |dx| (at.x + dx, at.y + dy)))
            .filter(|(x, y)| (0..SIZE_PX.x as i32).contains(x) && (0..SIZE_PX.y as i32).contains(y))
            .map(|(x, y)| (x as usize, y as usize))
            .collect();
        let seen = |&(x, y): &(usize, usize)| {
            its_node.at(x, y) == [1.0] && (f64::from(its_distance.at(x, y)[0]) - away_m).abs() < 0.02
        };
        if around.len() < 9 || !around.iter().all(seen) {
            continue;
        }
        both += 1;
        let within = (0..3).all(|channel| {
            let values = around.iter().map(|&(x, y)| its_radiance.at(x, y)[channel]);
            let (low, high) = values.fold((f32::MAX, f32::MIN), |(low, high), v| (low.min(v), high.max(v)));
            (low - 0.01..=high + 0.01).contains(&radiance.at(x, y)[channel])
        });
        agree += usize::from(within);
    }
    (both, agree as f64 / both as f64)
}

#[test]
fn two_projectors_agree_on_a_mirror_unless_they_reflect_their_own_rays() {
    let (both, share) = agreement(ONE_SAMPLE);
    let (_, naive) = agreement(Settings { eye_at_projector: true, ..ONE_SAMPLE });
    println!(
        "of {both} points of a mirror, two projectors agree on {:.2} %, naively on {:.2} %",
        share * 100.0,
        naive * 100.0
    );
    assert!(both > 2000, "{both}");
    assert!(share >= 0.99, "{share}");
    assert!(naive < 0.5, "the naive method must fail this, and agrees on {naive}");
    assert_validation_is_silent();
}
