//! Light from many projectors: what each gives to a point, and that their sum shows no seam (DESIGN section 2).
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::sync::Arc;

use glam::{DVec2, DVec3, UVec2};
use lantern_calibration::Calibration;
use lantern_render::{Layer, Settings};
use lantern_scene::Scene;
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent, float_image},
    image::{FloatImage, percentile},
    stage::{Stand, scene_of},
};
use serde_json::json;

const SIZE_PX: UVec2 = UVec2::new(320, 200);
const EYE_M: DVec3 = DVec3::new(0.0, 1.8, 2.6);
/// What the white floor shows under the even sky.
const SHOWN: f32 = 0.48;

/// A floor, and a box upon it that stands in the light of both projectors.
fn floor(with_box: bool) -> Arc<Scene> {
    let mut edits = json!([
        {"add": {"node": "floor", "uri": "lantern:quad", "scale": [4, 1, 4]}},
        {"material": {"name": "floor/quad", "base_color": [1, 1, 1], "roughness": 1, "metallic": 0}},
        {"environment": {"color": [SHOWN, SHOWN, SHOWN]}},
    ]);
    if with_box {
        let add = json!({"add": {"node": "box", "uri": "lantern:cube", "translation_m": [0, 0.2, 0], "scale": [0.4, 0.4, 0.4]}});
        edits.as_array_mut().unwrap().push(add);
    }
    scene_of(edits)
}

