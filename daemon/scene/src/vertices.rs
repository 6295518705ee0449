//! Meshes that a node has in a shape of its own: the `vertices` edit.

use std::sync::Arc;

use lantern_proto as proto;
use lantern_proto::MeshRef;

use crate::asset::Asset;
use crate::edit::{Fault, bad_value, nearest};
use crate::limits::Limits;
use crate::mesh::MAX_COORDINATE_M;
use crate::scene::{Node, Scene, Shape};
use crate::totals::Totals;

/// Gives a mesh of a node new positions; other nodes that show the same file keep its shape. What is asked for twice is made
/// once: `prepared` is a scene in which it may be there already.
pub(crate) fn apply_vertices(
    draft: &mut Scene,
    totals: &mut Totals,
    edit: &proto::Vertices,
    limits: &Limits,
    prepared: Option<&Scene>,
) -> Result<(), Fault> {
    let known = draft.node(&edit.node);
    let Some((index, node)) = known else {
        let known = nearest(&edit.node, draft.nodes.iter().map(|node| node.name.as_str()));
        return Err(Fault::new("unknown-node", "node", format!("there is no node {:?}; hint: {known}", edit.node)));
    };
    let mesh = mesh_of(&node.asset, edit)?;
    let of_file = &node.asset.meshes[mesh];
    let placed = &node.asset.vertices[mesh];
    let positions_m = &edit.positions_m;
    if positions_m.len() != placed.count {
        let (given, count) = (positions_m.len(), placed.count);
        let cause = format_args!("has {given} positions for {count} vertices");
        return Err(bad_value(
            "positions_m",
            cause,
            "one for each vertex of the mesh's triangles, as the file has them",
        ));
    }
    // A NaN compares false and so is caught as well.
    let is_place = |p: &[f32; 3]| p.iter().all(|x| x.abs() <= MAX_COORDINATE_M);
    if let Some(bad) = positions_m.iter().position(|p| !is_place(p)) {
        let cause = format_args!("has {:?} at {bad}, which is not finite or beyond 1e9 m", positions_m[bad]);
        return Err(bad_value("positions_m", cause, "three finite numbers a vertex, metres"));
    }

    let positions: Vec<[f32; 3]> = placed.of_file.iter().map(|&vertex| positions_m[vertex as usize]).collect();
    let had = node.shapes.get(&mesh).cloned();
    let made = |node: &Node| node.shapes.get(&mesh).filter(|shape| shape.positions_m == *positions_m).cloned();
    let elsewhere = prepared.and_then(|scene| scene.node(&edit.node)).map(|(_, other)| other);
    let elsewhere = elsewhere.filter(|other| Arc::ptr_eq(&other.asset, &node.asset));
    let shape = if positions == of_file.positions {
        None
    } else if let Some(shape) = made(node).or_else(|| elsewhere.and_then(made)) {
        Some(shape)
    } else {
        if had.is_none() {
            totals.check_triangles("positions_m", of_file.indices.len(), limits)?;
        }
        let mesh = Arc::new(of_file.moved(positions, &placed.has_normal));
        Some(Arc::new(Shape { positions_m: positions_m.clone(), mesh }))
    };

    let node = &mut draft.nodes[index];
    totals.remove(node);
    match shape {
        Some(shape) => node.shapes.insert(mesh, shape),
        None => node.shapes.remove(&mesh),
    };
    totals.add(node);
    Ok(())
}

/// The number in the asset of the mesh that an edit names by its place in the file or by its name there.
fn mesh_of(asset: &Asset, edit: &proto::Vertices) -> Result<usize, Fault> {
    let is_meant = |known: &&crate::asset::Vertices| match &edit.mesh {
        MeshRef::Index(index) => known.mesh == *index,
        MeshRef::Name(name) => known.name.as_ref() == Some(name),
    };
    let mut found = asset.vertices.iter().enumerate().filter(|(_, known)| is_meant(known));
    match (found.next(), found.next(), &edit.mesh) {
        (Some((mesh, _)), None, _) => Ok(mesh),
        (Some(_), Some(_), MeshRef::Name(name)) => Err(Fault::new(
            "unknown-mesh",
            "mesh",
            format!("several meshes are called {name:?}; hint: name it by its index in the file"),
        )),
        (_, _, MeshRef::Name(name)) => {
            let known = nearest(name, asset.vertices.iter().filter_map(|known| known.name.as_deref()));
            Err(Fault::new(
                "unknown-mesh",
                "mesh",
                format!("there is no mesh {name:?} in {:?}; hint: {known}", edit.node),
            ))
        }
        (_, _, MeshRef::Index(index)) => {
            let known: Vec<String> = asset.vertices.iter().take(5).map(|known| known.mesh.to_string()).collect();
            let hint = format!("those that it shows begin with {}", known.join(", "));
            Err(Fault::new("unknown-mesh", "mesh", format!("{:?} shows no mesh {index}; hint: {hint}", edit.node)))
        }
    }
}
