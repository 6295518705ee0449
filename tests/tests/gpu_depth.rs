//! The depth attachment against a rasterised one: the same triangles by the same matrix, drawn by the device's own
//! rasteriser, which knows nothing of us.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{sync::Arc, time::Duration};

use glam::{DVec3, UVec2};
use lantern_calibration::{Calibration, Convention, Matrix4};
use lantern_gpu::{
    Binding, BindingKind, Bindings, Buffer, BufferKind, DepthTest, GraphicsDesc, GraphicsPipeline, Image, ImageFormat,
    ImageUsage, Load, Recorder, Resource,
};
use lantern_render::Layer;
use lantern_scene::Scene;
use lantern_tests::{
    gpu::{ONE_SAMPLE, Rig, assert_validation_is_silent, device, shader},
    image::{FloatImage, percentile},
    oracle::{self, World},
    stage::{Stand, editor_of, scene_of, shared_data},
};
use serde_json::json;

const SIZE_PX: UVec2 = UVec2::new(320, 200);
/// One unit of a depth buffer of 24 bits.
const UNIT: f64 = 1.0 / 16_777_216.0;

const CORNERS: &[Binding] =
    &[Binding { set: 0, binding: 0, name: "Corners", kind: BindingKind::StorageBuffer, reads: true, writes: false }];

/// Every triangle's corners with their node, those that turn away from `from_m` first: of convex things that do not hide
/// each other this is painter's order, so that a reversed depth needs no other test than `Always`.
fn corners(scene: &Scene, from_m: DVec3) -> Vec<[f32; 4]> {
    let mut turned_away = Vec::new();
    let mut turned_here = Vec::new();
    for placed in scene.world_meshes() {
        for triangle in 0..placed.mesh.indices.len() {
            let [a, b, c] = placed.mesh.corners(triangle).map(|at| placed.world_from_object.transform_point3(at));
            let here = (b - a).cross(c - a).dot(from_m - a) > 0.0;
            let list = if here { &mut turned_here } else { &mut turned_away };
            list.extend([a, b, c].map(|at| at.as_vec3().extend(placed.node as f32).to_array()));
        }
    }
    turned_away.extend(turned_here);
    turned_away
}

/// Depth and node of the scene's triangles as the device's rasteriser draws them.
fn rasterise(scene: &Scene, calibration: &Calibration, from_m: DVec3, test: DepthTest) -> (FloatImage, FloatImage) {
    let device = device();
    let desc = GraphicsDesc {
        name: "plain",
        vertex: shader("plain.vert", CORNERS, 64),
        fragment: shader("plain.frag", &[], 0),
        constants: &[],
        colors: &[ImageFormat::R32Float],
        depth: Some(ImageFormat::Depth32),
        depth_test: test,
    };
    let pipeline = GraphicsPipeline::new(device, &desc).unwrap();
    let corners = corners(scene, from_m);
    let bytes: &[u8] = bytemuck::cast_slice(&corners);
    let buffer = Buffer::new(device, "corners", BufferKind::Storage, bytes.len() as u64).unwrap();
    let bindings = Bindings::new(&pipeline, &[("Corners", Resource::Buffer(&buffer))]).unwrap();

    let size_px = calibration.resolution_px();
    let image = |name, format, usage| {
        Image::new(device, name, size_px.x, size_px.y, format, usage | ImageUsage::TRANSFER).unwrap()
    };
    let node = image("plain node", ImageFormat::R32Float, ImageUsage::COLOR);
    let depth = image("plain depth", ImageFormat::Depth32, ImageUsage::DEPTH);
    let back = [&node, &depth].map(|of| Buffer::new(device, "back", BufferKind::Readback, of.bytes()).unwrap());
    let clip_from_world = calibration.vulkan_clip_from_world().as_mat4().to_cols_array();
    let mut recorder = Recorder::new(device, 0, "plain").unwrap();
    recorder.upload(&buffer, 0, bytes).unwrap();
    let colors = [(&node, Load::Clear([-1.0; 4]))];
    recorder
        .render("plain", &colors, Some((&depth, Load::Clear([1.0; 4]))), &[&bindings], |draws| {
            draws.draw(&pipeline, &bindings, bytemuck::cast_slice(&clip_from_world), corners.len() as u32, 1)
        })
        .unwrap();
    recorder.copy_image_to_buffer(&node, &back[0]).unwrap();
    recorder.copy_image_to_buffer(&depth, &back[1]).unwrap();
    device.submit(recorder.finish().unwrap(), &[]).unwrap().wait(Duration::from_secs(60)).unwrap();
    let [node, depth] = back.map(|of| {
        let values = bytemuck::pod_collect_to_vec(&of.read(0, of.bytes()).unwrap());
        FloatImage { width: size_px.x as usize, height: size_px.y as usize, channels: 1, values }
    });
    (depth, node)
}

/// The same matrix with near and far exchanged in depth.
fn reversed(convention: Convention, [x, y, z, w]: Matrix4) -> Matrix4 {
    let turn = |i: usize| match convention {
        Convention::OpenGl => -z[i],
        Convention::Vulkan => w[i] - z[i],
    };
    [x, y, std::array::from_fn(turn), w]
}

