//! Rays and the way back, over a thousand random invertible matrices: points on a ray, projected back through the same
//! matrix, must land within 0.01 px of the sample that made it (DESIGN, section 2).

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3, DVec4, UVec2};
use lantern_calibration::{Calibration, Convention, Frustum, GpuFrustum, Matrix4};

/// Matrices a test.
const MATRICES: usize = 1000;

/// SplitMix64 (Steele, Lea and Flood, OOPSLA 2014): the same matrices every time.
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.bits() >> 11) as f64 / (1u64 << 53) as f64)
    }

    fn either(&mut self) -> bool {
        self.bits() >> 63 == 1
    }

    fn vector(&mut self, size: f64) -> DVec3 {
        DVec3::new(self.between(-size, size), self.between(-size, size), self.between(-size, size))
    }
}

/// One random projector and how it was made.
struct Case {
    calibration: Calibration,
    keystoned: bool,
    infinite: bool,
}

fn rows(m: DMat4) -> Matrix4 {
    std::array::from_fn(|i| m.row(i).to_array())
}

/// An off-axis projection at a random place, half of them sheared, half keystoned by a homography of x, y and w (one that
/// keeps w above 0 over the whole image), in both conventions, with standard, reversed and infinite depth, and some
/// parallel ones.
#[expect(clippy::unwrap_used, reason = "a test's helper: a matrix made to be invertible must be taken")]
fn random_case(random: &mut Random) -> Case {
    let convention = if random.either() { Convention::OpenGl } else { Convention::Vulkan };
    let (reversed, infinite, parallel) = (random.either(), random.either(), random.between(0.0, 1.0) < 0.1);
    let near = random.between(0.05, 0.5);
    let far = near * random.between(20.0, 2000.0);

    // z and w rows, looking along −Z; depth `a·z + b` over w is `at_near` at z = −near and `at_far` at z = −far.
    let [first, second] = convention.depth_limits();
    let (at_near, at_far) = if reversed { (second, first) } else { (first, second) };
    let infinite = infinite && !parallel;
    let (z_row, w_row) = if parallel {
        let a = (at_near - at_far) / (far - near);
        (DVec4::new(0.0, 0.0, a, at_near + a * near), DVec4::W)
    } else {
        let (a, b) = if infinite {
            (-at_far, (at_near - at_far) * near)
        } else {
            let b = (at_near - at_far) * near * far / (far - near);
            (b / far - at_far, b)
        };
        (DVec4::new(0.0, 0.0, a, b), DVec4::NEG_Z)
    };
    let up = -convention.y_sign();
    let shift = DVec2::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0));
    let x_row = DVec4::new(random.between(1.0, 4.0), 0.0, 0.0, 0.0) - w_row * shift.x;
    let y_row = DVec4::new(0.0, up * random.between(1.0, 4.0), 0.0, 0.0) - w_row * shift.y;
    let mut clip_from_view = DMat4::from_cols(x_row, y_row, z_row, w_row).transpose();

    let keystoned = random.either();
    if keystoned {
        let mut entry = |size: f64| random.between(0.3, 1.0) * size * if random.either() { 1.0 } else { -1.0 };
        let homography = DMat4::from_cols(
            DVec4::new(1.0, entry(0.1), 0.0, entry(0.1)),
            DVec4::new(entry(0.1), 1.0, 0.0, entry(0.1)),
            DVec4::new(0.0, 0.0, 1.0, 0.0),
            DVec4::new(entry(0.25), entry(0.25), 0.0, 1.0),
        )
        .transpose();
        clip_from_view = homography * clip_from_view;
    }

    let mut view_from_world =
        DMat4::from_quat(DQuat::from_scaled_axis(random.vector(3.0))) * DMat4::from_translation(random.vector(4.0));
    if random.either() {
        let shear = DMat3::IDENTITY + DMat3::from_cols(random.vector(0.3), random.vector(0.3), random.vector(0.3));
        view_from_world = DMat4::from_mat3(shear) * view_from_world;
    }
    let resolution_px = UVec2::new(64 + (random.bits() % 4032) as u32, 64 + (random.bits() % 2096) as u32);
    let calibration =
        Calibration::from_matrices(&rows(clip_from_view), &rows(view_from_world), convention, resolution_px).unwrap();
    Case { calibration, keystoned, infinite }
}

