//! What a draft holds, counted while edits are taken, so that what would pass a limit is refused before it is made.

use std::collections::HashMap;
use std::sync::Arc;

use crate::asset::Asset;
use crate::edit::Fault;
use crate::limits::Limits;
use crate::scene::{Node, Scene};

/// Sums over a draft; each counts what the limit of its name bounds.
#[derive(Debug, Default)]
pub(crate) struct Totals {
    /// How many nodes show an asset, by its address, which is no other's while a node of the draft holds it.
    uses: HashMap<*const Asset, usize>,
    triangles: usize,
    texels: usize,
    /// Meshes and lights; a node counts as one at least.
    placed: usize,
    /// Of all nodes: each has its own.
    materials: usize,
    /// Those that shine.
    lights: usize,
}

impl Totals {
    pub(crate) fn of(draft: &Scene) -> Self {
        let mut totals = Self { lights: draft.own_lights.len(), ..Self::default() };
        for node in &draft.nodes {
            totals.add(node);
        }
        totals
    }

    /// What a file may hold that comes next.
    pub(crate) fn left(&self, limits: &Limits) -> Limits {
        Limits {
            max_triangles: limits.max_triangles.saturating_sub(self.triangles),
            max_texels: limits.max_texels.saturating_sub(self.texels),
            max_lights: limits.max_lights.saturating_sub(self.lights),
            ..*limits
        }
    }

    /// Whether any node fits in, whatever it shows.
    ///
    /// # Errors
    /// `too-large`, at field `node`.
    pub(crate) fn check_node(&self, limits: &Limits) -> Result<(), Fault> {
        check("node", "placed meshes and lights", self.placed + 1, limits.max_nodes, "max_nodes")
    }

    /// Whether so many triangles more fit in.
    ///
    /// # Errors
    /// `too-large`, at `field`.
    pub(crate) fn check_triangles(&self, field: &'static str, more: usize, limits: &Limits) -> Result<(), Fault> {
        check(field, "triangles", self.triangles + more, limits.max_triangles, "max_triangles")
    }

    /// Whether a node with this asset fits in.
    ///
    /// # Errors
    /// `too-large`, at field `uri`.
    pub(crate) fn check_asset(&self, asset: &Arc<Asset>, limits: &Limits) -> Result<(), Fault> {
        let is_new = !self.uses.contains_key(&Arc::as_ptr(asset));
        let (triangles, texels) = if is_new { (asset.triangle_count(), asset.texel_count()) } else { (0, 0) };
        self.check_triangles("uri", triangles, limits)?;
        check("uri", "texels", self.texels + texels, limits.max_texels, "max_texels")?;
        check("uri", "placed meshes and lights", self.placed + placed(asset), limits.max_nodes, "max_nodes")?;
        check("uri", "materials", self.materials + asset.materials.len(), limits.max_nodes, "max_nodes")?;
        check("uri", "lights", self.lights + asset.lights.len(), limits.max_lights, "max_lights")
    }

    pub(crate) fn add(&mut self, node: &Node) {
        let uses = self.uses.entry(Arc::as_ptr(&node.asset)).or_default();
        *uses += 1;
        if *uses == 1 {
            self.triangles += node.asset.triangle_count();
            self.texels += node.asset.texel_count();
        }
        self.triangles += shaped(node);
        self.placed += placed(&node.asset);
        self.materials += node.materials.len();
        self.lights += shining(node);
    }

    /// Takes a node out that was counted.
    pub(crate) fn remove(&mut self, node: &Node) {
        let address = Arc::as_ptr(&node.asset);
        if let Some(uses) = self.uses.get_mut(&address) {
            *uses -= 1;
            if *uses == 0 {
                self.uses.remove(&address);
                self.triangles -= node.asset.triangle_count();
                self.texels -= node.asset.texel_count();
            }
        }
        self.triangles -= shaped(node);
        self.placed -= placed(&node.asset);
        self.materials -= node.materials.len();
        self.lights -= shining(node);
    }

    /// Takes in that an edit lit a light (1), put it out (−1), or neither.
    ///
    /// # Errors
    /// `too-large`, at field `name`, where a light too many was lit.
    pub(crate) fn change_lights(&mut self, change: isize, limits: &Limits) -> Result<(), Fault> {
        self.lights = self.lights.saturating_add_signed(change);
        if change <= 0 {
            return Ok(());
        }
        check("name", "lights", self.lights, limits.max_lights, "max_lights")
    }
}

fn placed(asset: &Asset) -> usize {
    (asset.parts.len() + asset.lights.len()).max(1)
}

/// Triangles of the meshes that a node has for itself.
fn shaped(node: &Node) -> usize {
    node.shapes.values().map(|shape| shape.mesh.indices.len()).sum()
}

fn shining(node: &Node) -> usize {
    node.lights.iter().filter(|state| !state.removed).count()
}

fn check(field: &'static str, what: &str, count: usize, limit: usize, key: &str) -> Result<(), Fault> {
    if count <= limit {
        return Ok(());
    }
    let hint = format!("take something away first, load simpler files, or raise limits.{key} in the configuration");
    let cause = format!("{what} of the whole scene would be {count}, above the limit of {limit} (limits.{key})");
    Err(Fault::new("too-large", field, format!("{cause}; hint: {hint}")))
}
