//! One primitive: triangles of one material.

use std::collections::HashMap;

use glam::Vec3;
use gltf::json::accessor::Type;
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;

use super::accessor::Reader;
use super::error::{Located, Problem, bad, here};
use super::warnings::Warnings;
use crate::mesh::{MAX_COORDINATE_M, MeshData};

/// The triangles of a primitive.
pub(super) struct Triangles {
    pub(super) data: MeshData,
    /// The file's number of each vertex, within the primitive.
    pub(super) of_file: Vec<u32>,
    /// How many vertices the file has for it.
    pub(super) count: usize,
    /// Whether the file says its normals.
    pub(super) has_normals: bool,
}

/// Reads a primitive; `None` where it has no triangles.
pub(super) fn read(
    reader: &Reader<'_>,
    json: &Primitive,
    material: u32,
    object: &str,
    warnings: &mut Warnings,
) -> Result<Option<Triangles>, Located> {
    let Checked::Valid(mode) = json.mode else {
        return Err(bad(object, "has a mode that glTF does not know"));
    };
    if matches!(mode, Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
        warnings.add("points and lines are ignored; only triangles are shown");
        return Ok(None);
    }
    let attribute = |semantic| json.attributes.get(&Checked::Valid(semantic)).copied();
    let Some(position) = attribute(Semantic::Positions) else {
        warnings.add("a primitive without positions is ignored");
        return Ok(None);
    };
    warn_of_ignored(json, warnings);

    let positions: Vec<[f32; 3]> = reader.vectors(position, Type::Vec3, object)?;
    check_positions(&positions, object, position.value())?;
    check_declared(reader, position, &positions, object, warnings)?;
    let per_vertex = |count: usize, what: &str| {
        if count == positions.len() {
            return Ok(());
        }
        Err(bad(object, format!("has {count} {what} for {} positions", positions.len())))
    };
    let normals = match attribute(Semantic::Normals) {
        None => None,
        Some(accessor) => {
            let normals: Vec<[f32; 3]> = reader.vectors(accessor, Type::Vec3, object)?;
            per_vertex(normals.len(), "normals")?;
            check_finite("normal", &normals, object, accessor.value())?;
            Some(normals)
        }
    };
    let uvs = match attribute(Semantic::TexCoords(0)) {
        None => vec![[0.0; 2]; positions.len()],
        Some(accessor) => {
            let uvs: Vec<[f32; 2]> = reader.vectors(accessor, Type::Vec2, object)?;
            per_vertex(uvs.len(), "texture coordinates")?;
            check_finite("texture coordinate", &uvs, object, accessor.value())?;
            uvs
        }
    };

    let numbers = match json.indices {
        Some(accessor) => reader.indices(accessor, object)?,
        None => (0..positions.len() as u32).collect(),
    };
    if let Some(index) = numbers.iter().position(|&vertex| vertex as usize >= positions.len()) {
        let (vertex, count) = (numbers[index], positions.len());
        return Err(here(object, Problem::Vertex { index, vertex, count }));
    }
    let triangles = triangles(mode, &numbers, object)?;
    let (data, of_file) = gather(&positions, normals.as_deref(), &uvs, &triangles, material);
    Ok(Some(Triangles { data, of_file, count: positions.len(), has_normals: normals.is_some() }))
}

fn warn_of_ignored(json: &Primitive, warnings: &mut Warnings) {
    for semantic in json.attributes.keys() {
        match semantic {
            Checked::Valid(Semantic::Colors(_)) => warnings.add("vertex colours are ignored"),
            Checked::Valid(Semantic::TexCoords(set)) if *set > 0 => {
                warnings.add(format!("texture coordinates TEXCOORD_{set} are ignored; TEXCOORD_0 alone is read"));
            }
            _ => {}
        }
    }
    if json.targets.as_ref().is_some_and(|targets| !targets.is_empty()) {
        warnings.add("morph targets are ignored");
    }
}

fn check_positions(positions: &[[f32; 3]], object: &str, accessor: usize) -> Result<(), Located> {
    // A NaN compares false and so is caught as well.
    match positions.iter().position(|p| !p.iter().all(|x| x.abs() <= MAX_COORDINATE_M)) {
        None => Ok(()),
        Some(index) => Err(not_finite("vertex", index, &positions[index], object, accessor)),
    }
}

