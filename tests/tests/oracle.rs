//! What must hold of the method itself, shown on the oracle: energy, view dependence, roles, shadows.

use glam::{DVec2, DVec3, UVec2};
use lantern_calibration::Frustum;
use lantern_tests::{
    oracle::{
        Settings, World,
        geometry::Ray,
        jitter::seed_words,
        primary::{PrimaryHit, primary_hit, primary_ray},
        render, render_pixel,
        secondary::{Eye, Look, Sample, eye_dependent, radiance},
        shade::fresnel_dielectric,
    },
    stage::{Stand, scene_of},
};
use serde_json::{Value, json};

const SIZE_PX: UVec2 = UVec2::new(48, 32);
const EYE_M: DVec3 = DVec3::new(0.8, 1.4, 3.0);

fn projector(x: f64) -> Frustum {
    Stand::new(DVec3::new(x, 2.0, 4.0), DVec3::new(0.0, 0.5, 0.0), SIZE_PX).frustum()
}

/// A ball of radius ½ m on a checkered floor, under a constant sky.
fn ball(material: Value) -> Value {
    let mut material = material;
    material["name"] = json!("ball/sphere");
    json!([
        {"add": {"node": "floor", "uri": "lantern:checker"}},
        {"add": {"node": "ball", "uri": "lantern:sphere", "translation_m": [0, 0.5, 0], "scale": [0.5, 0.5, 0.5]}},
        {"material": material},
        {"environment": {"color": [0.4, 0.6, 0.9]}},
        {"light": {"name": "lamp", "kind": "point", "position_m": [1, 3, 1], "intensity": 20.0}},
    ])
}

fn sample(seed_words: &[u32]) -> Sample<'_> {
    Sample { pixel: UVec2::ZERO, index: 0, seed_words, max_depth: 8 }
}

fn hits<'a>(world: &'a World, frustum: &'a Frustum, node: usize) -> impl Iterator<Item = PrimaryHit> + 'a {
    (0..SIZE_PX.y)
        .flat_map(|y| (0..SIZE_PX.x).map(move |x| UVec2::new(x, y)))
        .filter_map(|pixel| primary_hit(world, primary_ray(frustum, pixel, DVec2::splat(0.5))?))
        .filter(move |hit| hit.node == node)
}

/// In a room that shines white from everywhere, nothing shows more than white; what absorbs nothing shows white, but for
/// what the bounds on depth, rays and throughput, and masking without multiple bounces, cut off.
#[test]
fn white_furnace() {
    let furnace = |material: Value| {
        let mut material = material;
        material["name"] = json!("ball/sphere");
        scene_of(json!([
            {"add": {"node": "ball", "uri": "lantern:sphere", "translation_m": [0, 0.5, 0]}},
            {"material": material},
            {"environment": {"color": [1, 1, 1]}},
        ]))
    };
    for (name, least, material) in [
        ("matte", 0.999, json!({"roughness": 1, "metallic": 0})),
        ("mirror", 0.999, json!({"roughness": 0, "metallic": 1})),
        ("satin", 0.8, json!({"roughness": 0.5, "metallic": 1})),
        ("glass", 0.97, json!({"roughness": 0, "metallic": 0, "transmission": 1, "thickness": 1, "ior": 1.5})),
        ("sheet", 0.97, json!({"roughness": 0, "metallic": 0, "transmission": 1, "ior": 1.5})),
    ] {
        let scene = furnace(material);
        let world = World::new(&scene);
        let frustum = projector(0.0);
        let picture = render(&world, &frustum, &Settings::new("left", 1, 24, EYE_M), 1);
        let seen: Vec<_> = hits(&world, &frustum, 0).collect();
        assert!(seen.len() > 200, "{name}: {}", seen.len());

        // Pixels that the eye cannot see, and those at the very limb, have no claim to be white.
        let mut shown = Vec::new();
        for (pixel, hit) in picture.pixels.iter().filter(|pixel| pixel.hits > 0).zip(&seen) {
            assert!(pixel.radiance.max_element() <= 1.0 + 1e-6, "{name}: {}", pixel.radiance);
            let v = (EYE_M - hit.surface.position_m).normalize();
            if v.dot(hit.surface.normal) > 0.3 && v.dot(hit.surface.normal_geometric) > 0.3 {
                shown.push(pixel.radiance.x);
            }
        }
        let mean = shown.iter().sum::<f64>() / shown.len() as f64;
        assert!(mean >= least, "{name}: {mean}");
    }
}

