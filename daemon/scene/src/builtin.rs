//! The shapes behind `lantern:` URIs.

use glam::{DVec2, DVec3};

use crate::asset::Asset;
use crate::material::Material;
use crate::mesh::{Mesh, MeshData};
use crate::structures::Structures;
use crate::teapot;

/// What starts the URI of a builtin.
pub(crate) const SCHEME: &str = "lantern:";

/// The names of the builtin shapes, without their scheme.
pub(crate) const SHAPES: [&str; 5] = ["sphere", "quad", "cube", "checker", "teapot"];

/// Rows of the sphere from pole to pole, and half its columns.
const SPHERE_ROWS: u32 = 72;
/// Squares along each side of the checker.
const CHECKER_SQUARES: u32 = 10;

/// The shape of a name out of [`SHAPES`].
///
/// `sphere`: radius 1 m, smooth. `quad`: 1 × 1 m in the plane y = 0, facing +Y. `cube`: sides of 1 m about the origin.
/// `checker`: a floor of 10 × 10 squares of 1 m, facing +Y. `teapot`: Newell's, 0.3 m high, standing on y = 0, in car
/// paint. All carry one white matte material of their own name, but the checker's `red` and `yellow` and the teapot's
/// `paint`.
pub(crate) fn shape(name: &str, structures: &Structures) -> Option<Asset> {
    let white = || vec![Material::matte(name, [1.0; 3])];
    let (data, materials) = match name {
        "sphere" => (sphere(), white()),
        "quad" => (quad(), white()),
        "cube" => (cube(), white()),
        "checker" => (checker(), checker_materials()),
        "teapot" => (teapot::tessellate(), vec![car_paint()]),
        _ => return None,
    };
    Some(Asset::single(name, Mesh::with(data, structures), materials))
}

/// Red and yellow as in the picture of Whitted's 1980 paper.
fn checker_materials() -> Vec<Material> {
    vec![Material::matte("red", [0.75, 0.03, 0.02]), Material::matte("yellow", [0.85, 0.62, 0.05])]
}

/// A deep red metallic base under a smooth clear coat.
fn car_paint() -> Material {
    let mut paint = Material::matte("paint", [0.42, 0.012, 0.02]);
    paint.gpu.metallic = 0.6;
    paint.gpu.roughness = 0.35;
    paint.gpu.clearcoat = 1.0;
    paint
}

/// Rows of latitude; the poles are single vertices a column, so that texture coordinates stay straight.
fn sphere() -> MeshData {
    let columns = 2 * SPHERE_ROWS;
    let mut data = MeshData::default();
    for row in 0..=SPHERE_ROWS {
        let v = f64::from(row) / f64::from(SPHERE_ROWS);
        for column in 0..=columns {
            let u = f64::from(column) / f64::from(columns);
            // The seam's two copies, and a pole's many, must fall on one point to the bit.
            let around =
                if row == 0 || row == SPHERE_ROWS { 0.0 } else { f64::from(column % columns) / f64::from(columns) };
            let (sin_phi, cos_phi) = (around * std::f64::consts::TAU).sin_cos();
            let (sin_theta, cos_theta) = (v * std::f64::consts::PI).sin_cos();
            let sin_theta = if row == SPHERE_ROWS { 0.0 } else { sin_theta };
            let point = DVec3::new(sin_theta * sin_phi, cos_theta, sin_theta * cos_phi);
            data.push_vertex(point, point, DVec2::new(u, v));
        }
    }
    for row in 0..SPHERE_ROWS {
        for column in 0..columns {
            let a = row * (columns + 1) + column;
            let (b, c, d) = (a + columns + 1, a + columns + 2, a + 1);
            if row + 1 < SPHERE_ROWS {
                data.push_triangle([a, b, c], 0);
            }
            if row > 0 {
                data.push_triangle([a, c, d], 0);
            }
        }
    }
    data
}

fn quad() -> MeshData {
    let mut data = MeshData::default();
    push_face(&mut data, DVec3::ZERO, DVec3::X, DVec3::NEG_Z, 0);
    data
}

fn cube() -> MeshData {
    let mut data = MeshData::default();
    for (right, up) in [
        (DVec3::X, DVec3::Y),
        (DVec3::NEG_X, DVec3::Y),
        (DVec3::Z, DVec3::Y),
        (DVec3::NEG_Z, DVec3::Y),
        (DVec3::X, DVec3::NEG_Z),
        (DVec3::X, DVec3::Z),
    ] {
        push_face(&mut data, right.cross(up) * 0.5, right, up, 0);
    }
    data
}

