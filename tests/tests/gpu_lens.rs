//! Lenses on the GPU: OpenCV's distortion and measured warps, in rays, in what is rasterised, in weights and in brightness.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::sync::Arc;
use std::time::Duration;

use glam::{DVec2, DVec3, UVec2, Vec3};
use lantern_calibration::{Calibration, GpuLens, Lens, Map, Maps, Optics};
use lantern_gpu::{
    Binding, BindingKind, Bindings, Buffer, BufferKind, ComputePipeline, Recorder, Resource, TexelFormat,
};
use lantern_render::{Layer, Pattern, RasterOrder, Settings};
use lantern_scene::Scene;
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent, device, shader},
    image::{FloatImage, percentile},
    lenses,
    random::SplitMix64,
    stage::{Stand, scene_of, still_life},
};
use serde_json::json;

const SIZE_PX: UVec2 = UVec2::new(640, 400);
const EYE_M: DVec3 = DVec3::new(0.8, 1.4, 3.0);
/// What a sample may be off, px.
const BOUND_PX: f64 = 0.01;
/// Two units of a depth buffer of 24 bits.
const TWO_UNITS: f32 = 2.0 / 16_777_216.0;

fn stand(size_px: UVec2) -> Stand {
    Stand::new(DVec3::new(0.5, 1.7, 2.6), DVec3::new(0.0, 0.25, 0.0), size_px)
}

fn behind(lens: Lens) -> Calibration {
    stand(SIZE_PX).calibration().with_lens(lens).unwrap()
}

/// Where the shader leads these places.
fn led(calibration: &Calibration, places_px: &[DVec2], to_real: bool) -> Vec<Option<DVec2>> {
    const fn row(binding: u32, name: &'static str, kind: BindingKind, writes: bool) -> Binding {
        Binding { set: 0, binding, name, kind, reads: !writes, writes }
    }
    const TABLE: &[Binding] = &[
        row(0, "Places", BindingKind::StorageBuffer, false),
        row(1, "Found", BindingKind::StorageBuffer, true),
        row(42, "Lenses", BindingKind::StorageBuffer, false),
        row(37, "lens_texels", BindingKind::UniformTexelBuffer, false),
    ];
    let device = device();
    let mut texels = vec![[0.0f32; 4]; 7];
    let lens = GpuLens::new(calibration, &mut texels);
    let pipeline = ComputePipeline::new(device, shader("lens.comp", TABLE, 12), &[]).unwrap();
    let storage = |name, bytes| Buffer::new(device, name, BufferKind::Storage, bytes as u64).unwrap();
    let places: Vec<f32> = places_px.iter().flat_map(|at| at.as_vec2().to_array()).collect();
    let (given, found) = (storage("places", places.len() * 4), storage("found", places.len() * 8));
    let header = storage("lenses", size_of::<GpuLens>());
    let kind = BufferKind::Texel(TexelFormat::Rgba32Float);
    let grids = Buffer::new(device, "lens grids", kind, texels.len() as u64 * 16).unwrap();
    let back = Buffer::new(device, "back", BufferKind::Readback, found.bytes()).unwrap();
    let resources = [("Places", &given), ("Found", &found), ("Lenses", &header), ("lens_texels", &grids)];
    let resources = resources.map(|(name, buffer)| (name, Resource::Buffer(buffer)));
    let bindings = Bindings::new(&pipeline, &resources).unwrap();
    let mut recorder = Recorder::new(device, 0, "lens").unwrap();
    recorder.upload(&given, 0, bytemuck::cast_slice(&places)).unwrap();
    recorder.upload(&header, 0, bytemuck::bytes_of(&lens)).unwrap();
    recorder.upload(&grids, 0, bytemuck::cast_slice(&texels)).unwrap();
    let push = [0, u32::from(to_real), places_px.len() as u32];
    let groups = [(places_px.len() as u32).div_ceil(64), 1, 1];
    recorder.dispatch(&pipeline, &bindings, bytemuck::bytes_of(&push), groups).unwrap();
    recorder.copy_buffer(&found, 0, &back, 0, found.bytes()).unwrap();
    device.submit(recorder.finish().unwrap(), &[]).unwrap().wait(Duration::from_secs(60)).unwrap();
    let rows: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&back.read(0, back.bytes()).unwrap());
    let place = |row: &[f32; 4]| (row[2] > 0.5).then(|| DVec2::new(f64::from(row[0]), f64::from(row[1])));
    rows.iter().map(place).collect()
}

