//! Lenses: OpenCV's own values, the way back, and what is refused.

#![expect(clippy::unwrap_used, reason = "tests' helpers: what is given to them must be taken")]

use std::sync::Arc;

use glam::{DVec2, DVec3, UVec2, Vec2, Vec3};
use lantern_calibration::{
    BrownConrady, Calibration, CalibrationError, Convention, Frustum, Lens, Map, Maps, Matrix4, Warp,
};

/// What [`Lens::BrownConrady`] is held to, px.
const ROUND_TRIP_PX: f64 = 1e-9;

/// A camera of points.txt and what OpenCV saw.
struct Case {
    name: String,
    calibration: Calibration,
    points: Vec<(DVec3, DVec2)>,
}

/// Clip from view of OpenCV's camera (x right, y down, z forward) in Vulkan's clip space, from 0.1 m to 100 m.
fn projection(size_px: DVec2, focal_px: DVec2, centre_px: DVec2) -> Matrix4 {
    let (scale, shift) = (focal_px * 2.0 / size_px, centre_px * 2.0 / size_px - 1.0);
    let (near_m, far_m) = (0.1, 100.0);
    let depth = far_m / (far_m - near_m);
    [
        [scale.x, 0.0, shift.x, 0.0],
        [0.0, scale.y, shift.y, 0.0],
        [0.0, 0.0, depth, -near_m * depth],
        [0.0, 0.0, 1.0, 0.0],
    ]
}

const IDENTITY: Matrix4 = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

fn pinhole(size_px: UVec2, focal_px: DVec2, centre_px: DVec2, view: &Matrix4) -> Calibration {
    let clip_from_view = projection(size_px.as_dvec2(), focal_px, centre_px);
    Calibration::from_matrices(&clip_from_view, view, Convention::Vulkan, size_px).unwrap()
}

/// What points.txt says; make_points.py beside it made it.
fn cases() -> Vec<Case> {
    let mut cases: Vec<Case> = vec![];
    for line in include_str!("opencv/points.txt").lines() {
        let words: Vec<&str> = line.split_whitespace().filter(|word| *word != "|").collect();
        let n: Vec<f64> = words.iter().skip(1).filter_map(|word| word.parse().ok()).collect();
        match words[0] {
            "lens" => {
                let size_px = DVec2::new(n[0], n[1]).as_uvec2();
                let (focal_px, centre_px) = (DVec2::new(n[2], n[3]), DVec2::new(n[4], n[5]) + 0.5);
                let row = |i: usize| [n[11 + 3 * i], n[12 + 3 * i], n[13 + 3 * i], n[20 + i]];
                let view = [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]];
                let model = BrownConrady { focal_px, centre_px, k1: n[6], k2: n[7], p1: n[8], p2: n[9], k3: n[10] };
                let calibration = pinhole(size_px, focal_px, centre_px, &view);
                let calibration = calibration.with_lens(Lens::BrownConrady(model)).unwrap();
                cases.push(Case { name: words[1].to_owned(), calibration, points: vec![] });
            }
            "point" => {
                let case = cases.last_mut().unwrap();
                case.points.push((DVec3::new(n[0], n[1], n[2]), DVec2::new(n[3], n[4]) + 0.5));
            }
            _ => assert!(line.starts_with('#'), "{line}"),
        }
    }
    assert_eq!(cases.len(), 6);
    cases
}

/// Over the image, its edges and corners included.
fn places(size_px: UVec2) -> impl Iterator<Item = DVec2> {
    let across = move |i: u32, size: u32| f64::from(i) / 97.0 * f64::from(size);
    (0..=97).flat_map(move |y| (0..=97).map(move |x| DVec2::new(across(x, size_px.x), across(y, size_px.y))))
}

