//! Primary rays on the GPU, for projectors of any matrix: where they land, projected back, is the centre of their pixel.
//!
//! A hit's distance alone does not tell where the GPU's ray went. So the floor tells: three lights of one colour channel
//! each stand above it, and what it shows of each falls with the distance from that light, which gives the point.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::f64::consts::PI;

use glam::{DMat3, DMat4, DVec2, DVec3, DVec4, UVec2};
use lantern_calibration::{Calibration, Convention, Matrix4};
use lantern_render::Layer;
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent},
    random::SplitMix64,
    stage::scene_of,
};
use serde_json::json;

const PROJECTORS: u64 = 12;
/// Height of the lights above the floor, m.
const HEIGHT_M: f64 = 1.5;
/// Where each channel's light stands over the floor (x, z), m.
const LIGHTS_M: [DVec2; 3] = [DVec2::new(-2.0, -1.5), DVec2::new(2.5, -1.0), DVec2::new(0.0, 2.0)];
const CANDELA: f64 = 100.0;

fn rows(m: DMat4) -> Matrix4 {
    std::array::from_fn(|i| m.row(i).to_array())
}

/// A projector one to three metres above the floor that looks at its middle: off-axis always; sheared, keystoned, reversed,
/// infinite, and of either convention by turns.
fn projector(number: u64) -> Calibration {
    let mut random = SplitMix64(number);
    let mut between = |low: f64, high: f64| low + (high - low) * random.unit();
    let bit = |i: u64| number >> i & 1 == 1;
    let convention = if bit(0) { Convention::OpenGl } else { Convention::Vulkan };

    // Depth row: `a·z + b` over −z is `at_near` at z = −near and `at_far` at z = −far.
    let (near, far) = (between(0.05, 0.3), between(20.0, 200.0));
    let [first, second] = convention.depth_limits();
    let (at_near, at_far) = if bit(1) { (second, first) } else { (first, second) };
    let infinite = number.is_multiple_of(5);
    let b = if infinite { (at_near - at_far) * near } else { (at_near - at_far) * near * far / (far - near) };
    let a = if infinite { -at_far } else { b / far - at_far };
    let focal = between(1.0, 2.0);
    let shift = DVec2::new(between(-0.6, 0.6), between(-0.6, 0.6));
    let mut clip_from_view = DMat4::from_cols(
        DVec4::new(focal, 0.0, shift.x, 0.0),
        DVec4::new(0.0, -focal * 1.6 * convention.y_sign(), shift.y, 0.0),
        DVec4::new(0.0, 0.0, a, b),
        DVec4::NEG_Z,
    )
    .transpose();
    if bit(2) {
        // A homography of x, y and w that keeps w above 0 over the image.
        let mut entry = |size: f64| between(-size, size);
        let homography = DMat4::from_cols(
            DVec4::new(1.0, entry(0.1), 0.0, entry(0.1)),
            DVec4::new(entry(0.1), 1.0, 0.0, entry(0.1)),
            DVec4::Z,
            DVec4::new(entry(0.3), entry(0.3), 0.0, 1.0),
        );
        clip_from_view = homography.transpose() * clip_from_view;
    }

    let position_m = DVec3::new(between(-2.0, 2.0), between(1.0, 3.0), between(-2.0, 2.0));
    let target_m = DVec3::new(between(-0.5, 0.5), 0.0, between(-0.5, 0.5));
    let back = (position_m - target_m).normalize();
    let right = DVec3::Y.cross(back).normalize();
    let mut turn = DMat3::from_cols(right, back.cross(right), back).transpose();
    if bit(3) {
        let mut column = || DVec3::new(between(-0.2, 0.2), between(-0.2, 0.2), between(-0.2, 0.2));
        turn = (DMat3::IDENTITY + DMat3::from_cols(column(), column(), column())) * turn;
    }
    let view = DMat4::from_mat3(turn) * DMat4::from_translation(-position_m);
    let size_px = UVec2::new(200 + (between(0.0, 120.0) as u32), 120 + (between(0.0, 80.0) as u32));
    Calibration::from_matrices(&rows(clip_from_view), &rows(view), convention, size_px).unwrap()
}

/// The point of the floor that shows these colours. A channel is I·h/(π d³) at distance d from a light of height h; the
/// squares of two distances differ by something linear in the point.
fn point_that_shows(radiance: &[f32]) -> DVec3 {
    let square: [f64; 3] =
        std::array::from_fn(|i| (CANDELA * HEIGHT_M / (PI * f64::from(radiance[i]))).powf(2.0 / 3.0));
    let line = |i: usize| {
        let step_m = LIGHTS_M[i] - LIGHTS_M[0];
        let squares_m2 = LIGHTS_M[i].length_squared() - LIGHTS_M[0].length_squared();
        (step_m * 2.0, square[0] - square[i] + squares_m2)
    };
    let ((a, a_is), (b, b_is)) = (line(1), line(2));
    let determinant = a.perp_dot(b);
    DVec3::new((a_is * b.y - b_is * a.y) / determinant, 0.0, (a.x * b_is - b.x * a_is) / determinant)
}

#[test]
fn rays_land_where_their_pixels_project() {
    let light = |name: &str, channel: usize| {
        let mut color = [0.0; 3];
        color[channel] = 1.0;
        let at_m = [LIGHTS_M[channel].x, HEIGHT_M, LIGHTS_M[channel].y];
        json!({"light": {"name": name, "kind": "point", "position_m": at_m, "color": color, "intensity": CANDELA}})
    };
    let scene = scene_of(json!([
        {"add": {"node": "floor", "uri": "lantern:quad", "scale": [16, 1, 16]}},
        {"material": {"name": "floor/quad", "base_color": [1, 1, 1], "metallic": 0, "roughness": 1}},
        light("red", 0),
        light("green", 1),
        light("blue", 2),
    ]));
    let projectors: Vec<_> = (0..PROJECTORS).map(|number| ("", projector(number))).collect();
    let rig = Rig::shown(&scene, &projectors, ONE_SAMPLE, &[DVec3::Y]);
    let (mut worst_px, mut worst_share) = (0.0f64, 0.0f64);
    for (number, frustum) in rig.frusta.iter().enumerate() {
        let (radiance, distance) = (rig.layer(number, Layer::Radiance), rig.layer(number, Layer::Distance));
        let mut hits = 0;
        for (x, y) in (0..distance.height).flat_map(|y| (0..distance.width).map(move |x| (x, y))) {
            let distance_m = f64::from(distance.at(x, y)[0]);
            if !distance_m.is_finite() {
                continue;
            }
            hits += 1;
            let centre_px = DVec2::new(x as f64, y as f64) + 0.5;
            let point_m = point_that_shows(radiance.at(x, y));
            let back_px = frustum.project(point_m).unwrap().place_px;
            worst_px = worst_px.max(back_px.distance(centre_px));

            // And the distance along the exact ray ends at that very point.
            let ray = frustum.ray(centre_px).unwrap();
            worst_share = worst_share.max(ray.at(distance_m).distance(point_m) / distance_m);
        }
        assert!(hits * 3 > distance.values.len(), "projector {number} sees only {hits} points of the floor");
        assert!(worst_px <= 0.01, "projector {number}: a hit is {worst_px} px off its pixel's centre");
        assert!(worst_share <= 1e-5, "projector {number}: a distance is off by {worst_share:e} of itself");
    }
    println!("{PROJECTORS} projectors: at most {worst_px:.5} px and {worst_share:.1e} of the distance off");
    assert_validation_is_silent();
}