fn random_place_px(random: &mut Random, calibration: &Calibration) -> DVec2 {
    DVec2::new(random.between(0.0, 1.0), random.between(0.0, 1.0)) * calibration.resolution_px().as_dvec2()
}

/// Divides first: bilinear between the *divided* corners of both planes, as the paper's equation 3 does.
fn naive_point(frustum: &Frustum, place_px: DVec2, along: f64) -> DVec3 {
    let corners = frustum.corners().map(|corner| corner.truncate() / corner.w);
    let share = place_px / frustum.calibration().resolution_px().as_dvec2();
    let bilinear = |at: usize| {
        let top = corners[at].lerp(corners[at + 1], share.x);
        let bottom = corners[at + 2].lerp(corners[at + 3], share.x);
        top.lerp(bottom, share.y)
    };
    bilinear(0).lerp(bilinear(4), along)
}

#[test]
fn points_on_rays_land_on_their_samples() {
    let mut random = Random(1);
    let (mut worst_px, mut rays) = (0.0f64, 0);
    for _ in 0..MATRICES {
        let Case { calibration, .. } = random_case(&mut random);
        let frustum = Frustum::new(calibration.clone());
        for _ in 0..16 {
            let place_px = random_place_px(&mut random, &calibration);
            let Some(ray) = frustum.ray(place_px) else { continue };
            rays += 1;
            let reach_m = ray.t_max_m.min(50.0);
            let mut last_w = 0.0;
            for share in [0.0, 0.01, 0.3, 1.0] {
                let back = frustum.project(ray.at(share * reach_m)).expect("a point on a ray has clip w above 0");
                worst_px = worst_px.max(back.place_px.distance(place_px));
                assert!(back.window_z > -1e-9 && back.window_z < 1.0 + 1e-9, "{back:?}");
                let grows = if frustum.is_parallel() { back.clip_w > 0.0 } else { back.clip_w > last_w };
                assert!(grows, "clip w falls along a ray: {last_w} then {}", back.clip_w);
                last_w = back.clip_w;
            }
        }
    }
    assert_eq!(rays, MATRICES * 16, "every pixel of these has a ray");
    assert!(worst_px < 1e-6, "{worst_px} px");
}

#[test]
fn dividing_before_interpolating_misses_on_keystoned_matrices() {
    let mut random = Random(2);
    let (mut straight, mut keystoned) = (0, 0);
    for _ in 0..MATRICES {
        let case = random_case(&mut random);
        let frustum = Frustum::new(case.calibration.clone());
        if case.infinite || frustum.ray(DVec2::ZERO).is_none_or(|ray| !ray.t_max_m.is_finite()) {
            continue;
        }
        let worst_px = (0..16)
            .map(|_| {
                let place_px = random_place_px(&mut random, &case.calibration);
                let along = random.between(0.0, 1.0);
                let back = frustum.project(naive_point(&frustum, place_px, along));
                back.map_or(f64::INFINITY, |back| back.place_px.distance(place_px))
            })
            .fold(0.0, f64::max);

        // It is exact where w is constant on both planes, which shows that the naive method is what it should be …
        if case.keystoned {
            keystoned += 1;
            assert!(worst_px > 0.01, "keystoned, and only {worst_px} px off");
        } else {
            straight += 1;
            assert!(worst_px < 1e-6, "not keystoned, and {worst_px} px off");
        }
    }
    // … and there were enough of either.
    assert!(straight > 100 && keystoned > 100, "{straight} {keystoned}");
}