/// Away from the holes of a warp and from its image's border, by a pixel.
fn is_inner(optics: &Optics, real_px: DVec2) -> bool {
    let beside = [DVec2::X, DVec2::NEG_X, DVec2::Y, DVec2::NEG_Y].map(|step| real_px + step);
    let inside = |at: &DVec2| at.cmpge(DVec2::ZERO).all() && at.cmple(SIZE_PX.as_dvec2()).all();
    beside.iter().all(|at| inside(at) && optics.ideal_px(*at).is_some())
}

/// Both ways of the shader against f64: what it gets wrong moves no sample by a hundredth of a pixel of the real image.
#[test]
fn the_shader_leads_where_f64_does() {
    let mut random = SplitMix64(5);
    for (name, lens) in lenses::all(SIZE_PX) {
        let calibration = behind(lens);
        let optics = calibration.optics();
        let size = SIZE_PX.as_dvec2();
        let places: Vec<DVec2> =
            (0..20_000).map(|_| (DVec2::new(random.unit(), random.unit()) * size).as_vec2().as_dvec2()).collect();
        let (mut worst_px, mut lit) = (0.0f64, 0);
        for (&real_px, found) in places.iter().zip(led(&calibration, &places, false)) {
            let expected = optics.ideal_px(real_px);
            assert!(expected.is_some() == found.is_some() || !is_inner(optics, real_px), "{name}: {real_px}");
            let (Some(_), Some(found)) = (expected, found) else { continue };
            lit += 1;
            // Measured in the real image: where the place that was found belongs.
            if let Some(back_px) = optics.real_px(found) {
                worst_px = worst_px.max(back_px.distance(real_px));
            } else {
                assert!(!is_inner(optics, real_px), "{name}: {real_px} leads to {found}, which nothing shows");
            }
        }
        assert!(worst_px < BOUND_PX && lit > 18_000, "{name}: {worst_px} px, {lit} lit");

        // And back, from ideal places in and around the image.
        let ideal: Vec<DVec2> = places.iter().map(|at| (at * 1.4 - size * 0.2).as_vec2().as_dvec2()).collect();
        let (mut worst_back_px, mut shown, mut hidden) = (0.0f64, 0, 0);
        for (&ideal_px, found) in ideal.iter().zip(led(&calibration, &ideal, true)) {
            let expected = optics.real_px(ideal_px);
            match (expected, found) {
                (Some(expected), Some(found)) => {
                    shown += 1;
                    worst_back_px = worst_back_px.max(expected.distance(found));
                }
                (Some(at), None) | (None, Some(at)) => assert!(!is_inner(optics, at), "{name}: {ideal_px} at {at}"),
                (None, None) => hidden += 1,
            }
        }
        println!(
            "{name}: {worst_px:.5} px to the ideal image, {worst_back_px:.5} px back; {shown} shown, {hidden} hidden"
        );
        assert!(worst_back_px < BOUND_PX && shown > 5000, "{name}: {worst_back_px} px, {shown} shown");
    }
    assert_validation_is_silent();
}

/// Where `LANTERN_PICTURES` names a folder, what is looked at goes there.
fn keep(rig: &Rig, name: &str) {
    if let Some(folder) = std::env::var_os("LANTERN_PICTURES") {
        let pixels = rig.color(0).concat();
        let file = std::path::Path::new(&folder).join(format!("{}.png", name.replace(' ', "-")));
        image::RgbImage::from_raw(SIZE_PX.x, SIZE_PX.y, pixels).unwrap().save(file).unwrap();
    }
}