fn check_finite<const N: usize>(
    what: &'static str,
    values: &[[f32; N]],
    object: &str,
    accessor: usize,
) -> Result<(), Located> {
    match values.iter().position(|v| !v.iter().all(|x| x.is_finite())) {
        None => Ok(()),
        Some(index) => Err(not_finite(what, index, &values[index], object, accessor)),
    }
}

fn not_finite(what: &'static str, index: usize, value: &[f32], object: &str, accessor: usize) -> Located {
    here(format!("{object}, accessor {accessor}"), Problem::NotFinite { what, index, value: value.to_vec() })
}

/// A position outside the bounds that its accessor declares betrays a damaged file, or an exporter that others will
/// cull wrongly by. Bounds that are too wide do no harm.
fn check_declared(
    reader: &Reader<'_>,
    accessor: gltf::json::Index<gltf::json::Accessor>,
    positions: &[[f32; 3]],
    object: &str,
    warnings: &mut Warnings,
) -> Result<(), Located> {
    let Some([min, max]) = reader.declared_bounds(accessor) else {
        warnings.add("positions do not declare their bounds, as glTF asks");
        return Ok(());
    };
    // Exporters round: a thousandth of the extent is let pass.
    let extent = (0..3).map(|axis| max[axis] - min[axis]).fold(0.0, f64::max);
    let slack = extent * 1e-3 + 1e-6;
    let outside = |p: &[f32; 3]| {
        (0..3).any(|axis| {
            let x = f64::from(p[axis]);
            !(x >= min[axis] - slack && x <= max[axis] + slack)
        })
    };
    match positions.iter().position(outside) {
        None => Ok(()),
        Some(index) => {
            let cause =
                format!("vertex {index} at {:?} leaves the declared bounds {min:?} to {max:?}", positions[index]);
            Err(bad(format!("{object}, accessor {}", accessor.value()), cause))
        }
    }
}

/// Triangles of a list, strip or fan (glTF 2.0, section 3.7.2.1).
fn triangles(mode: Mode, numbers: &[u32], object: &str) -> Result<Vec<[u32; 3]>, Located> {
    Ok(match mode {
        Mode::TriangleStrip => {
            let windows = numbers.windows(3).enumerate();
            windows.map(|(i, w)| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] }).collect()
        }
        Mode::TriangleFan => match numbers {
            [centre, rest @ ..] => rest.windows(2).map(|w| [w[0], w[1], *centre]).collect(),
            [] => vec![],
        },
        _ => {
            if !numbers.len().is_multiple_of(3) {
                return Err(bad(object, format!("has {} corners, which is no multiple of three", numbers.len())));
            }
            numbers.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect()
        }
    })
}

/// Keeps the vertices that triangles use: primitives often share one long list. Without normals each triangle gets
/// corners of its own, so that it shows flat, as glTF says. Gives the file's number of each kept vertex as well.
fn gather(
    positions: &[[f32; 3]],
    normals: Option<&[[f32; 3]]>,
    uvs: &[[f32; 2]],
    triangles: &[[u32; 3]],
    material: u32,
) -> (MeshData, Vec<u32>) {
    let mut of_file = vec![];
    let mut data = MeshData { materials: vec![material; triangles.len()], ..MeshData::default() };
    let mut kept: HashMap<u32, u32> = HashMap::new();
    for triangle in triangles {
        let corner = |vertex: u32| Vec3::from(positions[vertex as usize]);
        let [a, b, c] = triangle.map(corner);
        let flat = (b - a).as_dvec3().cross((c - a).as_dvec3()).normalize_or_zero().as_vec3().to_array();
        let indices = triangle.map(|vertex| {
            let fresh = data.positions.len() as u32;
            let number = if normals.is_some() { *kept.entry(vertex).or_insert(fresh) } else { fresh };
            if number == fresh {
                of_file.push(vertex);
                data.positions.push(positions[vertex as usize]);
                data.normals.push(normals.map_or(flat, |normals| normals[vertex as usize]));
                data.uvs.push(uvs[vertex as usize]);
            }
            number
        });
        data.indices.push(indices);
    }
    (data, of_file)
}