/// From the left and from the right; their images overlap in the middle.
fn projectors() -> [(&'static str, Calibration); 2] {
    let at = |x: f64, target_x: f64| {
        let target_m = DVec3::new(target_x, 0.0, 0.0);
        Stand { fov_y_rad: 0.5, ..Stand::new(DVec3::new(x, 2.2, 1.6), target_m, SIZE_PX) }.calibration()
    };
    [("left", at(-1.2, -0.4)), ("right", at(1.0, 0.35))]
}

/// The pixels of an image around a place, `reach` to each side of the one that holds it; `None` where the image ends.
fn around(place_px: DVec2, reach: i32) -> Option<Vec<(usize, usize)>> {
    let at = place_px.floor().as_ivec2();
    let inside = |at: i32, size: u32| at - reach >= 0 && at + reach < size as i32;
    (inside(at.x, SIZE_PX.x) && inside(at.y, SIZE_PX.y)).then(|| {
        let row = |dy: i32| (-reach..=reach).map(move |dx| ((at.x + dx) as usize, (at.y + dy) as usize));
        (-reach..=reach).flat_map(row).collect()
    })
}

/// Catmull and Rom's interpolation (1974) of an image at a place: the weights' fall is curved within a pixel.
fn interpolated(image: &FloatImage, place_px: DVec2) -> f64 {
    let corner = (place_px - 0.5).floor();
    let t = place_px - 0.5 - corner;
    let weights = |t: f64| {
        [
            ((2.0 - t) * t - 1.0) * t / 2.0,
            ((3.0 * t - 5.0) * t * t + 2.0) / 2.0,
            ((4.0 - 3.0 * t) * t + 1.0) * t / 2.0,
            (t - 1.0) * t * t / 2.0,
        ]
    };
    let (across, down) = (weights(t.x), weights(t.y));
    let (x, y) = (corner.x as usize, corner.y as usize);
    (0..16).map(|i| across[i % 4] * down[i / 4] * f64::from(image.at(x + i % 4 - 1, y + i / 4 - 1)[0])).sum()
}

#[test]
fn weights_of_a_point_sum_to_one() {
    let settings = Settings { blend: true, ..ONE_SAMPLE };
    let rig = Rig::shown(&floor(true), &projectors(), settings, &[EYE_M]);
    let of = |p: usize| [Layer::Node, Layer::Distance, Layer::Weight].map(|layer| rig.layer(p, layer));
    let all = [of(0), of(1)];
    let (mut off, mut alone, mut skipped, mut smallest) = (Vec::new(), 0, 0, 1.0f64);
    for (mine, its) in [(0, 1), (1, 0)] {
        let ([node, distance, weight], [its_node, its_distance, its_weight]) = (&all[mine], &all[its]);
        let edges = node.silhouettes(2);
        for (x, y) in (0..node.height).flat_map(|y| (0..node.width).map(move |x| (x, y))) {
            if edges[y * node.width + x] || node.at(x, y)[0] < 0.0 {
                continue;
            }
            let ray = rig.frusta[mine].ray(DVec2::new(x as f64, y as f64) + 0.5).unwrap();
            let point_m = ray.at(f64::from(distance.at(x, y)[0]));
            let place_px = rig.frusta[its].project(point_m).unwrap().place_px;
            let mine_is = f64::from(weight.at(x, y)[0]);
            let outside = place_px.min_element() < -1.0 || (place_px - SIZE_PX.as_dvec2()).max_element() > 1.0;
            let Some(around) = around(place_px, 2) else {
                // Beyond the other's image it is alone; within two pixels of that border nothing is claimed.
                if outside {
                    assert_eq!(mine_is, 1.0, "projector {mine} at {x}, {y} is alone");
                    alone += 1;
                }
                continue;
            };

            // Whether the other's pixels around that place all show this very surface, or all something before it.
            let away_m = rig.frusta[its].ray(place_px).unwrap().origin_m.distance(point_m);
            let before = |&(x, y): &(usize, usize)| f64::from(its_distance.at(x, y)[0]) < away_m - 0.05;
            let same = around.iter().all(|&(u, v)| {
                its_node.at(u, v) == node.at(x, y) && (f64::from(its_distance.at(u, v)[0]) - away_m).abs() < 0.05
            });
            let values = around.iter().map(|&(u, v)| its_weight.at(u, v)[0]);
            let (low, high) = values.fold((f32::MAX, f32::MIN), |(low, high), v| (low.min(v), high.max(v)));
            if same && high - low < 0.2 {
                off.push((mine_is + interpolated(its_weight, place_px) - 1.0).abs());
                smallest = smallest.min(mine_is);
            } else if around.iter().all(before) {
                assert_eq!(mine_is, 1.0, "projector {mine} at {x}, {y}: something stands in the other's light");
                alone += 1;
            } else {
                skipped += 1;
            }
        }
    }
    off.sort_by(f64::total_cmp);
    let [middle, most, worst] = [0.5, 0.95, 1.0].map(|share| percentile(&off, share));
    println!(
        "{} points in the light of both: sums off by {middle:.1e} (median), {most:.1e} (95 %), {worst:.1e}; {alone} in one's; \
         {skipped} at edges",
        off.len()
    );
    assert!(off.len() > 20_000 && alone > 10_000 && skipped * 5 < off.len(), "{} {alone} {skipped}", off.len());
    // Where a fade begins, ends or folds (toward a corner, between two occlusion edges), nothing between pixels can tell it:
    // hence a share here. The next test needs no interpolation.
    assert!(middle <= 1e-4 && most <= 1e-3 && worst <= 0.02, "{middle} {most} {worst}");
    assert!(smallest < 0.01, "each fades out toward its border: {smallest}");
    assert_validation_is_silent();
}

/// Two projectors that look straight down, whole pixels apart: each pixel of the one is a pixel of the other, with nothing
/// to interpolate.
#[test]
fn weights_of_a_shared_pixel_sum_to_one() {
    const PITCH_M: f64 = 0.01;
    const APART: (usize, usize) = (90, 60);
    let at_m = |rows: usize, columns: usize| DVec3::new(rows as f64, 0.0, columns as f64) * PITCH_M;
    let stand = |at_m: DVec3| Stand {
        fov_y_rad: 2.0 * (f64::from(SIZE_PX.y) * PITCH_M / 2.0 / 2.0).atan(),
        ..Stand::new(at_m + DVec3::Y * 2.0, at_m, SIZE_PX)
    };
    let projectors =
        [("left", stand(DVec3::ZERO).calibration()), ("right", stand(at_m(APART.1, APART.0)).calibration())];
    let rig = Rig::shown(&floor(false), &projectors, Settings { blend: true, ..ONE_SAMPLE }, &[EYE_M]);
    let (weight, its_weight) = (rig.layer(0, Layer::Weight), rig.layer(1, Layer::Weight));
    let (mut shared, mut alone, mut worst) = (0, 0, 0.0f32);
    for (x, y) in (0..weight.height).flat_map(|y| (0..weight.width).map(move |x| (x, y))) {
        let ray = rig.frusta[0].ray(DVec2::new(x as f64, y as f64) + 0.5).unwrap();
        let point_m = ray.at(-ray.origin_m.y / ray.direction.y);
        let centre = rig.frusta[1].project(point_m).unwrap().place_px - 0.5;
        assert!((centre - centre.round()).abs().max_element() < 1e-6, "{centre}");
        let at = centre.round().as_ivec2();
        if (0..SIZE_PX.x as i32).contains(&at.x) && (0..SIZE_PX.y as i32).contains(&at.y) {
            let sum = weight.at(x, y)[0] + its_weight.at(at.x as usize, at.y as usize)[0];
            worst = worst.max((sum - 1.0).abs());
            shared += 1;
        } else {
            assert_eq!(weight.at(x, y), [1.0], "{x}, {y} is alone");
            alone += 1;
        }
    }
    println!("{shared} shared pixels: sums off by at most {worst:.1e}; {alone} of one alone");
    assert_eq!(shared, (SIZE_PX.x as usize - APART.0) * (SIZE_PX.y as usize - APART.1));
    assert!(worst <= 1e-3 && alone > 0, "{worst}");
    assert_validation_is_silent();
}

/// What the eye sees of the floor: of its lit pixels away from the border of the light, the least and the most, and the
/// largest step between neighbours.
fn room(blend: bool) -> (f32, f32, f32) {
    let mut rig = Rig::shown(&floor(false), &projectors(), Settings { blend, ..ONE_SAMPLE }, &[EYE_M]);
    let seen = float_image(&rig.renderer.room(EYE_M, [480, 360]).unwrap());
    let lit = FloatImage {
        channels: 1,
        values: seen.values.chunks(3).map(|c| f32::from(u8::from(c[0] > 0.1))).collect(),
        ..seen.clone()
    };
    let border = lit.silhouettes(2);
    let inside = |x: usize, y: usize| lit.at(x, y) == [1.0] && !border[y * lit.width + x];
    let (mut low, mut high, mut step, mut count) = (f32::MAX, f32::MIN, 0.0f32, 0);
    for (x, y) in (0..seen.height).flat_map(|y| (0..seen.width).map(move |x| (x, y))).filter(|&(x, y)| inside(x, y)) {
        let here = seen.at(x, y)[0];
        (low, high, count) = (low.min(here), high.max(here), count + 1);
        for (u, v) in [(x + 1, y), (x, y + 1)] {
            if u < seen.width && v < seen.height && inside(u, v) {
                step = step.max((seen.at(u, v)[0] - here).abs());
            }
        }
    }
    println!("room, blend {blend}: {count} lit pixels show {low:.4} to {high:.4}, steps up to {step:.4}");
    assert!(count > 5000, "{count}");
    (low, high, step)
}

#[test]
fn the_room_shows_no_seam() {
    // Eight bits of each of two projectors, and their interpolation, leave one per cent.
    let (low, high, step) = room(true);
    assert!(low >= SHOWN - 0.01 && high <= SHOWN + 0.01, "{low} to {high}");
    // Neighbours may differ by a level of eight bits in each picture, which is 0.0063 at this brightness.
    assert!(step <= 2.0 * 0.0063 + 1e-3, "{step}");

    // Without weights what both light is twice as bright.
    let (_, high, step) = room(false);
    assert!(high > 1.9 * SHOWN && step > 0.1, "{high} {step}");
    assert_validation_is_silent();
}