/// Every pixel of a projector behind a lens shows what f64's ray of its centre meets; a dark one shows nothing.
#[test]
fn every_pixel_shows_what_its_own_ray_meets() {
    let scene = still_life(&[]);
    for (name, lens) in lenses::all(SIZE_PX) {
        let calibration = behind(lens);
        let rig = Rig::shown(&scene, &[("left", calibration.clone())], ONE_SAMPLE, &[EYE_M]);
        keep(&rig, name);
        let layers = [Layer::Node, Layer::Distance, Layer::Depth].map(|of| rig.layer(0, of));
        let [node, distance, depth] = &layers;
        let (mut differs, mut off, mut dark) = (0, Vec::new(), 0);
        let edges = node.silhouettes(1);
        for (x, y) in (0..node.height).flat_map(|y| (0..node.width).map(move |x| (x, y))) {
            let at = y * node.width + x;
            let Some(ray) = rig.frusta[0].ray(DVec2::new(x as f64, y as f64) + 0.5) else {
                let layers = [node.values[at], distance.values[at], depth.values[at]];
                assert_eq!((layers, rig.color(0)[at]), ([-1.0, f32::INFINITY, 1.0], [0; 3]), "{name}: {x}, {y} is lit");
                dark += 1;
                continue;
            };
            let hit = scene.cast(ray.origin_m, ray.direction, 0.0, ray.t_max_m, lantern_scene::PRIMARY_ROLES);
            let expected = hit.map_or(-1.0, |hit| scene.instances[hit.instance].node as f32);
            if node.values[at] != expected {
                assert!(edges[at], "{name}: {x}, {y} shows {} and not {expected}", node.values[at]);
                differs += 1;
                continue;
            }
            let Some(hit) = hit.filter(|_| !edges[at]) else { continue };
            off.push((f64::from(distance.values[at]) / hit.t - 1.0).abs());
            // Window z of the point that was met under the projector's own matrix.
            let z = rig.frusta[0].project(ray.at(f64::from(distance.values[at]))).unwrap().window_z;
            assert!((f64::from(depth.values[at]) - z).abs() < 2e-6, "{name}: depth {} and {z}", depth.values[at]);
        }
        off.sort_by(f64::total_cmp);
        println!(
            "{name}: {} pixels, {differs} differ at edges, distances off by {:.1e} at most",
            off.len(),
            off[off.len() - 1]
        );
        assert!(percentile(&off, 0.999) < 1e-5 && differs < 200, "{name}: {differs}, {:e}", percentile(&off, 0.999));
        assert_eq!(dark > 0, name.contains("hole"), "{name}: {dark} dark pixels");
    }
    assert_validation_is_silent();
}

/// A scene wholly traced, and the same with some nodes rasterised, show the same, as without a lens.
#[test]
fn what_is_rasterised_is_warped_as_rays_are() {
    let layers = |scene: &Arc<Scene>, calibration: &Calibration, settings, picture: &str| {
        let rig = Rig::shown(scene, &[("left", calibration.clone())], settings, &[EYE_M]);
        keep(&rig, picture);
        [rig.layer(0, Layer::Node), rig.layer(0, Layer::Depth)]
    };
    for (name, lens) in lenses::all(SIZE_PX) {
        let calibration = behind(lens);
        for (samples, raster) in [(1, RasterOrder::Before), (1, RasterOrder::After), (4, RasterOrder::After)] {
            let settings = Settings { samples, raster, max_depth: 0, ..ONE_SAMPLE };
            let [node, depth] = layers(&still_life(&[]), &calibration, settings, &format!("{name} traced {samples}"));
            let hybrid = still_life(&["box", "within", "teapot"]);
            let [hybrid_node, hybrid_depth] =
                layers(&hybrid, &calibration, settings, &format!("{name} rasterised {samples}"));
            let silhouettes = node.silhouettes(1);
            let pixels = node.values.len();
            let differs: Vec<usize> = (0..pixels).filter(|&at| node.values[at] != hybrid_node.values[at]).collect();
            let agreement = 1.0 - differs.len() as f64 / pixels as f64;
            let inner = (0..pixels).filter(|&at| !silhouettes[at]);
            let close: Vec<bool> =
                inner.map(|at| (depth.values[at] - hybrid_depth.values[at]).abs() <= TWO_UNITS).collect();
            let close_share = close.iter().filter(|close| **close).count() as f64 / close.len() as f64;
            println!(
                "{name}, {samples} samples, {raster:?}: nodes agree on {:.4} %, depth within two units on {:.3} %",
                agreement * 100.0,
                close_share * 100.0
            );
            assert!(agreement >= 0.999, "{name}, {samples} samples, {raster:?}: {agreement}");
            assert!(differs.iter().all(|&at| silhouettes[at]), "{name}, {raster:?}: away from silhouettes");
            assert!(samples > 1 || close_share >= 0.99, "{name}, {raster:?}: {close_share}");
            for drawn in [2.0, 3.0, 4.0] {
                let share = |of: &FloatImage| of.values.iter().filter(|node| **node == drawn).count();
                assert!(share(&hybrid_node) > 300, "{name}: node {drawn} shows on {} pixels", share(&hybrid_node));
            }
        }
    }
    assert_validation_is_silent();
}

