//! The node hierarchy: where each mesh and light stands, and in which role.

use glam::{DAffine3, DMat4, DQuat, DVec3};
use gltf::json::{Node, Root};
use lantern_proto::Role;

use super::error::{Located, Problem, bad, here, item};
use super::warnings::Warnings;
use crate::compose::is_sound;
use crate::limits::Limits;

/// A node of the scene that is shown.
pub(super) struct Visit {
    pub(super) node: usize,
    pub(super) asset_from_node: DAffine3,
    /// Of the nearest ancestor, itself included, that names one.
    pub(super) role: Option<Role>,
    /// Checked to be in range.
    pub(super) mesh: Option<usize>,
}

/// Walks the default scene (else the first, else every node without a parent), each node before its children, in the
/// file's order. By a stack of its own: a hostile file may be as deep as it is long.
pub(super) fn walk(root: &Root, limits: &Limits, warnings: &mut Warnings) -> Result<Vec<Visit>, Located> {
    let mut open: Vec<(usize, DAffine3, Option<Role>)> = vec![];
    for node in first_nodes(root)?.into_iter().rev() {
        open.push((node, DAffine3::IDENTITY, None));
    }
    let mut seen = vec![false; root.nodes.len()];
    let mut visits = vec![];
    while let Some((index, asset_from_parent, role)) = open.pop() {
        let object = format!("node {index}");
        let node = &root.nodes[index];
        if std::mem::replace(&mut seen[index], true) {
            return Err(here(object, Problem::NotATree));
        }
        if visits.len() >= limits.max_nodes {
            let (count, limit) = (root.nodes.len() as u64, limits.max_nodes as u64);
            return Err(here(object, Problem::TooMany { what: "nodes", count, limit, key: "limits.max_nodes" }));
        }
        let asset_from_node = asset_from_parent * parent_from_node(node, &object)?;
        let role = own_role(node, &object)?.or(role);
        let mesh = node.mesh.map(|mesh| mesh.value());
        if let Some(mesh) = mesh {
            item(&root.meshes, "mesh", mesh, &object)?;
        }
        for child in node.children.iter().flatten().rev() {
            item(&root.nodes, "node", child.value(), &object)?;
            open.push((child.value(), asset_from_node, role));
        }
        if is_sound(&asset_from_node.matrix3) && asset_from_node.translation.abs().max_element() <= 1e9 {
            visits.push(Visit { node: index, asset_from_node, role, mesh });
        } else if mesh.is_some() {
            warnings.add(format!("node {index} is squeezed flat or out of all reach, and not shown"));
        }
    }
    Ok(visits)
}

fn first_nodes(root: &Root) -> Result<Vec<usize>, Located> {
    let scene = match root.scene {
        Some(scene) => Some(item(&root.scenes, "scene", scene.value(), "scene")?),
        None => root.scenes.first(),
    };
    match scene {
        Some(scene) => {
            let nodes =
                scene.nodes.iter().map(|node| item(&root.nodes, "node", node.value(), "scene").map(|_| node.value()));
            nodes.collect()
        }
        None => {
            let mut is_child = vec![false; root.nodes.len()];
            for (index, node) in root.nodes.iter().enumerate() {
                for child in node.children.iter().flatten() {
                    item(&root.nodes, "node", child.value(), &format!("node {index}"))?;
                    is_child[child.value()] = true;
                }
            }
            Ok((0..root.nodes.len()).filter(|&node| !is_child[node]).collect())
        }
    }
}

fn parent_from_node(node: &Node, object: &str) -> Result<DAffine3, Located> {
    let not_finite = || bad(object, "has a transform that is not finite");
    if let Some(matrix) = node.matrix {
        let matrix = DMat4::from_cols_array(&matrix.map(f64::from));
        if !matrix.is_finite() {
            return Err(not_finite());
        }
        let bottom = matrix.row(3).to_array();
        if bottom.iter().zip([0.0, 0.0, 0.0, 1.0]).any(|(found, expected)| (found - expected).abs() > 1e-6) {
            return Err(bad(object, format!("has a matrix whose last row is {bottom:?}, so it is not affine")));
        }
        return Ok(DAffine3::from_mat4(matrix));
    }
    let vector = |v: Option<[f32; 3]>, default: DVec3| v.map_or(default, |v| DVec3::from(v.map(f64::from)));
    let translation = vector(node.translation, DVec3::ZERO);
    let scale = vector(node.scale, DVec3::ONE);
    let rotation = node.rotation.map_or(DQuat::IDENTITY, |q| DQuat::from_array(q.0.map(f64::from)));
    if !translation.is_finite() || !scale.is_finite() || !rotation.is_finite() {
        return Err(not_finite());
    }
    let norm = rotation.length();
    if (norm - 1.0).abs() > 0.01 {
        return Err(bad(object, format!("has a rotation of norm {norm}; a quaternion's is 1")));
    }
    Ok(DAffine3::from_scale_rotation_translation(scale, rotation.normalize(), translation))
}

/// `extras.lantern.role`.
fn own_role(node: &Node, object: &str) -> Result<Option<Role>, Located> {
    let Some(extras) = &node.extras else { return Ok(None) };
    let Ok(extras) = serde_json::from_str::<serde_json::Value>(extras.get()) else { return Ok(None) };
    let Some(role) = extras.get("lantern").and_then(|lantern| lantern.get("role")) else { return Ok(None) };
    let known = [Role::Prop, Role::Virtual, Role::Raster, Role::Mask];
    let known = known.into_iter().find(|known| role.as_str() == Some(known.as_str()));
    known.map(Some).ok_or_else(|| {
        bad(
            object,
            format!("has extras.lantern.role {role}, which is none of \"prop\", \"virtual\", \"raster\", \"mask\""),
        )
    })
}