fn checker() -> MeshData {
    let mut data = MeshData::default();
    let at = |square: u32| f64::from(square) + 0.5 - f64::from(CHECKER_SQUARES) / 2.0;
    for row in 0..CHECKER_SQUARES {
        for column in 0..CHECKER_SQUARES {
            let centre = DVec3::new(at(column), 0.0, at(row));
            push_face(&mut data, centre, DVec3::X, DVec3::NEG_Z, (row + column) % 2);
        }
    }
    data
}

/// A 1 × 1 m square about `centre` that faces `right` × `up`.
fn push_face(data: &mut MeshData, centre: DVec3, right: DVec3, up: DVec3, material: u32) {
    let first = data.positions.len() as u32;
    for (x, y) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
        let point = centre + right * (x - 0.5) + up * (y - 0.5);
        data.push_vertex(point, right.cross(up), DVec2::new(x, 1.0 - y));
    }
    data.push_triangle([first, first + 1, first + 2], material);
    data.push_triangle([first, first + 2, first + 3], material);
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    /// Signed volume by the divergence theorem; positive where closed and outward.
    fn volume(mesh: &Mesh) -> f64 {
        (0..mesh.indices.len())
            .map(|t| {
                let [a, b, c] = mesh.corners(t);
                a.dot(b.cross(c)) / 6.0
            })
            .sum()
    }

    /// Whether every edge is met by its opposite, by position.
    fn is_closed(mesh: &Mesh) -> bool {
        let mut edges: HashMap<[[u32; 3]; 2], i32> = HashMap::new();
        let key = |vertex: u32| mesh.positions[vertex as usize].map(|x| (x + 0.0).to_bits());
        for [a, b, c] in &mesh.indices {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *edges.entry([key(*from), key(*to)]).or_default() += 1;
                *edges.entry([key(*to), key(*from)]).or_default() -= 1;
            }
        }
        edges.values().all(|&count| count == 0)
    }

    fn mesh(name: &str) -> Mesh {
        Mesh::clone(&shape(name, &Structures::default()).unwrap().meshes[0])
    }

    #[test]
    fn the_sphere_is_closed_outward_and_round() {
        let sphere = mesh("sphere");
        assert!(is_closed(&sphere));
        let full = 4.0 / 3.0 * std::f64::consts::PI;
        assert!((volume(&sphere) / full - 1.0).abs() < 2e-3);
        assert!((15_000..25_000).contains(&sphere.indices.len()));
        for (position, normal) in sphere.positions.iter().zip(&sphere.normals) {
            let (p, n) = (glam::Vec3::from(*position), glam::Vec3::from(*normal));
            assert!((p - n).length() < 1e-6 && (p.length() - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn the_cube_is_closed_and_holds_one_cubic_metre() {
        let cube = mesh("cube");
        assert!(is_closed(&cube));
        assert!((volume(&cube) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn floors_face_up_and_the_checker_alternates() {
        for name in ["quad", "checker"] {
            let floor = mesh(name);
            for t in 0..floor.indices.len() {
                let [a, b, c] = floor.corners(t);
                assert!((b - a).cross(c - a).y > 0.0);
            }
            assert!(floor.normals.iter().all(|n| *n == [0.0, 1.0, 0.0]));
        }
        let checker = mesh("checker");
        for (triangle, material) in checker.indices.iter().zip(&checker.materials) {
            let middle =
                triangle.map(|v| glam::Vec3::from(checker.positions[v as usize])).iter().sum::<glam::Vec3>() / 3.0;
            let parity = (middle.x.floor() as i32 + middle.z.floor() as i32).rem_euclid(2);
            assert_eq!(parity as u32, *material);
        }
        assert_eq!(checker.bounds_m, Some((DVec3::new(-5.0, 0.0, -5.0), DVec3::new(5.0, 0.0, 5.0))));
    }

    #[test]
    fn every_listed_shape_exists_with_sound_triangles() {
        for name in SHAPES {
            let asset = shape(name, &Structures::default()).unwrap();
            let mesh = &asset.meshes[0];
            let most = *mesh.used_materials.last().unwrap() as usize;
            assert!(most < asset.materials.len());
            for t in 0..mesh.indices.len() {
                let [a, b, c] = mesh.corners(t);
                assert!((b - a).cross(c - a).length() > 0.0, "{name}: triangle {t} is degenerate");
                let normal = mesh.indices[t]
                    .map(|v| glam::Vec3::from(mesh.normals[v as usize]).as_dvec3())
                    .iter()
                    .sum::<DVec3>();
                assert!((b - a).cross(c - a).dot(normal) > 0.0, "{name}: triangle {t} turns against its normals");
            }
        }
        assert!(shape("torus", &Structures::default()).is_none());
    }
}
