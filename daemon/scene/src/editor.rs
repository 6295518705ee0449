//! Turns edits into revisions, all or nothing.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DQuat, DVec3};
use lantern_config as config;
use lantern_proto as proto;
use lantern_proto::Edit;

use crate::compose::{ComposeError, compose};
use crate::edit::{
    EditError, Fault, bad_value, checked_name, checked_rotation, checked_scale, checked_translation, name_of, nearest,
};
use crate::environment;
use crate::file::Access;
use crate::library::Library;
use crate::light::LightState;
use crate::limits::Limits;
use crate::material;
use crate::pack::{GpuGeometry, GpuTextures, GpuTop};
use crate::scene::{EnvironmentSource, Node, Parts, Scene};
use crate::top::Top;

/// Holds the newest revision and makes the next.
#[derive(Clone, Debug)]
pub struct Editor {
    limits: Limits,
    /// Canonical.
    asset_roots: Vec<PathBuf>,
    library: Library,
    current: Arc<Scene>,
}

/// Something of a configuration's scene that cannot be shown.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{at}: {message}")]
pub struct SceneProblem {
    /// As of an [`EditError`].
    pub code: &'static str,
    /// Which entry of the configuration: `scene.node "car"`.
    pub at: String,
    /// Which value of the entry, as the edit calls it: `uri`; empty where the entry as a whole is meant.
    pub field: &'static str,
    /// Cause, and after `hint:` the remedy.
    pub message: String,
}

impl Editor {
    /// An empty, black scene. Clients may have files read under the roots alone; one that does not exist is passed over.
    pub fn new(limits: Limits, asset_roots: Vec<PathBuf>) -> Self {
        Self { limits, asset_roots: canonical(&asset_roots), library: Library::default(), current: Arc::new(empty()) }
    }

    /// The scene of a configuration. Its files may lie anywhere; relative paths are relative to `base_dir`.
    ///
    /// # Errors
    /// Every entry that cannot be shown, not the first alone.
    pub fn from_config(
        scene: &config::Scene,
        base_dir: &Path,
        limits: Limits,
        asset_roots: Vec<PathBuf>,
    ) -> Result<Self, Vec<SceneProblem>> {
        let mut editor = Self::new(limits, vec![]);
        editor.reconfigure(scene, base_dir, limits, asset_roots)?;
        Ok(editor)
    }

    /// Replaces the whole scene by a configuration's, as [`Editor::from_config`] makes it. Revisions count on, and what
    /// is the same as before keeps its sections.
    ///
    /// # Errors
    /// Every entry that cannot be shown; then nothing has changed.
    pub fn reconfigure(
        &mut self,
        scene: &config::Scene,
        base_dir: &Path,
        limits: Limits,
        asset_roots: Vec<PathBuf>,
    ) -> Result<Arc<Scene>, Vec<SceneProblem>> {
        let mut draft = Scene { nodes: vec![], own_lights: vec![], ..Scene::clone(&self.current) };
        let black = proto::Environment { uri: None, color: Some(proto::Color([0.0; 3])) };
        let black = ("scene.environment".to_owned(), Edit::Environment(black));
        let black = scene.environment.is_none().then_some(black);
        let folders = [base_dir.to_owned()];
        let limits_before = std::mem::replace(&mut self.limits, limits);
        let mut problems = vec![];
        for (at, edit) in black.into_iter().chain(crate::configured::edits(scene)) {
            if let Err(fault) = self.take(&mut draft, &edit, Access::Anywhere(&folders)) {
                problems.push(SceneProblem { code: fault.code, at, field: fault.field, message: fault.message });
            }
        }
        if problems.is_empty() {
            match compose(&mut draft, &limits) {
                Ok(()) => {
                    self.asset_roots = canonical(&asset_roots);
                    return Ok(self.publish(draft));
                }
                Err(error) => {
                    let at = match &error {
                        ComposeError::Transform { node } => format!("scene.node {node:?}"),
                        ComposeError::TooLarge { .. } => "scene".to_owned(),
                    };
                    problems.push(SceneProblem { code: error.code(), at, field: "", message: error.to_string() });
                }
            }
        }
        self.limits = limits_before;
        Err(problems)
    }

    /// The newest revision.
    pub fn current(&self) -> Arc<Scene> {
        self.current.clone()
    }

    /// Applies a client's edits and gives the new revision; an empty list gives the current one.
    ///
    /// # Errors
    /// The first edit that cannot be applied; then nothing has changed.
    pub fn apply(&mut self, edits: &[Edit]) -> Result<Arc<Scene>, EditError> {
        let roots = self.asset_roots.clone();
        self.apply_as(edits, Access::Roots(&roots))
    }

    /// Applies edits that the daemon itself has stored: those of [`Scene::edits`], whose files may lie anywhere since
    /// the configuration may have named them.
    ///
    /// # Errors
    /// As [`Editor::apply`].
    pub fn restore(&mut self, edits: &[Edit]) -> Result<Arc<Scene>, EditError> {
        let roots = self.asset_roots.clone();
        self.apply_as(edits, Access::Stored(&roots))
    }

