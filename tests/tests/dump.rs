//! `lanternd bench --dump` (CONTRACT, Bench): the rays that the passes trace, and what they hit, held against the dumped triangles
//! alone, in f64.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{fs, path::Path};

use glam::{DVec3, UVec2};
use lantern_render::{RayKind, RecordedRay, Settings, stale::Stale};
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent},
    harness, lab,
    oracle::{
        bvh::Bvh,
        geometry::{Ray, Tri},
    },
    stage::{Stand, scene_of},
};
use serde_json::{Value, json};

/// A mirror over a floor, a virtual ball before it, and a mask.
const MORE: &str = r#"
[[scene.material]]
name = "ball/sphere"
metallic = 1.0
roughness = 0.0
[[scene.node]]
name = "ghost"
uri = "lantern:sphere"
role = "virtual"
translation_m = [0.3, 0.5, 0.8]
scale = [0.15, 0.1, 0.15]
[[scene.node]]
name = "cover"
uri = "lantern:cube"
role = "mask"
translation_m = [-0.9, 0.2, 0.2]
rotation = [0, 0.3826834, 0, 0.9238795]
scale = [0.4, 0.4, 0.4]
"#;

/// How far two roundings of one hit may lie apart, m: rays of a few metres in f32, from object space and from the world's.
const NEAR_M: f64 = 2e-4;

fn floats(path: &Path) -> Vec<f32> {
    let bytes = fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    assert_eq!(bytes.len() % 4, 0);
    bytes.chunks_exact(4).map(|c| f32::from_le_bytes(c.try_into().unwrap())).collect()
}

fn point(x: &[f32]) -> DVec3 {
    DVec3::new(x[0].into(), x[1].into(), x[2].into())
}

/// How far a point is outside a triangle, m.
fn outside_m(triangle: &Tri, at_m: DVec3) -> f64 {
    let [a, b, c] = triangle.corners_m;
    let normal = (b - a).cross(c - a).normalize_or_zero();
    [(a, b), (b, c), (c, a)]
        .map(|(from, to)| (at_m - from).dot((to - from).cross(normal).normalize_or_zero()))
        .into_iter()
        .fold(normal.dot(at_m - a).abs(), f64::max)
}

/// One kind's rays, in f64.
struct Kind {
    rays: Vec<Ray>,
    /// t and triangle.
    hits: Vec<(f64, u32)>,
    any: bool,
    range: std::ops::Range<u32>,
}

impl Kind {
    fn read(folder: &Path, name: &str, told: &Value) -> Self {
        let rays = floats(&folder.join(format!("{name}.rays")));
        let hits = floats(&folder.join(format!("{name}.hits")));
        let ray = |r: &[f32]| {
            assert_eq!(r[3], 0.0, "every walk of this scene starts at its origin");
            Ray { origin_m: point(r), direction: point(&r[4..]), t_max_m: r[7].into() }
        };
        let number = |key: &str| told[key].as_u64().unwrap() as u32;
        let kind = Self {
            rays: rays.chunks_exact(8).map(ray).collect(),
            hits: hits.chunks_exact(2).map(|h| (h[0].into(), h[1].to_bits())).collect(),
            any: told["hit"] == "any",
            range: number("first_triangle")..number("first_triangle") + number("triangles"),
        };
        let counted: u64 = told["rays"].as_object().unwrap().values().map(|n| n.as_u64().unwrap()).sum();
        assert_eq!((kind.rays.len(), kind.hits.len()), (counted as usize, counted as usize), "{name}");
        kind
    }

    /// Holds every hit against the triangles: it lies on the triangle that it names, where the ray goes, and nothing that a ray
    /// meets well within its edges lies before it, or at all where there is no hit.
    fn check(&self, name: &str, all: &[Tri], bvh: &Bvh) -> usize {
        let mut met = 0;
        for (ray, (t, triangle)) in self.rays.iter().zip(&self.hits) {
            assert!((ray.direction.length() - 1.0).abs() < 1e-5, "{name}: {ray:?}");
            let mut free_until_m = ray.t_max_m;
            if t.is_infinite() {
                assert_eq!(*triangle, u32::MAX, "{name}: a miss names a triangle");
            } else {
                met += 1;
                assert!(self.range.contains(triangle) && *t <= ray.t_max_m, "{name}: {t} {triangle}");
                let off_m = outside_m(&all[*triangle as usize], ray.at(*t));
                assert!(off_m < NEAR_M, "{name}: a hit is {off_m} m off its triangle: {ray:?} {t} {triangle}");
                free_until_m = if self.any { 0.0 } else { *t };
            }
            bvh.each(&Ray { t_max_m: free_until_m - NEAR_M, ..*ray }, |tri, meeting| {
                let inner = outside_m(tri, ray.at(meeting.t_m)).abs() < NEAR_M && meeting.weights.min_element() > 0.05;
                let counts = self.range.contains(&tri.triangle) && inner && meeting.t_m > 20.0 * NEAR_M;
                assert!(!counts, "{name}: {ray:?} has met {tri:?} at {}, and {t} was recorded", meeting.t_m);
                true
            });
        }
        met
    }
}

