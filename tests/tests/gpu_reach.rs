//! What has moved is looked for wherever it can be seen, and wherever its shadow can fall: the conservative tests against points
//! that are tried one by one.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::time::Duration;

use glam::{DVec2, DVec3, UVec2};
use lantern_calibration::Frustum;
use lantern_gpu::{Binding, BindingKind, Bindings, Buffer, BufferKind, ComputePipeline, Recorder, Resource};
use lantern_render::ideal_tiles::IdealTiles;
use lantern_render::moved::{Box3, tiles_of};
use lantern_render::tile_lists::TILE_PX;
use lantern_tests::{
    gpu::{assert_validation_is_silent, device, shader},
    lenses,
    random::SplitMix64,
    stage::Stand,
};

const CASES: usize = 20_000;
/// What is padded on both sides of the renderer's tests, m; the cases below lie within 5 m of the origin.
const PAD_M: f64 = 1e-3;

/// Ways from a box to a place, or along a direction without end, and a box that may stand in them.
#[derive(Clone, Copy, Debug)]
struct Case {
    from: [DVec3; 2],
    target: DVec3,
    directional: bool,
    other: [DVec3; 2],
}

fn any_box(random: &mut SplitMix64, most_m: f64) -> [DVec3; 2] {
    let low = random.point(DVec3::splat(-2.0), DVec3::splat(2.0));
    // Now and then as flat as a floor.
    let mut size = random.point(DVec3::ZERO, DVec3::splat(most_m));
    if random.once_in(4) {
        size.y = 0.0;
    }
    [low, low + size]
}

impl Case {
    fn any(random: &mut SplitMix64) -> Self {
        let directional = random.once_in(3);
        let mut target = random.point(DVec3::splat(-2.0), DVec3::splat(2.0));
        if random.once_in(8) {
            target.x = 0.0;
        }
        let target = if directional { target.normalize() } else { target };
        Self { from: any_box(random, 0.2), target, directional, other: any_box(random, 1.5) }
    }

    /// Tries ways one by one.
    fn is_met(&self, random: &mut SplitMix64) -> bool {
        let end = if self.directional { 12.0 } else { 1.0 };
        (0..40).any(|_| {
            let from = random.point(self.from[0], self.from[1]);
            (0..=100).any(|i| {
                let s = end * f64::from(i) / 100.0;
                let at = if self.directional { from + self.target * s } else { from.lerp(self.target, s) };
                at.cmpge(self.other[0]).all() && at.cmple(self.other[1]).all()
            })
        })
    }

    /// The shader's arithmetic in f64, with both boxes grown by `pad_m`.
    fn reaches(&self, pad_m: f64) -> bool {
        let (mut first, mut last) = (0.0f64, if self.directional { f64::INFINITY } else { 1.0 });
        for axis in 0..3 {
            let from = [self.from[0][axis] - pad_m, self.from[1][axis] + pad_m];
            let other = [self.other[0][axis] - pad_m, self.other[1][axis] + pad_m];
            let along = |from: f64| if self.directional { self.target[axis] } else { self.target[axis] - from };
            for (a, b, c) in [(from[0], along(from[0]), other[1]), (-from[1], -along(from[1]), -other[0])] {
                match b.total_cmp(&0.0) {
                    _ if b == 0.0 => last = if a > c { -1.0 } else { last },
                    std::cmp::Ordering::Greater => last = last.min((c - a) / b),
                    _ => first = first.max((c - a) / b),
                }
            }
        }
        first <= last
    }

    fn words(&self) -> [f32; 20] {
        let [from, to] = self.from;
        let [low, high] = self.other;
        let rows = [from, to, self.target, low, high].map(|v| v.as_vec3().extend(0.0).to_array());
        let mut words: [f32; 20] = bytemuck::cast(rows);
        words[11] = if self.directional { 1.0 } else { 0.0 };
        words
    }
}