#[test]
fn points_fall_where_opencv_puts_them_and_rays_go_through_them() {
    for Case { name, calibration, points } in cases() {
        let (size_px, frustum) = (calibration.resolution_px().as_dvec2(), Frustum::new(calibration));
        let (mut worst_px, mut worst_ray_px) = (0.0f64, 0.0f64);
        let mut quarters = [0; 4];
        for &(world_m, seen_px) in &points {
            let projected = frustum.project(world_m).unwrap();
            worst_px = worst_px.max(projected.place_px.distance(seen_px));

            // The ray of OpenCV's pixel, followed to the point's distance, is back in the image where the point is: so the
            // inverse is measured in the same pixels.
            let ray = frustum.ray(seen_px).unwrap();
            let on_ray_m = ray.at((world_m - ray.origin_m).dot(ray.direction));
            let off_px = frustum.project(on_ray_m).unwrap().place_px.distance(projected.place_px);
            worst_ray_px = worst_ray_px.max(off_px);

            let place = seen_px / size_px;
            if place.cmpge(DVec2::ZERO).all() && place.cmple(DVec2::ONE).all() {
                quarters[usize::from(place.x > 0.5) + 2 * usize::from(place.y > 0.5)] += 1;
            }
        }
        assert!(quarters.iter().all(|&n| n >= 20), "{name}: the points do not cover the image: {quarters:?}");
        // What is stored has six decimals of a pixel.
        assert!(worst_px < 1e-4 && worst_ray_px < 1e-4, "{name}: {worst_px} px, {worst_ray_px} px");
    }
}

#[test]
fn what_a_lens_bends_it_bends_back() {
    for Case { name, calibration, .. } in cases() {
        let optics = calibration.optics();
        let (mut worst_px, mut most_px) = (0.0f64, 0.0f64);
        for real_px in places(calibration.resolution_px()) {
            let ideal_px = optics.ideal_px(real_px).unwrap();
            worst_px = worst_px.max(optics.real_px(ideal_px).unwrap().distance(real_px));
            most_px = most_px.max(ideal_px.distance(real_px));
        }
        assert!(worst_px < ROUND_TRIP_PX, "{name}: {worst_px} px");
        assert!((most_px > 20.0) == (name != "none"), "{name} bends by {most_px} px");
    }
}

#[test]
fn rays_through_a_lens_come_back_to_their_samples() {
    for Case { name, calibration, .. } in cases() {
        let size_px = calibration.resolution_px();
        let frustum = Frustum::new(calibration);
        for real_px in places(size_px) {
            let ray = frustum.ray(real_px).unwrap();
            for share in [0.0, 0.1, 1.0] {
                let back_px = frustum.project(ray.at(share * ray.t_max_m)).unwrap().place_px;
                assert!(back_px.distance(real_px) < 1e-6, "{name}: {real_px} came back to {back_px}");
            }
        }
    }
}

/// A barrel that folds where the slope 1 + 3·k1·r² is 0: at r = 1/√(−3·k1), whose image is 2/3 of that.
#[test]
fn a_lens_that_folds_inside_its_image_is_refused_with_the_radius() {
    let (size_px, focal_px, centre_px) = (UVec2::new(1280, 800), DVec2::splat(900.0), DVec2::new(640.0, 400.0));
    let model = |k1| BrownConrady { focal_px, centre_px, k1, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0 };
    let behind = |model| pinhole(size_px, focal_px, centre_px, &IDENTITY).with_lens(Lens::BrownConrady(model));
    assert!(behind(model(-0.15)).is_ok(), "2/3/√0.45 · 900 px = 894 px lies beyond the corner's 755 px");
    let message = behind(model(-0.25)).unwrap_err().to_string();
    assert!(message.starts_with("the lens folds back 69") && message.contains("reaches to 755 px"), "{message}");
    assert!(message.contains("hint:"), "{message}");

    // Beyond the disc, the polynomial comes back into the image: nothing there is shown.
    let optics = behind(model(-0.15)).unwrap().optics().clone();
    let far_px = centre_px + DVec2::new(900.0 * 2.58, 0.0);
    assert!(model(-0.15).distort_px(far_px).distance(centre_px) < 50.0);
    assert_eq!(optics.real_px(far_px), None);
    assert_eq!(optics.ideal_px(far_px), None);

    for wrong in [BrownConrady { k1: f64::NAN, ..model(0.0) }, BrownConrady { focal_px: DVec2::X, ..model(0.0) }] {
        let message = behind(wrong).unwrap_err().to_string();
        assert!(message.contains("hint: every number must be finite"), "{message}");
    }
}

/// A warp over an image, from where each place of it looks.
fn warp(size: UVec2, size_px: UVec2, ideal_px: impl Fn(DVec2) -> Option<DVec2>) -> Warp {
    let node = |i: u32| {
        let cell = UVec2::new(i % size.x, i / size.x).as_dvec2() + 0.5;
        ideal_px(cell / size.as_dvec2() * size_px.as_dvec2()).map_or(Vec2::NAN, |at| at.as_vec2())
    };
    Warp { size, ideal_px: (0..size.x * size.y).map(node).collect() }
}