/// A pinhole's picture is the same to the bit, whatever stands before the projector beside it.
#[test]
fn a_lens_beside_a_pinhole_changes_nothing_of_its_rays() {
    let scene = still_life(&["box"]);
    let plain = stand(SIZE_PX).calibration();
    let beside = |lens: Option<Lens>| {
        let other = Stand::new(DVec3::new(-1.0, 1.7, 2.4), DVec3::new(0.0, 0.25, 0.0), SIZE_PX).calibration();
        let other = lens.map_or(other.clone(), |lens| other.with_lens(lens).unwrap());
        let rig = Rig::shown(&scene, &[("left", plain.clone()), ("right", other)], ONE_SAMPLE, &[EYE_M]);
        [Layer::Color, Layer::Radiance, Layer::Distance, Layer::Depth, Layer::Node].map(|of| rig.layer(0, of))
    };
    let without = beside(None);
    for (name, lens) in lenses::all(SIZE_PX) {
        assert!(beside(Some(lens)) == without, "{name}");
    }
    assert_validation_is_silent();
}

/// What the other projector is said to give at each of one's points, it gives: the weights of a point sum to one.
#[test]
fn weights_of_a_point_sum_to_one_behind_lenses() {
    let size_px = UVec2::new(320, 200);
    let scene = scene_of(json!([
        {"add": {"node": "floor", "uri": "lantern:quad", "scale": [4, 1, 4]}},
        {"environment": {"color": [0.4, 0.4, 0.4]}},
    ]));
    for (name, lens) in lenses::all(size_px) {
        let at = |x: f64, lens: Lens| {
            let target_m = DVec3::new(x * 0.35, 0.0, 0.0);
            let stand = Stand { fov_y_rad: 0.5, ..Stand::new(DVec3::new(x, 2.2, 1.6), target_m, size_px) };
            stand.calibration().with_lens(lens).unwrap()
        };
        let projectors = [("left", at(-1.2, lens)), ("right", at(1.0, lenses::barrel(size_px)))];
        let rig = Rig::shown(&scene, &projectors, Settings { blend: true, ..ONE_SAMPLE }, &[EYE_M]);
        let of = |p: usize| [Layer::Distance, Layer::Weight].map(|layer| rig.layer(p, layer));
        let all = [of(0), of(1)];
        let (mut off, mut smallest) = (Vec::new(), 1.0f32);
        for (mine, its) in [(0, 1), (1, 0)] {
            let [distance, weight] = &all[mine];
            let its_weight = &all[its][1];
            for (x, y) in (0..weight.height).flat_map(|y| (0..weight.width).map(move |x| (x, y))) {
                let distance_m = f64::from(distance.at(x, y)[0]);
                if !distance_m.is_finite() {
                    continue;
                }
                let ray = rig.frusta[mine].ray(DVec2::new(x as f64, y as f64) + 0.5).unwrap();
                let Some(there) = rig.frusta[its].project(ray.at(distance_m)) else { continue };
                let first = (there.place_px - 0.5).floor().as_ivec2();
                if first.x < 1 || first.y < 1 || first.x + 2 >= size_px.x as i32 || first.y + 2 >= size_px.y as i32 {
                    continue;
                }
                // Bilinear between the other's pixels, where these are all lit.
                let t = (there.place_px - 0.5 - first.as_dvec2()).as_vec2();
                let at = |dx: i32, dy: i32| its_weight.at((first.x + dx) as usize, (first.y + dy) as usize)[0];
                let four = [at(0, 0), at(1, 0), at(0, 1), at(1, 1)];
                if four.contains(&0.0) {
                    continue;
                }
                let top = four[0] + (four[1] - four[0]) * t.x;
                let bottom = four[2] + (four[3] - four[2]) * t.x;
                off.push(f64::from(weight.at(x, y)[0] + top + (bottom - top) * t.y - 1.0).abs());
                smallest = smallest.min(weight.at(x, y)[0]);
            }
        }
        off.sort_by(f64::total_cmp);
        let [middle, most] = [0.5, 0.95].map(|share| percentile(&off, share));
        println!("{name}: {} points, sums off by {middle:.1e} (median), {most:.1e} (95 %)", off.len());
        assert!(off.len() > 20_000 && smallest < 0.02, "{name}: {} {smallest}", off.len());
        assert!(middle < 1e-3 && most < 5e-3, "{name}: {middle} {most}");
    }
    assert_validation_is_silent();
}