fn answers(cases: &[Case]) -> Vec<bool> {
    const fn row(binding: u32, name: &'static str, writes: bool) -> Binding {
        Binding { set: 0, binding, name, kind: BindingKind::StorageBuffer, reads: !writes, writes }
    }
    const TABLE: &[Binding] = &[row(0, "Cases", false), row(1, "Answers", true)];
    let device = device();
    let pipeline = ComputePipeline::new(device, shader("reach.comp", TABLE, 0), &[]).unwrap();
    let words: Vec<f32> = cases.iter().flat_map(Case::words).collect();
    let bytes = cases.len() as u64 * 4;
    let buffer = |name, kind, bytes| Buffer::new(device, name, kind, bytes).unwrap();
    let given = buffer("cases", BufferKind::Storage, bytes * 20);
    let found = buffer("answers", BufferKind::Storage, bytes);
    let back = buffer("back", BufferKind::Readback, bytes);
    let resources = [("Cases", Resource::Buffer(&given)), ("Answers", Resource::Buffer(&found))];
    let bindings = Bindings::new(&pipeline, &resources).unwrap();
    let mut recorder = Recorder::new(device, 0, "reach").unwrap();
    recorder.upload(&given, 0, bytemuck::cast_slice(&words)).unwrap();
    recorder.dispatch(&pipeline, &bindings, &[], [cases.len() as u32 / 64, 1, 1]).unwrap();
    recorder.copy_buffer(&found, 0, &back, 0, bytes).unwrap();
    device.submit(recorder.finish().unwrap(), &[]).unwrap().wait(Duration::from_secs(60)).unwrap();
    let words: Vec<u32> = bytemuck::pod_collect_to_vec(&back.read(0, bytes).unwrap());
    words.iter().map(|word| *word != 0).collect()
}

#[test]
fn no_shadow_is_missed() {
    let mut random = SplitMix64(1);
    let cases: Vec<Case> = (0..CASES / 64 * 64).map(|_| Case::any(&mut random)).collect();
    // The renderer gives grown boxes; so does this.
    let grown = |c: &Case| Case {
        from: [c.from[0] - PAD_M, c.from[1] + PAD_M],
        other: [c.other[0] - PAD_M, c.other[1] + PAD_M],
        ..*c
    };
    let answers = answers(&cases.iter().map(grown).collect::<Vec<_>>());
    let (mut met, mut spared, mut spared_by_all) = (0, 0, 0);
    for (case, answer) in cases.iter().zip(answers) {
        let is_met = case.is_met(&mut random);
        assert!(answer || !is_met, "missed: {case:?}");
        assert!(answer || !case.reaches(0.0), "missed, says f64: {case:?}");
        met += usize::from(is_met);
        spared += usize::from(!answer);
        spared_by_all += usize::from(!case.reaches(2.0 * PAD_M));
    }
    println!("{} cases: {met} met by trial, {spared} spared, {spared_by_all} spared in f64", cases.len());
    assert!(met > 300 && spared >= spared_by_all && spared > cases.len() / 2);
    assert_validation_is_silent();
}

#[test]
fn no_tile_is_missed() {
    let mut random = SplitMix64(2);
    let (mut inside, mut partly, mut none) = (0, 0, 0);
    for _ in 0..3000 {
        let size_px = UVec2::new(96 + random.below(100) as u32, 64 + random.below(50) as u32);
        let reach = DVec3::splat(3.0);
        let stand = Stand::new(random.point(-reach, reach), random.point(-reach, reach) / 2.0, size_px);
        let calibration = stand.calibration();
        // Dark on any side.
        let side = random.below(4);
        let far = size_px.as_dvec2() - 20.0;
        let dark = move |at: DVec2| [at.x < 20.0, at.y < 20.0, at.x > far.x, at.y > far.y][side];
        let calibration = match random.below(12) {
            0 => calibration.with_lens(lenses::barrel(size_px)).unwrap(),
            1 => calibration.with_lens(lenses::pincushion(size_px)).unwrap(),
            2 => calibration.with_lens(lenses::warp(size_px, UVec2::new(17, 11), dark)).unwrap(),
            _ => calibration,
        };
        let (ideal, frustum) = (IdealTiles::of(&calibration), Frustum::new(calibration));
        let [low_m, high_m] = any_box(&mut random, 0.6);
        let tiles = tiles_of(&frustum, ideal.as_ref(), Box3 { low_m, high_m });
        let image = [0, 0, size_px.x.div_ceil(TILE_PX) as i32, size_px.y.div_ceil(TILE_PX) as i32];
        partly += usize::from(tiles != [0; 4] && tiles != image);
        none += usize::from(tiles == [0; 4]);
        assert!(tiles[2] <= image[2] && tiles[3] <= image[3] && tiles.iter().all(|t| *t >= 0), "{tiles:?}");
        for _ in 0..40 {
            let Some(place) = frustum.project(random.point(low_m, high_m)) else { continue };
            let at = place.place_px;
            if at.min_element() < 0.0 || at.cmpge(size_px.as_dvec2()).any() {
                continue;
            }
            let tile = (at / f64::from(TILE_PX)).floor().as_ivec2();
            assert!(
                tile.x >= tiles[0] && tile.y >= tiles[1] && tile.x < tiles[2] && tile.y < tiles[3],
                "{at} is not in {tiles:?}: {stand:?}, {low_m} to {high_m}"
            );
            inside += 1;
        }
    }
    println!("{inside} points in view; {partly} boxes show in a part of the image, {none} nowhere");
    assert!(inside > 5000 && partly > 300 && none > 300);
}