/// Waves, on a rotation by a few degrees: no matrix and no polynomial.
fn waves(at: DVec2) -> DVec2 {
    let turned = DVec2::from_angle(0.08).rotate(at - DVec2::new(320.0, 200.0)) * 0.9 + DVec2::new(340.0, 190.0);
    turned + DVec2::new((at.y * 0.02).sin(), (at.x * 0.015).cos()) * 12.0
}

fn with_warp(size_px: UVec2, warp: Warp) -> Result<Calibration, CalibrationError> {
    let (focal_px, centre_px) = (DVec2::splat(600.0), size_px.as_dvec2() * 0.5);
    pinhole(size_px, focal_px, centre_px, &IDENTITY).with_lens(Lens::Warp(Arc::new(warp)))
}

#[test]
fn a_warp_is_met_at_its_nodes_and_comes_back_between_them() {
    let size_px = UVec2::new(640, 400);
    for size in [size_px, UVec2::new(33, 21), UVec2::new(2, 2), UVec2::new(2, 60)] {
        let warp = warp(size, size_px, |at| Some(waves(at)));
        let calibration = with_warp(size_px, warp.clone()).unwrap();
        for (index, ideal_px) in warp.ideal_px.iter().enumerate() {
            let node = UVec2::new(index as u32 % size.x, index as u32 / size.x).as_dvec2();
            let real_px = (node + 0.5) / size.as_dvec2() * size_px.as_dvec2();
            let found_px = calibration.optics().ideal_px(real_px).unwrap();
            assert!(found_px.distance(ideal_px.as_dvec2()) < 1e-9, "{real_px}: {found_px} and {ideal_px}");
        }
        let mut worst_px = 0.0f64;
        for real_px in places(size_px) {
            let ideal_px = calibration.optics().ideal_px(real_px).unwrap();
            worst_px = worst_px.max(calibration.optics().real_px(ideal_px).unwrap().distance(real_px));
        }
        assert!(worst_px < ROUND_TRIP_PX, "{size}: {worst_px} px");
        assert_eq!(calibration.optics().real_px(DVec2::new(-500.0, 100.0)), None);
    }
}

#[test]
fn a_warp_that_says_nothing_is_a_pinhole() {
    let size_px = UVec2::new(640, 400);
    let plain = with_warp(size_px, warp(UVec2::new(9, 7), size_px, Some)).unwrap();
    for real_px in places(size_px) {
        assert!(plain.optics().ideal_px(real_px).unwrap().distance(real_px) < 1e-4, "{real_px}");
    }
}

/// Pixel by pixel: what is dark is dark to its edge, and what is lit is lit to its own.
#[test]
fn pixels_without_light_have_no_ray_and_are_met_by_no_point() {
    let size_px = UVec2::new(64, 40);
    let lit = |at: DVec2| at.distance(DVec2::new(30.0, 21.0)) < 17.0 && !(at.x > 25.0 && at.x < 26.0);
    let calibration = with_warp(size_px, warp(size_px, size_px, |at| lit(at).then(|| waves(at)))).unwrap();
    let optics = calibration.optics();
    let mut dark = 0;
    for y in 0..size_px.y {
        for x in 0..size_px.x {
            let pixel = DVec2::new(f64::from(x), f64::from(y));
            let is_lit = lit(pixel + 0.5);
            dark += usize::from(!is_lit);
            for within in [DVec2::new(0.02, 0.02), DVec2::new(0.97, 0.4), DVec2::splat(0.5), DVec2::new(0.1, 0.9)] {
                let ideal_px = optics.ideal_px(pixel + within);
                assert_eq!(ideal_px.is_some(), is_lit, "{pixel} + {within}");
                let back_px = ideal_px.and_then(|at| optics.real_px(at));
                assert!(back_px.is_none_or(|at| at.distance(pixel + within) < ROUND_TRIP_PX), "{pixel} {back_px:?}");
                assert_eq!(back_px.is_some(), is_lit, "{pixel} + {within}");
            }
        }
    }
    assert!((1000..2000).contains(&dark), "{dark}");
    assert_eq!(calibration.clone(), calibration, "holes are equal to themselves");
}

