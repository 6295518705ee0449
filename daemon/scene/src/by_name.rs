//! Edits of what goes by a name within nodes: materials and lights.

use std::sync::Arc;

use lantern_proto as proto;

use crate::edit::{Fault, checked_name, nearest};
use crate::light::LightState;
use crate::material;
use crate::scene::Scene;

/// `node/name` is one node's material; a bare name is every node's. A node and material that fit come before a material
/// whose own name has a slash.
pub(crate) fn apply_material(draft: &mut Scene, edit: &proto::Material) -> Result<(), Fault> {
    let of_node = edit.name.split_once('/').and_then(|(node, name)| {
        let index = draft.node(node).map(|(index, _)| index)?;
        draft.nodes[index].material_names().any(|known| known == name).then_some((index, name))
    });
    let (nodes, name) = match of_node {
        Some((index, name)) => (index..index + 1, name),
        None => (0..draft.nodes.len(), edit.name.as_str()),
    };
    let mut found = false;
    for node in &mut draft.nodes[nodes] {
        if !node.material_names().any(|known| known == name) {
            continue;
        }
        found = true;
        for material in Arc::make_mut(&mut node.materials).iter_mut().filter(|material| material.name == name) {
            material::apply(edit, &mut material.gpu)?;
        }
    }
    if found {
        return Ok(());
    }
    let full: Vec<String> = match edit.name.split_once('/') {
        Some(_) => {
            draft.nodes.iter().flat_map(|n| n.material_names().map(move |m| format!("{}/{m}", n.name))).collect()
        }
        None => draft.nodes.iter().flat_map(|n| n.material_names().map(str::to_owned)).collect(),
    };
    let known = nearest(&edit.name, full.iter().map(String::as_str));
    Err(Fault::new("unknown-material", "name", format!("there is no material {:?}; hint: {known}", edit.name)))
}

/// `node/light` is an imported light, a name without a slash one of our own. Gives 1 where a light came to shine, −1 where
/// one went out, else 0.
pub(crate) fn apply_light(draft: &mut Scene, edit: &proto::Light) -> Result<isize, Fault> {
    let unknown = |draft: &Scene| {
        let names = draft.light_names();
        let known = nearest(&edit.name, names.iter().map(String::as_str));
        Fault::new("unknown-light", "name", format!("there is no light {:?}; hint: {known}", edit.name))
    };

    // An imported one stays known when it was taken away.
    if let Some((node, light)) = edit.name.split_once('/') {
        let place = draft.node(node).and_then(|(index, node)| {
            node.asset.lights.iter().position(|known| known.name == light).map(|light| (index, light))
        });
        let Some((node, light)) = place else { return Err(unknown(draft)) };
        let state = &mut draft.nodes[node].lights[light];
        let shone = !state.removed;
        state.apply(edit, true)?;
        return Ok(isize::from(!state.removed) - isize::from(shone));
    }

    let name = checked_name("name", &edit.name)?;
    let known = draft.own_lights.iter().position(|(known, _)| known == name);
    match (known, edit.remove == Some(true)) {
        (Some(index), true) => {
            draft.own_lights.remove(index);
            Ok(-1)
        }
        (None, true) => Err(unknown(draft)),
        (Some(index), false) => draft.own_lights[index].1.apply(edit, true).map(|()| 0),
        (None, false) => {
            let mut state = LightState::default();
            state.apply(edit, false)?;
            draft.own_lights.push((name.to_owned(), state));
            Ok(1)
        }
    }
}