/// Moving the eye changes a mirror's picture, and leaves a matte one's bits alone.
#[test]
fn only_what_depends_on_the_eye_moves_with_it() {
    let moved_m = EYE_M + DVec3::new(0.1, 0.0, 0.0);
    let pictures = |material: Value| {
        let scene = scene_of(ball(material));
        let world = World::new(&scene);
        [EYE_M, moved_m].map(|eye_m| render(&world, &projector(0.0), &Settings::new("left", 4, 8, eye_m), 1))
    };
    let [before, after] = pictures(json!({"roughness": 0, "metallic": 1}));
    let changed = before.pixels.iter().zip(&after.pixels).filter(|(a, b)| a.radiance != b.radiance);
    assert!(changed.clone().count() > 20, "{}", changed.count());
    assert!(changed.clone().all(|(a, _)| a.hits > 0));

    let [before, after] = pictures(json!({"roughness": 1, "metallic": 0}));
    assert_eq!(before.pixels, after.pixels);
}

/// Two projectors on one mirror agree on each point that both see; reflecting the projectors' own rays, they do not.
#[test]
fn projectors_agree_on_a_mirror_unless_they_reflect_their_own_rays() {
    let scene = scene_of(ball(json!({"roughness": 0, "metallic": 1})));
    let world = World::new(&scene);
    let (left, right) = (projector(-1.5), projector(1.5));
    let words = seed_words("left", 1);
    let viewer = Eye::Viewers(vec![EYE_M]);
    let (mut both, mut naive_differs) = (0, 0);
    for hit in hits(&world, &left, 1) {
        // The same point by the other projector's ray, where that one sees it.
        let place_px = right.project(hit.surface.position_m).unwrap().place_px;
        let Some(ray) = primary_ray(&right, UVec2::ZERO, place_px) else { continue };
        let Some(other) = primary_hit(&world, ray) else { continue };
        if other.surface.position_m.distance(hit.surface.position_m) > 1e-6 {
            continue;
        }
        let look = |hit: &PrimaryHit, eye: &Eye| match eye_dependent(&world, hit, eye, sample(&words)) {
            Look::Add(color) => color,
            Look::Hidden(_) => panic!("nothing is virtual here"),
        };
        both += 1;
        let (a, b) = (look(&hit, &viewer), look(&other, &viewer));
        assert!((a - b).abs().max_element() < 1e-4, "{a} by the one, {b} by the other");
        let (a, b) = (look(&hit, &Eye::Projector), look(&other, &Eye::Projector));
        naive_differs += usize::from((a - b).abs().max_element() > 0.05);
    }
    assert!(both > 30, "{both}");
    // Where both of the naive rays meet the constant sky, they agree for want of anything to disagree on.
    assert!(naive_differs * 5 > both, "{naive_differs} of {both}");
}

/// Glass with the index of air is not there: what the eye sees through it is what it sees without it.
#[test]
fn glass_of_index_one_vanishes() {
    let scene = scene_of(ball(json!({"roughness": 0, "metallic": 0, "transmission": 1, "thickness": 1, "ior": 1.0})));
    let mut without = ball(json!({}));
    without.as_array_mut().unwrap().push(json!({"remove": {"node": "ball"}}));
    without.as_array_mut().unwrap().remove(2);
    let without = scene_of(without);
    let (world, empty) = (World::new(&scene), World::new(&without));
    let words = seed_words("left", 1);
    let mut seen = 0;
    for hit in hits(&world, &projector(0.0), 1) {
        let Look::Add(look) = eye_dependent(&world, &hit, &Eye::Viewers(vec![EYE_M]), sample(&words)) else {
            panic!("nothing is virtual here")
        };
        if look == DVec3::ZERO {
            continue; // The eye does not see this side.
        }
        let direction = (hit.surface.position_m - EYE_M).normalize();
        let expected = radiance(&empty, Ray::new(hit.surface.position_m, direction), sample(&words));
        assert!((look - expected).abs().max_element() < 1e-4, "{look} through the glass, {expected} without");
        seen += 1;
    }
    assert!(seen > 50, "{seen}");
}