    /// Gives what was restored the number that it had, so that numbers never go back when a daemon restarts.
    pub fn continue_after(&mut self, revision: u64) {
        let scene = Scene::clone(&self.current);
        self.current = Arc::new(Scene { revision: revision.max(scene.revision), ..scene });
    }

    /// Makes an earlier revision the newest again, under a number beyond those of the revisions since; `published` may be
    /// one of a copy of this editor.
    pub fn go_back(&mut self, to: &Scene, published: u64) -> Arc<Scene> {
        let revision = self.current.revision.max(published) + 1;
        self.current = Arc::new(Scene { revision, ..to.clone() });
        self.current()
    }

    /// Takes a revision that a copy of this editor has made as the newest; what was loaded stays known.
    pub fn go_on_from(&mut self, current: Arc<Scene>) {
        self.current = current;
    }

    /// Replaces the limits, and the only folders from which clients may have files read; what is there stays.
    pub fn set_access(&mut self, limits: Limits, asset_roots: &[PathBuf]) {
        self.limits = limits;
        self.asset_roots = canonical(asset_roots);
    }

    fn apply_as(&mut self, edits: &[Edit], access: Access<'_>) -> Result<Arc<Scene>, EditError> {
        if edits.is_empty() {
            return Ok(self.current());
        }
        let mut draft = Scene::clone(&self.current);
        for (index, edit) in edits.iter().enumerate() {
            self.take(&mut draft, edit, access).map_err(|fault| fault.at(index))?;
        }
        compose(&mut draft, &self.limits).map_err(|error| locate(error, edits))?;
        Ok(self.publish(draft))
    }

    /// Moves a node to where a tracked body holds it: as a `set` of translation and rotation. Only the top level and
    /// what follows the node are made anew; where it stands there already, the revision stays.
    ///
    /// # Errors
    /// `unknown-node` or `bad-transform`.
    pub fn place(&mut self, node: &str, translation_m: DVec3, rotation: DQuat) -> Result<Arc<Scene>, EditError> {
        let placed = |(_, n): (usize, &Node)| n.translation_m == translation_m && n.rotation == rotation;
        if self.current.node(node).is_some_and(placed) {
            return Ok(self.current());
        }
        let set = proto::Set {
            node: node.to_owned(),
            translation_m: Some(translation_m.to_array()),
            rotation: Some(rotation.to_array()),
            ..proto::Set::default()
        };
        self.apply(&[Edit::Set(set)])
    }

    fn publish(&mut self, mut draft: Scene) -> Arc<Scene> {
        draft.revision = self.current.revision + 1;
        self.current = Arc::new(draft);
        self.current()
    }

    /// Brings one edit into the draft; derived sections are left to [`compose`].
    fn take(&mut self, draft: &mut Scene, edit: &Edit, access: Access<'_>) -> Result<(), Fault> {
        match edit {
            Edit::Add(add) => self.add(draft, add, access),
            Edit::Remove(remove) => {
                let index = index_of(draft, &remove.node)?;
                draft.nodes.remove(index);
                Ok(())
            }
            Edit::Set(set) => apply_set(draft, set),
            Edit::Material(material) => apply_material(draft, material),
            Edit::Light(light) => apply_light(draft, light),
            Edit::Environment(environment) => self.set_environment(draft, environment, access),
            Edit::Vertices(_) => Err(Fault::new(
                "not-built",
                name_of(edit),
                "the edit `vertices` is not built yet; hint: remove the node and add it again from a changed file",
            )),
        }
    }

    fn add(&mut self, draft: &mut Scene, add: &proto::Add, access: Access<'_>) -> Result<(), Fault> {
        let name = checked_name("node", &add.node)?;
        if draft.node(name).is_some() {
            let hint = "remove it first, or choose another name";
            return Err(Fault::new(
                "duplicate-node",
                "node",
                format!("there is a node {name:?} already; hint: {hint}"),
            ));
        }
        let translation_m = checked_translation(add.translation_m.unwrap_or([0.0; 3]))?;
        let rotation = checked_rotation(add.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]))?;
        let scale = checked_scale(add.scale.unwrap_or([1.0; 3]))?;

        // Before a file is opened: a list of many adds must not load what the limit will refuse.
        if draft.nodes.len() >= self.limits.max_nodes {
            let error =
                ComposeError::TooLarge { what: "nodes", count: draft.nodes.len() + 1, limit: self.limits.max_nodes };
            return Err(Fault::new(error.code(), "node", error.to_string()));
        }
        let (asset, uri) = self.library.asset(&add.uri, access, &self.limits)?;
        draft.nodes.push(Node {
            name: name.to_owned(),
            uri,
            role: add.role.unwrap_or_default(),
            visible: true,
            translation_m,
            rotation,
            scale,
            materials: Arc::new(asset.materials.clone()),
            lights: vec![LightState::default(); asset.lights.len()],
            asset,
        });
        Ok(())
    }

    fn set_environment(
        &mut self,
        draft: &mut Scene,
        edit: &proto::Environment,
        access: Access<'_>,
    ) -> Result<(), Fault> {
        let color = match (&edit.uri, edit.color) {
            (Some(uri), None) => match proto::Color::from_hex(uri) {
                Some(color) => color,
                None => {
                    let (environment, uri) = self.library.environment(uri, access, &self.limits)?;
                    draft.environment = environment;
                    draft.environment_source = EnvironmentSource::Uri(uri);
                    return Ok(());
                }
            },
            (None, Some(color)) => color,
            _ => return Err(bad_value("environment", "has both of uri and color, or neither", "give one of them")),
        };
        if !color.0.iter().all(|c| (0.0..=1e6).contains(c)) {
            return Err(bad_value("color", format_args!("{:?} leaves 0 to 1e6", color.0), "linear RGB, 0 or more"));
        }
        let source = EnvironmentSource::Color(color.0);
        if draft.environment_source != source {
            draft.environment = Arc::new(environment::constant(color.0));
            draft.environment_source = source;
        }
        Ok(())
    }
}