#[test]
fn a_dump_is_what_the_passes_traced_and_hit() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("lab.toml");
    fs::write(
        &file,
        lab::room().replace("samples = 1", "samples = 4").replace(lab::TRACKED, &[MORE, lab::TRACKED].concat()),
    )
    .unwrap();
    let dump = |to: &str| {
        let to = folder.path().join(to);
        let arguments = ["bench", "--frames", "1", "--case", "full", "--json", "-c"].map(str::to_owned).into_iter();
        let paths = [file.to_str().unwrap(), "--dump", to.to_str().unwrap()].map(str::to_owned);
        let arguments: Vec<String> = arguments.chain(paths).collect();
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let output = harness::run("lanternd", &arguments).unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success() && !stderr.contains("vulkan::validation"), "{stderr}");
        (to, serde_json::from_slice::<Value>(&output.stdout).unwrap())
    };
    let (first, told) = dump("first");
    let dumped = &told["dump"];
    assert_eq!(*dumped, serde_json::from_slice::<Value>(&fs::read(first.join("dump.json")).unwrap()).unwrap());

    let corners = floats(&first.join("triangles.f32"));
    let triangle = |(number, c): (usize, &[f32])| Tri {
        corners_m: [point(c), point(&c[3..]), point(&c[6..])],
        instance: 0,
        triangle: number as u32,
    };
    let all: Vec<Tri> = corners.chunks_exact(9).enumerate().map(triangle).collect();
    assert_eq!(Value::from(all.len()), dumped["triangles"]);
    let bvh = Bvh::new(all.clone());
    for name in ["primary", "secondary", "virtual", "shadow", "blend"] {
        let kind = Kind::read(&first, name, &dumped["kinds"][name]);
        let met = kind.check(name, &all, &bvh);
        println!("{name}: {} rays, {met} hits among {:?}", kind.rays.len(), kind.range);
        assert!(met > 0 && met < kind.rays.len(), "{name}: {met}");

        // As many as were counted where rays were counted.
        for projector in ["left", "right"] {
            let recorded = |name: &str| dumped["kinds"][name]["rays"][projector].as_u64().unwrap();
            let counted = &told["cases"]["full"]["projectors"][projector]["rays"];
            let expected = match name {
                "secondary" | "virtual" => recorded("secondary") + recorded("virtual"),
                _ => recorded(name),
            };
            assert_eq!(counted[if name == "virtual" { "secondary" } else { name }], expected, "{name} {projector}");
        }
    }

    // The same scene gives the same files, whatever the order in which invocations ran.
    let (second, _) = dump("second");
    for entry in fs::read_dir(&first).unwrap() {
        let path = entry.unwrap().path();
        let again = fs::read(second.join(path.file_name().unwrap())).unwrap();
        assert!(fs::read(&path).unwrap() == again, "{} is another one this time", path.display());
    }
}

/// What one buffer cannot hold comes in parts, which add up to the whole.
#[test]
fn parts_add_up_to_the_whole() {
    let scene = scene_of(json!([
        {"add": {"node": "floor", "uri": "lantern:checker", "scale": [0.4, 0.4, 0.4]}},
        {"add": {"node": "cube", "uri": "lantern:cube", "translation_m": [0, 0.5, 0]}},
        {"light": {"name": "sun", "kind": "directional", "direction": [-0.3, -1, -0.2], "intensity": 2.0}},
    ]));
    let stand = Stand::new(DVec3::new(1.0, 1.6, 3.0), DVec3::new(0.0, 0.5, 0.0), UVec2::new(64, 40));
    let settings = Settings { record_rays: true, ..ONE_SAMPLE };
    let mut rig = Rig::new(&scene, &[("left", stand.calibration())], settings);
    let mut of = |kind: RayKind, part: u32, parts: u32| {
        rig.renderer.record(kind, part, parts).unwrap();
        rig.renderer.make_stale(Stale::EVERYTHING);
        rig.show(&[DVec3::new(0.0, 1.6, 2.0)]).unwrap();
        let recorded = rig.renderer.recorded(0).unwrap();
        assert_eq!(recorded.rays.len(), recorded.wanted as usize);
        recorded
    };
    let sorted = |mut rays: Vec<RecordedRay>| {
        rays.sort_unstable_by_key(|ray| bytemuck::bytes_of(ray).to_vec());
        rays
    };
    for kind in [RayKind::Primary, RayKind::Shadow] {
        let whole = of(kind, 0, 1);
        assert_eq!(whole.rays.len(), whole.traced[kind as usize] as usize);
        let parts: Vec<_> = (0..3).map(|part| of(kind, part, 3)).collect();
        let most = parts.iter().map(|part| part.rays.len()).max().unwrap();
        assert!(!whole.rays.is_empty() && most < whole.rays.len() / 2, "{kind:?}: {most} of {}", whole.rays.len());
        assert!(parts.iter().all(|part| part.traced == whole.traced));
        assert_eq!(sorted(parts.into_iter().flat_map(|part| part.rays).collect()), sorted(whole.rays));
    }
    assert_validation_is_silent();
}