/// MPCDI's formula, on what a projector would send without maps; and a projector with an alpha map shares its light with none.
#[test]
fn alpha_and_beta_do_what_mpcdi_says() {
    let size_px = UVec2::new(96, 64);
    let scene = scene_of(json!([
        {"add": {"node": "floor", "uri": "lantern:checker", "scale": [0.2, 1, 0.2]}},
        {"environment": {"color": [0.7, 0.5, 0.3]}},
    ]));
    let plain = stand(size_px).calibration();
    let ramp = |size: UVec2, low: Vec3, high: Vec3| {
        let value = |i: u32| low.lerp(high, (i % size.x) as f32 / (size.x - 1) as f32);
        Map { size, values: (0..size.x * size.y).map(value).collect() }
    };
    let alpha = ramp(UVec2::new(96, 64), Vec3::new(0.1, 0.2, 0.3), Vec3::new(1.0, 0.9, 0.8));
    let beta = ramp(UVec2::new(96, 1), Vec3::new(0.0, 0.1, 0.02), Vec3::new(0.05, 0.0, 0.2));
    let maps = Maps { alpha: Some(alpha.clone()), beta: Some(beta.clone()) };
    let mapped = plain.clone().with_maps(maps).unwrap();
    let shown = |calibration: &Calibration| {
        // Another projector stands where it does: without maps, each gives half.
        let projectors = [("left", calibration.clone()), ("twin", calibration.clone())];
        let mut rig = Rig::shown(&scene, &projectors, Settings { blend: true, ..ONE_SAMPLE }, &[EYE_M]);
        let layers = [Layer::Radiance, Layer::Weight, Layer::Color].map(|of| rig.layer(0, of));
        rig.renderer.set_pattern(0, Pattern::White).unwrap();
        rig.show(&[EYE_M]);
        assert!(rig.color(0).iter().all(|c| *c == [255; 3]), "patterns are shown as they are");
        layers
    };
    let [radiance, weight, _] = shown(&plain);
    let [mapped_radiance, mapped_weight, color] = shown(&mapped);
    assert_eq!(radiance, mapped_radiance, "the radiance is that before any response");
    let hit = |at: usize| weight.values[at] > 0.0;
    assert!((0..weight.values.len()).filter(|&at| hit(at)).all(|at| (weight.values[at] - 0.5).abs() < 1e-3));
    assert!((0..weight.values.len()).filter(|&at| hit(at)).all(|at| mapped_weight.values[at] == 1.0));
    for at in 0..weight.values.len() {
        for channel in 0..3 {
            let (a, b) = (alpha.values[at][channel], beta.values[at % 96][channel]);
            let sent = if hit(at) { radiance.values[at * 3 + channel] } else { 0.0 };
            let expected = sent * a * (1.0 - b) + b;
            let off = (color.values[at * 3 + channel] - expected).abs();
            assert!(off < 0.004, "pixel {at}: {} and {expected}", color.values[at * 3 + channel]);
        }
    }
    assert_validation_is_silent();
}