/// f32 keeps 0.01 px wherever f32 can: what it resolves at a point is 2⁻²⁴ of the larger of the point's and the ray's
/// origin's distance from the scene origin, times how much the homogeneous w varies over the image (a homography's doing).
/// Where a pixel is fewer than 1000 of those wide no arithmetic in f32 has a chance; such samples are left out, and must be few.
#[test]
fn single_precision_keeps_a_hundredth_of_a_pixel() {
    let mut random = Random(3);
    let (mut samples, mut resolvable, mut worst_px) = (0, 0, 0.0f64);
    for _ in 0..MATRICES {
        let Case { calibration, .. } = random_case(&mut random);
        let frustum = Frustum::new(calibration.clone());
        let origin_m = random.vector(1.0);
        let packed = GpuFrustum::new(&frustum, origin_m);
        for _ in 0..16 {
            let place_px = random_place_px(&mut random, &calibration).as_vec2();
            let t_m = random.between(0.5, 5.0) as f32;
            let exact = frustum.ray(place_px.as_dvec2()).unwrap();
            let ray = packed.ray(place_px).unwrap();
            if f64::from(t_m) > exact.t_max_m {
                continue;
            }
            let point_m = ray.origin_m + ray.direction * t_m;
            let world_m = point_m.as_dvec3() + origin_m;
            let back = frustum.project(world_m).unwrap();

            // How many units of what f32 resolves here go into a pixel.
            let width_m = [DVec2::X, DVec2::Y]
                .map(|step| frustum.ray(place_px.as_dvec2() + step).unwrap().at(f64::from(t_m)))
                .map(|beside_m| (beside_m - exact.at(f64::from(t_m))).reject_from_normalized(exact.direction).length());
            let reach_m = f64::from(point_m.length().max(ray.origin_m.length()));
            let corner_w = frustum.corners().map(|corner| corner.w.abs());
            let local_w = 1.0 / frustum.project(exact.origin_m).unwrap().clip_w;
            let spread = corner_w[..4].iter().fold(1.0, |most: f64, w| most.max(w / local_w));
            let units = width_m[0].min(width_m[1]) / (reach_m * spread * 2f64.powi(-24));
            samples += 1;
            if units < 1000.0 {
                continue;
            }
            resolvable += 1;
            worst_px = worst_px.max(back.place_px.distance(place_px.as_dvec2()));
        }
    }
    assert!(worst_px < 0.01, "{worst_px} px");
    assert!(resolvable * 10 > samples * 8, "{resolvable} of {samples}");
}

/// Depth and the far plane in f32. Along a ray hardly anything cancels: within the two units of a 24-bit depth
/// buffer for 99 % of samples of any of these matrices, and never far beyond, where a shear makes the functionals long and
/// the ray nearly perpendicular to them. From the point alone it is eight units for a projector like those of a room:
/// within 4 m of the scene's origin, lighting things half a metre to 6 m away.
#[test]
fn single_precision_keeps_depth() {
    const UNIT: f64 = 1.0 / (1 << 24) as f64;
    let mut random = Random(4);
    let (mut samples, mut beyond) = (0, 0);
    let (mut worst_along, mut worst_of_point, mut worst_reach) = (0.0f64, 0.0f64, 0.0f64);
    for _ in 0..MATRICES {
        let Case { calibration, .. } = random_case(&mut random);
        let frustum = Frustum::new(calibration.clone());
        let packed = GpuFrustum::new(&frustum, DVec3::ZERO);
        for _ in 0..16 {
            let place_px = random_place_px(&mut random, &calibration).as_vec2();
            let (exact, ray) = (frustum.ray(place_px.as_dvec2()).unwrap(), packed.ray(place_px).unwrap());
            let t_m = (random.between(0.0, 1.0) * exact.t_max_m.min(10.0)) as f32;
            let window_z = frustum.project(exact.at(f64::from(t_m))).unwrap().window_z;
            let error = (f64::from(packed.window_z(&ray, t_m)) - window_z).abs();
            samples += 1;
            beyond += usize::from(error > 2.0 * UNIT);
            worst_along = worst_along.max(error);
            if exact.t_max_m.is_finite() && exact.t_max_m < 1e4 {
                worst_reach = worst_reach.max((f64::from(ray.t_max_m) / exact.t_max_m - 1.0).abs());
            }
        }
    }

    for convention in [Convention::OpenGl, Convention::Vulkan] {
        let [first, second] = convention.depth_limits();
        for (at_near, at_far) in [(first, second), (second, first)] {
            let (near, far) = (0.1, 50.0);
            let b = (at_near - at_far) * near * far / (far - near);
            let projection = [
                [2.0, 0.0, 0.1, 0.0],
                [0.0, -3.2 * convention.y_sign(), 0.6, 0.0],
                [0.0, 0.0, b / far - at_far, b],
                [0.0, 0.0, -1.0, 0.0],
            ];
            for _ in 0..100 {
                let view = DMat4::from_quat(DQuat::from_scaled_axis(random.vector(3.0)))
                    * DMat4::from_translation(random.vector(2.3));
                let size_px = UVec2::new(1280, 800);
                let calibration = Calibration::from_matrices(&projection, &rows(view), convention, size_px).unwrap();
                let frustum = Frustum::new(calibration.clone());
                assert_eq!(frustum.is_reversed(), at_near > at_far);
                let packed = GpuFrustum::new(&frustum, DVec3::ZERO);
                let ray = packed.ray(random_place_px(&mut random, &calibration).as_vec2()).unwrap();
                let point_m = ray.origin_m + ray.direction * random.between(0.4, 6.0) as f32;
                let exact = frustum.project(point_m.as_dvec3()).unwrap();
                worst_of_point = worst_of_point.max((f64::from(packed.window_z_of(point_m)) - exact.window_z).abs());
                let back_px = packed.place_px(point_m).unwrap().as_dvec2();
                assert!(back_px.distance(exact.place_px) < 0.01, "{back_px} {exact:?}");
            }
        }
    }
    assert!(beyond * 100 < samples, "{beyond} of {samples} beyond two units");
    assert!(worst_along <= 16.0 * UNIT, "{} units", worst_along / UNIT);
    assert!(worst_of_point <= 8.0 * UNIT, "{} units", worst_of_point / UNIT);
    assert!(worst_reach <= 2e-4, "{worst_reach}");
}