/// Compares depth with the rasteriser's, and both with the oracle's: the rasteriser's own z, out of a product and an
/// interpolation in f32, is up to four units from the truth, and there nobody can be asked to agree with it.
fn compare(what: &str, scene: &Arc<Scene>, stand: Stand, reverse: bool) {
    let projection = if reverse { reversed(stand.convention, stand.projection()) } else { stand.projection() };
    let calibration =
        Calibration::from_matrices(&projection, &stand.view(), stand.convention, stand.resolution_px).unwrap();
    let rig = Rig::shown(scene, &[("left", calibration.clone())], ONE_SAMPLE, &[DVec3::Y]);
    assert_eq!(rig.frusta[0].is_reversed(), reverse);
    let (traced, traced_node) = (rig.layer(0, Layer::Depth), rig.layer(0, Layer::Node));
    let test = if reverse { DepthTest::Always } else { DepthTest::Less };
    let (depth, node) = rasterise(scene, &calibration, stand.position_m, test);
    let settings = oracle::Settings::new("left", 1, 0, DVec3::Y);
    let truth = oracle::render(&World::new(scene), &rig.frusta[0], &settings, 1);

    // Silhouettes: another node beside the pixel, or another part of the same one.
    let jumps = rig.layer(0, Layer::Distance).jumps(1, 0.05);
    let edges: Vec<bool> = node.silhouettes(1).into_iter().zip(jumps).map(|(a, b)| a || b).collect();
    assert!(edges.iter().filter(|edge| **edge).count() * 10 < edges.len(), "{what}: edges are few");
    let (mut off, mut ours, mut its) = (Vec::new(), Vec::new(), Vec::new());
    for at in (0..edges.len()).filter(|&at| !edges[at]) {
        assert_eq!(traced_node.values[at], node.values[at], "{what}: coverage differs away from edges");
        let [traced, rasterised] = [&traced, &depth].map(|of| f64::from(of.values[at]));
        if node.values[at] < 0.0 {
            assert_eq!(traced, 1.0, "{what}: a miss is at depth 1");
            continue;
        }
        off.push((traced - rasterised).abs() / UNIT);
        ours.push((traced - truth.pixels[at].depth).abs() / UNIT);
        its.push((rasterised - truth.pixels[at].depth).abs() / UNIT);
    }
    for list in [&mut off, &mut ours, &mut its] {
        list.sort_by(f64::total_cmp);
    }
    let table = |list: &[f64]| [0.5, 0.99, 1.0].map(|share| percentile(list, share));
    println!(
        "{what}, {} px, units of 2^-24 at 50, 99 and 100 %: off {:.2?}; from the truth, traced {:.2?}, rasterised {:.2?}",
        off.len(),
        table(&off),
        table(&ours),
        table(&its),
    );
    assert!(off.len() * 8 > edges.len(), "{what}: only {} pixels see anything", off.len());

    // The hundredth pixel may see a triangle almost edge-on, whose depth changes by many units within the thousandth of a
    // pixel that f32 leaves.
    assert!(percentile(&ours, 0.99) <= 1.0, "{what}: {} units from the truth", percentile(&ours, 0.99));
    assert!(percentile(&off, 0.99) <= 2.0, "{what}: {} units from what was rasterised", percentile(&off, 0.99));
    assert!(percentile(&off, 1.0) <= 8.0, "{what}: {:?}", table(&off));
    let beyond = off.iter().filter(|units| **units > 2.0).count();
    let its_fault = its.iter().filter(|units| **units > 1.0).count();
    assert!(beyond <= its_fault, "{what}: {beyond} pixels are off, of which the rasteriser owes only {its_fault}");
    println!("{what}: {:.3} % of the pixels within two units", 100.0 - 100.0 * beyond as f64 / off.len() as f64);
}

#[test]
fn depth_is_what_a_rasteriser_writes() {
    let scene = scene_of(json!([
        {"add": {"node": "floor", "uri": "lantern:quad", "scale": [4, 1, 4]}},
        {"add": {"node": "ball", "uri": "lantern:sphere", "translation_m": [-0.5, 0.4, 0], "scale": [0.4, 0.4, 0.4]}},
        {"add": {"node": "box", "uri": "lantern:cube", "translation_m": [0.7, 0.3, 0.2], "scale": [0.6, 0.6, 0.6]}},
    ]));
    for convention in [Convention::OpenGl, Convention::Vulkan] {
        let stand = Stand { convention, ..Stand::new(DVec3::new(0.4, 1.7, 2.6), DVec3::new(0.0, 0.2, 0.0), SIZE_PX) };
        for reverse in [false, true] {
            compare(&format!("{convention:?}, reversed {reverse}"), &scene, stand, reverse);
        }
    }
    assert_validation_is_silent();
}

#[test]
fn depth_of_the_bunny_is_what_a_rasteriser_writes() {
    let Some(data) = shared_data("the bunny's depth") else { return };
    let edits = json!([{"add": {"node": "bunny", "uri": "models/stanford-bunny.glb", "translation_m": [0.1, 0, 0.2]}}]);
    let scene = editor_of(edits, vec![data]).current();
    for convention in [Convention::OpenGl, Convention::Vulkan] {
        let stand = Stand {
            convention,
            fov_y_rad: 0.45,
            ..Stand::new(DVec3::new(0.5, 0.6, 0.9), DVec3::new(0.1, 0.15, 0.2), SIZE_PX)
        };
        compare(&format!("bunny, {convention:?}"), &scene, stand, false);
    }
    assert_validation_is_silent();
}