/// Whatever is dark beside it: a box around a rectangle has every place in it that is lit.
#[test]
fn a_box_around_a_rectangle_has_all_that_it_shows() {
    let (size_px, nodes) = (UVec2::new(160, 100), UVec2::new(17, 11));
    let darks: [fn(DVec2) -> bool; 5] =
        [|at| at.x < 30.0, |at| at.y < 30.0, |at| at.x > 110.0, |at| at.y > 60.0, |at| at.x + at.y > 150.0];
    for dark in darks {
        let warp = warp(nodes, size_px, |at| (!dark(at)).then(|| waves(at)));
        let calibration = with_warp(size_px, warp).unwrap();
        let optics = calibration.optics();
        for (low, high) in [((0, 0), (160, 100)), ((96, 48), (128, 72)), ((8, 8), (40, 40)), ((113, 61), (120, 66))] {
            let [low_px, high_px] = [low, high].map(|(x, y)| DVec2::new(f64::from(x), f64::from(y)));
            let bounds = optics.ideal_bounds(low_px, high_px);
            for i in 0..=100u32 {
                let share = DVec2::new(f64::from(i % 10) / 9.0, f64::from(i / 10) / 10.0).min(DVec2::ONE);
                let Some(at) = optics.ideal_px(low_px + share * (high_px - low_px)) else { continue };
                let (low, high) = bounds.unwrap();
                assert!(at.cmpge(low - 1e-6).all() && at.cmple(high + 1e-6).all(), "{at} is not in {low} to {high}");
            }
        }
    }
}

#[test]
fn warps_that_are_none_are_refused_in_words() {
    let size_px = UVec2::new(64, 40);
    let refused = |warp: Warp| with_warp(size_px, warp).unwrap_err().to_string();
    let good = warp(UVec2::new(8, 5), size_px, Some);
    let cut = Warp { ideal_px: good.ideal_px[..39].to_vec(), ..good.clone() };
    assert!(refused(cut).starts_with("the warp of 8 × 5 has 39 nodes"));
    assert!(refused(warp(UVec2::new(1, 5), size_px, Some)).contains("at least 2 × 2"));
    assert!(refused(warp(good.size, size_px, |_| None)).contains("every node is NaN"));
    assert!(refused(warp(good.size, size_px, |_| Some(DVec2::ONE))).contains("all are the same"));
    let mut infinite = good.clone();
    infinite.ideal_px[11].y = f32::INFINITY;
    assert!(refused(infinite).starts_with("the warp's node in column 3, row 1 is infinite"));

    // Folded like a sheet of paper.
    let folded = warp(UVec2::new(9, 5), size_px, |at| Some(DVec2::new((at.x - 40.0).abs(), at.y)));
    let message = refused(folded);
    assert!(message.starts_with("the warp folds over: ") && message.contains("of its 32 cells"), "{message}");

    // One bad node among thousands is noise; a mirror is none.
    let mut noisy = warp(UVec2::new(64, 40), size_px, Some);
    noisy.ideal_px[1000].x += 3.0;
    assert!(with_warp(size_px, noisy).is_ok());
    let mirror = with_warp(size_px, warp(good.size, size_px, |at| Some(DVec2::new(64.0 - at.x, at.y)))).unwrap();
    let back_px = mirror.optics().real_px(DVec2::new(10.0, 20.0)).unwrap();
    assert!(back_px.distance(DVec2::new(54.0, 20.0)) < 1e-4, "{back_px}");
}

#[test]
fn maps_that_are_none_are_refused_in_words() {
    let calibration = pinhole(UVec2::new(64, 40), DVec2::splat(60.0), DVec2::new(32.0, 20.0), &IDENTITY);
    let of = |size, values| Some(Map { size, values });
    let good = || of(UVec2::new(2, 1), vec![Vec3::splat(0.5), Vec3::ONE]);
    assert!(calibration.clone().with_maps(Maps { alpha: good(), beta: good() }).is_ok());
    let refused = |maps| calibration.clone().with_maps(maps).unwrap_err().to_string();
    let short = Maps { alpha: good(), beta: of(UVec2::new(3, 2), vec![Vec3::ZERO]) };
    assert!(refused(short).starts_with("the beta map of 3 × 2 has 1 values"));
    for wrong in [Vec3::new(0.2, f32::NAN, 0.2), Vec3::splat(255.0), Vec3::new(0.0, 0.0, -0.1)] {
        let maps = Maps { alpha: of(UVec2::new(1, 2), vec![Vec3::ZERO, wrong]), beta: None };
        assert!(refused(maps).starts_with("the alpha map has"), "{wrong}");
    }
}