/// Where a homography turns clip w negative inside the image, exactly the pixels that a rasteriser would clip have no ray.
#[test]
fn pixels_behind_a_homography_have_no_ray() {
    let projection = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.02, -0.202], [4.0, 0.0, -1.0, 0.0]];
    let identity = rows(DMat4::IDENTITY);
    let calibration =
        Calibration::from_matrices(&projection, &identity, Convention::OpenGl, UVec2::new(64, 64)).unwrap();
    let (frustum, mut with, mut without) = (Frustum::new(calibration.clone()), 0, 0);
    let packed = GpuFrustum::new(&frustum, DVec3::ZERO);
    for x in 0..64 {
        let place_px = DVec2::new(f64::from(x) + 0.5, 20.5);
        assert_eq!(packed.ray(place_px.as_vec2()).is_some(), frustum.ray(place_px).is_some(), "{place_px}");
        match frustum.ray(place_px) {
            Some(ray) => {
                with += 1;
                let back = frustum.project(ray.at(0.5)).unwrap();
                assert!(back.place_px.distance(place_px) < 1e-6, "{back:?}");
            }
            None => without += 1,
        }
    }
    assert!(with > 10 && without > 10, "{with} with a ray, {without} without");
}

/// Nothing but being invertible: sixteen normal numbers. Rays exist where clip w is above 0 near them, and are exact there.
#[test]
fn any_invertible_matrix_will_do() {
    let mut random = Random(5);
    let (mut rays, mut worst_px) = (0, 0.0f64);
    for _ in 0..MATRICES {
        let any: Matrix4 = std::array::from_fn(|_| std::array::from_fn(|_| random.between(-1.0, 1.0)));
        let m = DMat4::from_cols_array_2d(&any);
        // A condition number of a few thousand costs as many digits, and is left to the linear algebra's books.
        let condition = [m, m.inverse()].map(|m| m.to_cols_array().iter().map(|v| v * v).sum::<f64>().sqrt());
        if condition[0] * condition[1] > 1e3 {
            continue;
        }
        let convention = if random.either() { Convention::OpenGl } else { Convention::Vulkan };
        let identity = rows(DMat4::IDENTITY);
        let calibration = Calibration::from_matrices(&any, &identity, convention, UVec2::new(640, 480)).unwrap();
        let frustum = Frustum::new(calibration.clone());
        for _ in 0..16 {
            let place_px = random_place_px(&mut random, &calibration);
            let Some(ray) = frustum.ray(place_px) else { continue };
            for t_m in [0.0, 0.3, 2.0].map(|t_m| f64::min(t_m, ray.t_max_m)) {
                rays += 1;
                let back = frustum.project(ray.at(t_m)).expect("in front");
                worst_px = worst_px.max(back.place_px.distance(place_px));
            }
        }
    }
    assert!(worst_px < 1e-6, "{worst_px} px");
    assert!(rays > MATRICES, "{rays}");
}
