//! Reads .gltf and .glb (glTF 2.0) into an [`Asset`].
//!
//! The JSON is parsed by the crate `gltf`, whose own readers trust the file: they index, unwrap and add without looking.
//! So only its types are used here, and every index, offset, count and value is checked by this module before it is
//! followed. Nothing is allocated before the bound that it falls under was checked.

mod accessor;
mod container;
mod error;
mod images;
mod lights;
mod materials;
mod nodes;
mod primitive;
mod source;
mod warnings;

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use crate::asset::{Asset, Part, Vertices};
use crate::file::{self, Access};
use crate::limits::Limits;
use crate::mesh::{Mesh, MeshData};
use crate::structures::Structures;

use accessor::Reader;
pub(crate) use error::GltfError;
use error::{Located, Problem, here};
use images::Images;
use materials::Materials;
use source::Sources;
use warnings::Warnings;

/// Loads a file with the buffers and images that it names.
///
/// # Errors
/// Says the file, the object in it ("mesh 2 primitive 0", "accessor 3"), the cause and, after `hint:`, the remedy.
pub(crate) fn load(
    path: &Path,
    access: Access<'_>,
    limits: &Limits,
    structures: &Structures,
) -> Result<Asset, GltfError> {
    load_located(path, access, limits, structures).map_err(|located| located.in_file(path))
}

fn load_located(path: &Path, access: Access<'_>, limits: &Limits, structures: &Structures) -> Result<Asset, Located> {
    let bytes = file::read(path, access, limits.max_file_bytes).map_err(|error| here("file", Problem::Read(error)))?;
    let parts = container::split(&bytes)?;
    let root = container::parse(parts.json)?;
    let mut warnings = Warnings::default();
    container::check_extensions(&root, &mut warnings)?;

    let mut sources = Sources::new(path, access, limits, bytes.len() as u64);
    let buffers = sources.buffers(&root, parts.bin)?;
    let reader = Reader { root: &root, buffers: &buffers, limits };
    let visits = nodes::walk(&root, limits, &mut warnings)?;

    // Meshes that no node shows are not built; one that several show is built once.
    let mut materials = Materials::new(&root);
    let (mut meshes, mut vertices): (Vec<Arc<Mesh>>, Vec<Vertices>) = (vec![], vec![]);
    let mut numbers: HashMap<usize, usize> = HashMap::new();
    let mut triangles = 0;
    let mut placed = vec![];
    for visit in &visits {
        let Some(index) = visit.mesh else { continue };
        let number = match numbers.get(&index) {
            Some(&number) => number,
            None => {
                let (data, of_file) = mesh(&reader, index, &mut triangles, &mut materials, &mut warnings)?;
                vertices.push(of_file);
                meshes.push(Arc::new(Mesh::with(data, structures)));
                numbers.insert(index, meshes.len() - 1);
                meshes.len() - 1
            }
        };
        placed.push(Part { mesh: number, asset_from_object: visit.asset_from_node, role: visit.role });
    }
    if triangles == 0 {
        warnings.add("it has no triangles in its scene, so it shows nothing");
    }

    let lights = lights::place(&root, &visits, limits)?;
    let mut images = Images::new(&reader, &mut sources, limits);
    let (materials, textures) = materials.load(&mut images, &mut warnings)?;
    let warnings = warnings.finish(path);
    Ok(Asset { meshes, vertices, parts: placed, materials, textures, lights, warnings })
}

/// All primitives of a mesh as one.
fn mesh(
    reader: &Reader<'_>,
    index: usize,
    triangles: &mut usize,
    materials: &mut Materials<'_>,
    warnings: &mut Warnings,
) -> Result<(MeshData, Vertices), Located> {
    let (mut whole, mut vertices) = (MeshData::default(), Vertices { mesh: index as u32, ..Vertices::default() });
    vertices.name.clone_from(&reader.root.meshes[index].name);
    for (number, json) in reader.root.meshes[index].primitives.iter().enumerate() {
        let object = format!("mesh {index} primitive {number}");
        let material = materials.number_of(json.material, &object)?;
        let Some(read) = primitive::read(reader, json, material, &object, warnings)? else { continue };
        *triangles += read.data.indices.len();
        let limit = reader.limits.max_triangles;
        if *triangles > limit {
            let (count, limit) = (*triangles as u64, limit as u64);
            let (what, key) = ("triangles so far", "what limits.max_triangles leaves");
            return Err(here(object, Problem::TooMany { what, count, limit, key }));
        }
        let before = vertices.count as u32;
        vertices.count += read.count;
        vertices.of_file.extend(read.of_file.iter().map(|vertex| vertex + before));
        vertices.has_normal.resize(vertices.of_file.len(), read.has_normals);
        whole.append(read.data);
    }
    Ok((whole, vertices))
}

#[cfg(test)]
mod hostile_tests;
#[cfg(test)]
pub(crate) mod sample;
#[cfg(test)]
mod tests;