/// A virtual thing is passed by the projector, and hides what the eye sees behind it; a mask is hit, and stays black.
#[test]
fn roles_are_what_they_are() {
    let mut edits = ball(json!({"roughness": 1, "metallic": 0}));
    let between_m = (EYE_M + DVec3::new(0.0, 0.5, 0.5)) * 0.5;
    edits.as_array_mut().unwrap().extend([
        json!({"add": {"node": "ghost", "uri": "lantern:sphere", "role": "virtual",
                       "translation_m": between_m.to_array(), "scale": [0.05, 0.05, 0.05]}}),
        json!({"material": {"name": "ghost/sphere", "base_color": [0, 0, 0], "emissive": [0, 7, 0]}}),
    ]);
    let scene = scene_of(edits.clone());
    let world = World::new(&scene);
    let frustum = projector(0.0);
    let picture = render(&world, &frustum, &Settings::new("left", 1, 8, EYE_M), 1);
    let green = picture.pixels.iter().filter(|pixel| pixel.radiance == DVec3::new(0.0, 7.0, 0.0)).count();
    assert!(green > 2, "{green}");
    assert!(picture.pixels.iter().all(|pixel| pixel.node != 2.0), "the projector's rays hit what is not there");

    edits.as_array_mut().unwrap().push(json!({"set": {"node": "ball", "role": "mask"}}));
    let scene = scene_of(edits);
    let world = World::new(&scene);
    let picture = render(&world, &frustum, &Settings::new("left", 1, 8, EYE_M), 1);
    let masked: Vec<_> = picture.pixels.iter().filter(|pixel| pixel.node == 1.0).collect();
    assert!(masked.len() > 50 && masked.iter().all(|pixel| pixel.radiance == DVec3::ZERO));
}

/// A point light over a floor: full light, the shadow of something opaque, and that of a thin pane.
#[test]
fn shadows_are_hard_and_panes_let_light_through() {
    let lit = |pane: Value| {
        let mut edits = vec![
            json!({"add": {"node": "floor", "uri": "lantern:quad"}}),
            json!({"light": {"name": "lamp", "kind": "point", "position_m": [0, 2, 0], "intensity": 4.0}}),
        ];
        if !pane.is_null() {
            edits.push(json!({"add": {"node": "pane", "uri": "lantern:quad", "translation_m": [0, 1.5, 0]}}));
            edits.push(json!({"material": pane}));
        }
        let scene = scene_of(Value::Array(edits));
        let world = World::new(&scene);
        let stand = Stand::new(DVec3::new(0.0, 1.0, 0.0), DVec3::ZERO, UVec2::new(9, 9));
        let pixel = render_pixel(&world, &stand.frustum(), &Settings::new("left", 1, 8, EYE_M), UVec2::new(4, 4));
        assert_eq!(pixel.node, 0.0);
        pixel.radiance.x
    };
    let open = lit(Value::Null);
    assert!((open - 1.0 / std::f64::consts::PI).abs() < 1e-6, "{open}");
    assert_eq!(lit(json!({"name": "pane/quad", "metallic": 0})), 0.0);
    let through = lit(json!({"name": "pane/quad", "transmission": 1, "metallic": 0, "ior": 1.5}));
    assert!((through / open - (1.0 - fresnel_dielectric(1.0, 1.5))).abs() < 1e-4, "{}", through / open);
}
