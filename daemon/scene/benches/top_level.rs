//! What it costs to move many nodes every frame: `cargo bench -p lantern-scene`. Times are printed, never asserted.
#![expect(clippy::unwrap_used, reason = "a bench that cannot make its scene has nothing to time")]

use std::time::Instant;

use glam::{DQuat, DVec3, Vec3A};
use lantern_scene::bvh::Bvh;
use lantern_scene::{Edit, Editor, Limits, Place};
use obvhs::aabb::Aabb;
use serde_json::json;

/// Frames of each case, of which the median is told.
const FRAMES: usize = 101;

/// Somewhere in a room for an object of a number, another place each frame.
fn place_m(object: usize, frame: usize) -> DVec3 {
    let t = frame as f64 * 0.01;
    let i = object as f64;
    DVec3::new((i * 0.37 + t).sin() * 5.0, (i * 0.11).cos() * 2.0, (i * 0.73 - t).cos() * 5.0)
}

fn median_ms(mut of_frame: impl FnMut(usize)) -> f64 {
    let mut times: Vec<f64> = (0..FRAMES)
        .map(|frame| {
            let begun = Instant::now();
            of_frame(frame);
            begun.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[FRAMES / 2]
}

fn main() {
    println!("nodes moved every frame, median of {FRAMES} frames, one thread");
    for count in [1, 10, 100, 1000, 10_000] {
        let names: Vec<String> = (0..count).map(|i| format!("node {i}")).collect();
        let add = |name: &String| json!({"add": {"node": name, "uri": "lantern:cube", "scale": [0.1, 0.1, 0.1]}});
        let adds: Vec<Edit> = names.iter().map(|name| serde_json::from_value(add(name)).unwrap()).collect();
        let mut editor = Editor::new(Limits::default(), vec![]);
        editor.apply(&adds).unwrap();
        let whole_ms = median_ms(|frame| {
            let place = |(i, node): (usize, &'_ String)| (node.clone(), place_m(i, frame));
            let places: Vec<(String, DVec3)> = names.iter().enumerate().map(place).collect();
            let places: Vec<Place<'_>> = (places.iter())
                .map(|(node, at)| Place { node, translation_m: *at, rotation: DQuat::from_rotation_y(at.x) })
                .collect();
            editor.place_all(&places);
        });

        let boxes = |frame: usize| -> Vec<Aabb> {
            let centre = |i: usize| Vec3A::from(place_m(i, frame).as_vec3());
            (0..count).map(|i| Aabb::new(centre(i) - 0.08, centre(i) + 0.08)).collect()
        };
        let boxes: Vec<_> = (0..FRAMES).map(boxes).collect();
        let [best_ms, top_ms] = [Bvh::build, Bvh::build_top].map(|build| median_ms(|frame| drop(build(&boxes[frame]))));
        let cost = Bvh::build_top(&boxes[0]).cost() / Bvh::build(&boxes[0]).cost();
        println!(
            "{count:6}: {whole_ms:8.3} ms in all; the structure {top_ms:8.3} ms, {best_ms:8.3} ms at its best; \
             its cost {cost:.3} of the best's"
        );
    }
}
