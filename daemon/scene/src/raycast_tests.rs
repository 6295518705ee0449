//! Rays against scenes, compared with every triangle tried one by one.

use glam::{DVec3, Vec3};
use proptest::prelude::*;
use serde_json::json;

use crate::environment::direction_at;
use crate::pack::{ROLE_MASK, ROLE_PROP, ROLE_VIRTUAL};
use crate::{Editor, Limits, PRIMARY_ROLES, SECONDARY_ROLES, Scene, role_bit};

fn scene(edits: serde_json::Value) -> std::sync::Arc<Scene> {
    Editor::new(Limits::default(), vec![]).apply(&serde_json::from_value::<Vec<_>>(edits).unwrap()).unwrap()
}

/// The closest t over all triangles in the world, by their planes and edge sides.
fn closest(scene: &Scene, origin: DVec3, direction: DVec3, roles: u32) -> Option<f64> {
    let mut best: Option<f64> = None;
    for placed in scene.world_meshes().filter(|placed| role_bit(placed.role) & roles != 0) {
        for triangle in 0..placed.mesh.indices.len() {
            let [a, b, c] = placed.mesh.corners(triangle).map(|p| placed.world_from_object.transform_point3(p));
            let normal = (b - a).cross(c - a);
            let t = (a - origin).dot(normal) / direction.dot(normal);
            let p = origin + direction * t;
            let inside =
                [(a, b), (b, c), (c, a)].iter().all(|(from, to)| (*to - *from).cross(p - *from).dot(normal) >= 0.0);
            if inside && t >= 0.0 && best.is_none_or(|best| t < best) {
                best = Some(t);
            }
        }
    }
    best
}

fn crowded() -> std::sync::Arc<Scene> {
    scene(json!([
        {"add": {"node": "pot", "uri": "lantern:teapot", "scale": [4, 4, 4], "rotation": [0, 0.6, 0, 0.8]}},
        {"add": {"node": "ball", "uri": "lantern:cube", "translation_m": [1.5, 0.5, 0], "scale": [-1, 0.2, 1], "role": "virtual"}},
        {"add": {"node": "floor", "uri": "lantern:checker", "translation_m": [0, -0.1, 0], "role": "mask"}},
        {"add": {"node": "unseen", "uri": "lantern:sphere", "role": "raster"}},
        {"add": {"node": "hidden", "uri": "lantern:sphere"}},
        {"set": {"node": "hidden", "visible": false}},
    ]))
}

#[test]
fn walking_the_structures_finds_what_trying_every_triangle_finds() {
    let scene = crowded();
    let mut hits = 0;
    for i in 0..300 {
        let golden = |k: f64| (f64::from(i) * k).fract();
        let origin = direction_at(golden(0.618_034), 0.1 + 0.5 * golden(0.324_718)) * 3.0;
        let toward = DVec3::new(golden(0.754_878) - 0.5, golden(0.569_84), golden(0.220_744) - 0.5) * 2.0;
        let direction = toward - origin;
        for roles in [PRIMARY_ROLES, SECONDARY_ROLES, ROLE_VIRTUAL] {
            let found = scene.cast(origin, direction, 0.0, f64::INFINITY, roles);
            let expected = closest(&scene, origin, direction, roles);
            match (found, expected) {
                (Some(found), Some(expected)) => {
                    assert!((found.t - expected).abs() < 1e-9, "ray {i}: {} for {expected}", found.t);
                    hits += 1;
                }
                (None, None) => {}
                other => panic!("ray {i}: {other:?}"),
            }
        }
    }
    assert!(hits > 300, "{hits}");
}

#[test]
fn normals_point_outward_even_where_a_node_mirrors() {
    let scene = crowded();
    // Down onto the mirrored, flattened cube: its top is the outside.
    let hit = scene.cast(DVec3::new(1.5, 5.0, 0.1), DVec3::NEG_Y, 0.0, 100.0, ROLE_VIRTUAL).unwrap();
    assert!((hit.t - 4.4).abs() < 1e-6);
    assert!((hit.geometric_normal - DVec3::Y).length() < 1e-9);
    let (normal, uv) = scene.shading_at(&hit);
    assert!((normal - DVec3::Y).length() < 1e-6);
    assert!(uv.min_element() >= 0.0 && uv.max_element() <= 1.0);
    assert_eq!(scene.nodes[hit.node].name, "ball");
}

#[test]
fn near_and_far_limits_and_roles_hold() {
    let scene = scene(json!([{"add": {"node": "ball", "uri": "lantern:sphere", "scale": [1e-4, 1e-4, 1e-4]}}]));
    let cast = |t_min, t_max, roles| scene.cast(DVec3::new(0.0, 0.0, 1.5e-4), DVec3::NEG_Z, t_min, t_max, roles);
    // Hits nearer than the 1e-4 that obvhs's own walker starts at.
    let first = cast(0.0, 1.0, ROLE_PROP).unwrap().t;
    assert!((first - 0.5e-4).abs() < 1e-7, "{first}");
    let second = cast(1e-4, 1.0, ROLE_PROP).unwrap().t;
    assert!((second - 2.5e-4).abs() < 1e-7, "{second}");
    assert!(cast(0.0, 0.4e-4, ROLE_PROP).is_none());
    assert!(cast(0.0, 1.0, ROLE_MASK).is_none());
}

proptest! {
    /// From the inside of the closed sphere every ray leaves through it once.
    #[test]
    fn a_closed_mesh_lets_no_ray_slip(u in 0f64..1.0, v in 0f64..1.0, from in prop::array::uniform3(-0.5f32..0.5)) {
        let scene = sphere();
        let origin = Vec3::from(from).as_dvec3();
        let hit = scene.cast(origin, direction_at(u, v), 0.0, f64::INFINITY, ROLE_PROP);
        let hit = hit.expect("a hit");
        prop_assert!(((origin + direction_at(u, v) * hit.t).length() - 1.0).abs() < 2e-3);
        prop_assert!(hit.geometric_normal.dot(direction_at(u, v)) > 0.0);
    }
}

fn sphere() -> &'static Scene {
    static SPHERE: std::sync::OnceLock<std::sync::Arc<Scene>> = std::sync::OnceLock::new();
    SPHERE.get_or_init(|| scene(json!([{"add": {"node": "ball", "uri": "lantern:sphere"}}])))
}