fn canonical(roots: &[PathBuf]) -> Vec<PathBuf> {
    roots.iter().filter_map(|root| root.canonicalize().ok()).collect()
}

/// Nothing, in black.
fn empty() -> Scene {
    Scene {
        revision: 0,
        origin_m: DVec3::ZERO,
        nodes: vec![],
        meshes: vec![],
        instances: vec![],
        materials: Arc::default(),
        geometry: Arc::new(GpuGeometry::default()),
        top: Arc::new(GpuTop::default()),
        gpu_materials: Arc::default(),
        textures: Arc::new(GpuTextures::default()),
        lights: Arc::default(),
        environment: Arc::new(environment::constant([0.0; 3])),
        environment_source: EnvironmentSource::Color([0.0; 3]),
        own_lights: vec![],
        parts: Parts::default(),
        top_walk: Arc::new(Top::default()),
    }
}

fn index_of(draft: &Scene, name: &str) -> Result<usize, Fault> {
    draft.node(name).map(|(index, _)| index).ok_or_else(|| {
        let known = nearest(name, draft.nodes.iter().map(|node| node.name.as_str()));
        Fault::new("unknown-node", "node", format!("there is no node {name:?}; hint: {known}"))
    })
}

fn apply_set(draft: &mut Scene, set: &proto::Set) -> Result<(), Fault> {
    let index = index_of(draft, &set.node)?;
    let translation_m = set.translation_m.map(checked_translation).transpose()?;
    let rotation = set.rotation.map(checked_rotation).transpose()?;
    let scale = set.scale.map(checked_scale).transpose()?;
    let node = &mut draft.nodes[index];
    node.translation_m = translation_m.unwrap_or(node.translation_m);
    node.rotation = rotation.unwrap_or(node.rotation);
    node.scale = scale.unwrap_or(node.scale);
    node.role = set.role.unwrap_or(node.role);
    node.visible = set.visible.unwrap_or(node.visible);
    Ok(())
}

/// `node/name` is one node's material; a bare name is every node's. A node and material that fit come before a material
/// whose own name has a slash.
fn apply_material(draft: &mut Scene, edit: &proto::Material) -> Result<(), Fault> {
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

fn apply_light(draft: &mut Scene, edit: &proto::Light) -> Result<(), Fault> {
    let unknown = |draft: &Scene| {
        let names = draft.light_names();
        let known = nearest(&edit.name, names.iter().map(String::as_str));
        Fault::new("unknown-light", "name", format!("there is no light {:?}; hint: {known}", edit.name))
    };

    // `node/light` is an imported one, which stays known when it was taken away.
    if let Some((node, light)) = edit.name.split_once('/') {
        let place = draft.node(node).and_then(|(index, node)| {
            node.asset.lights.iter().position(|known| known.name == light).map(|light| (index, light))
        });
        let Some((node, light)) = place else { return Err(unknown(draft)) };
        return draft.nodes[node].lights[light].apply(edit, true);
    }

    let name = checked_name("name", &edit.name)?;
    let known = draft.own_lights.iter().position(|(known, _)| known == name);
    match (known, edit.remove == Some(true)) {
        (Some(index), true) => {
            draft.own_lights.remove(index);
            Ok(())
        }
        (None, true) => Err(unknown(draft)),
        (Some(index), false) => draft.own_lights[index].1.apply(edit, true),
        (None, false) => {
            let mut state = LightState::default();
            state.apply(edit, false)?;
            draft.own_lights.push((name.to_owned(), state));
            Ok(())
        }
    }
}

/// Which edit a scene that cannot be put together is laid to: the last that touched the node in question, else the last
/// add.
fn locate(error: ComposeError, edits: &[Edit]) -> EditError {
    let touches = |edit: &Edit| match (&error, edit) {
        (ComposeError::Transform { node }, Edit::Add(add)) => add.node == *node,
        (ComposeError::Transform { node }, Edit::Set(set)) => set.node == *node,
        (ComposeError::TooLarge { .. }, Edit::Add(_)) => true,
        _ => false,
    };
    let at = edits.iter().rposition(touches).map_or("edits".to_owned(), |index| format!("edits[{index}]"));
    EditError { code: error.code(), message: error.to_string(), at }
}
