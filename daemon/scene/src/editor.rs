//! Turns edits into revisions, all or nothing.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DQuat, DVec3};
use lantern_config as config;
use lantern_proto as proto;
use lantern_proto::Edit;

use crate::by_name::{apply_light, apply_material};
use crate::compose::{ComposeError, compose, compose_placement};
use crate::edit::{
    EditError, Fault, bad_value, checked_name, checked_rotation, checked_scale, checked_translation, nearest,
};
use crate::environment;
use crate::file::Access;
use crate::library::Library;
use crate::light::LightState;
use crate::limits::Limits;
use crate::pack::GpuTop;
use crate::scene::{EnvironmentSource, Node, Parts, Scene};
use crate::structures::Structures;
use crate::texture::GpuTextures;
use crate::top::Top;
use crate::totals::Totals;
use crate::vertices::apply_vertices;

/// Holds the newest revision and makes the next.
#[derive(Clone, Debug)]
pub struct Editor {
    limits: Limits,
    /// Canonical.
    asset_roots: Vec<PathBuf>,
    library: Library,
    current: Arc<Scene>,
    /// A scene in which something of what the next edits ask for may have been made already.
    prepared: Option<Arc<Scene>>,
}

/// Whether edits may take long to apply, because files are read or structures built.
pub fn may_take_long(edits: &[Edit]) -> bool {
    edits.iter().any(|edit| match edit {
        Edit::Add(_) | Edit::Vertices(_) => true,
        Edit::Environment(environment) => environment.uri.is_some(),
        Edit::Remove(_) | Edit::Set(_) | Edit::Material(_) | Edit::Light(_) => false,
    })
}

/// Where a tracked body holds a node.
#[derive(Clone, Copy, Debug)]
pub struct Place<'a> {
    /// Its name.
    pub node: &'a str,
    /// Metres.
    pub translation_m: DVec3,
    /// A unit quaternion.
    pub rotation: DQuat,
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
        let (library, current) = (Library::default(), Arc::new(empty()));
        Self { limits, asset_roots: canonical(&asset_roots), library, current, prepared: None }
    }

    /// The same, with structures from where they may have been kept.
    #[must_use]
    pub fn with_structures(mut self, structures: Arc<Structures>) -> Self {
        self.library.structures = structures;
        self
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
        let named_before = self.library.take_named();
        self.prepared = None;
        let (mut totals, mut problems) = (Totals::of(&draft), vec![]);
        for (at, edit) in black.into_iter().chain(crate::configured::edits(scene)) {
            if let Err(fault) = self.take(&mut draft, &mut totals, &edit, Access::Anywhere(&folders), None) {
                problems.push(SceneProblem { code: fault.code, at, field: fault.field, message: fault.message });
            }
        }
        if problems.is_empty() {
            match compose(&mut draft) {
                Ok(()) => {
                    self.asset_roots = canonical(&asset_roots);
                    return Ok(self.publish(draft));
                }
                Err(error) => {
                    let ComposeError::Transform { node } = &error;
                    let at = format!("scene.node {node:?}");
                    problems.push(SceneProblem { code: error.code(), at, field: "", message: error.to_string() });
                }
            }
        }
        self.limits = limits_before;
        self.library.name_again(named_before);
        Err(problems)
    }

    /// Where its structures come from.
    pub fn structures(&self) -> &Arc<Structures> {
        &self.library.structures
    }

    /// The newest revision.
    pub fn current(&self) -> Arc<Scene> {
        self.current.clone()
    }

    /// Applies a client's edits and gives the new revision; an empty list gives the current one. Files lie under the asset
    /// roots, or are those that the configuration or a restored state has named, under their canonical paths.
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

    /// Takes over what another editor has loaded and built, for as long as that one's scene keeps it alive, so that edits find
    /// it ready. The scene stays as it is.
    pub fn learn_from(&mut self, other: &Self) {
        self.library.learn_from(&other.library);
        self.prepared = Some(other.current());
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
        let prepared = self.prepared.take();
        let mut draft = Scene::clone(&self.current);
        let mut totals = Totals::of(&draft);
        for (index, edit) in edits.iter().enumerate() {
            self.take(&mut draft, &mut totals, edit, access, prepared.as_deref()).map_err(|fault| fault.at(index))?;
        }
        compose(&mut draft).map_err(|error| locate(error, edits))?;
        Ok(self.publish(draft))
    }

    /// Moves a node as by a `set` of translation and rotation; where it stands there already, the revision stays.
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

    /// Moves nodes to where tracked bodies hold them, each as by a `set` of translation and rotation, all in one revision.
    /// Only the top level and what follows the nodes are made anew; where all stand there already, the revision stays. A
    /// node that is not there, or a place where it cannot stand, is passed over.
    pub fn place_all(&mut self, places: &[Place<'_>]) -> Arc<Scene> {
        let index_of: HashMap<&str, usize> = match places {
            [_] => HashMap::new(),
            _ => self.current.nodes.iter().enumerate().map(|(index, node)| (node.name.as_str(), index)).collect(),
        };
        let index_of = |name: &str| match places {
            [_] => self.current.node(name).map(|(index, _)| index),
            _ => index_of.get(name).copied(),
        };
        let mut moves = vec![];
        for Place { node, translation_m, rotation } in places {
            let to = checked_translation(translation_m.to_array())
                .and_then(|to| Ok((to, checked_rotation(rotation.to_array())?)));
            match (index_of(node), to) {
                (Some(index), Ok(to))
                    if to != (self.current.nodes[index].translation_m, self.current.nodes[index].rotation) =>
                {
                    moves.push((index, to));
                }
                (Some(_), Ok(_)) => {}
                (None, _) => tracing::trace!(node, "there is no such node to move"),
                (_, Err(fault)) => tracing::trace!(node, message = fault.message, "the node cannot stand there"),
            }
        }
        while !moves.is_empty() {
            let mut draft = Scene::clone(&self.current);
            for &(index, (translation_m, rotation)) in &moves {
                let node = &mut draft.nodes[index];
                (node.translation_m, node.rotation) = (translation_m, rotation);
            }
            match compose_placement(&mut draft) {
                Ok(()) => return self.publish(draft),
                Err(ComposeError::Transform { node }) => {
                    tracing::trace!(node, "the node cannot stand there");
                    let moved = moves.len();
                    moves.retain(|(index, _)| self.current.nodes[*index].name != node);
                    if moves.len() == moved {
                        break;
                    }
                }
            }
        }
        self.current()
    }

    fn publish(&mut self, mut draft: Scene) -> Arc<Scene> {
        draft.revision = self.current.revision + 1;
        self.current = Arc::new(draft);
        self.current()
    }

    /// Brings one edit into the draft; derived sections are left to [`compose`].
    fn take(
        &mut self,
        draft: &mut Scene,
        totals: &mut Totals,
        edit: &Edit,
        access: Access<'_>,
        prepared: Option<&Scene>,
    ) -> Result<(), Fault> {
        match edit {
            Edit::Add(add) => {
                let node = self.node(draft, totals, add, access)?;
                totals.add(&node);
                draft.nodes.push(node);
                Ok(())
            }
            Edit::Remove(remove) => {
                let index = index_of(draft, &remove.node)?;
                totals.remove(&draft.nodes.remove(index));
                Ok(())
            }
            Edit::Set(set) => apply_set(draft, set),
            Edit::Material(material) => apply_material(draft, material),
            Edit::Light(light) => totals.change_lights(apply_light(draft, light)?, &self.limits),
            Edit::Environment(environment) => self.set_environment(draft, environment, access),
            Edit::Vertices(vertices) => apply_vertices(draft, totals, vertices, &self.limits, prepared),
        }
    }

    /// The node of an add, which the draft does not have yet.
    fn node(&mut self, draft: &Scene, totals: &Totals, add: &proto::Add, access: Access<'_>) -> Result<Node, Fault> {
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

        // Before a file is opened, and no more of it than fits: a list of many adds must not load what the limits will
        // refuse.
        totals.check_node(&self.limits)?;
        let (asset, uri) = self.library.asset(&add.uri, access, &totals.left(&self.limits))?;
        totals.check_asset(&asset, &self.limits)?;
        Ok(Node {
            name: name.to_owned(),
            uri,
            role: add.role.unwrap_or_default(),
            role_is_said: add.role.is_some(),
            visible: true,
            translation_m,
            rotation,
            scale,
            materials: Arc::new(asset.materials.clone()),
            lights: vec![LightState::default(); asset.lights.len()],
            shapes: BTreeMap::new(),
            asset,
        })
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
    node.role_is_said |= set.role.is_some();
    node.visible = set.visible.unwrap_or(node.visible);
    Ok(())
}

/// Which edit a scene that cannot be put together is laid to: the last that touched the node in question.
fn locate(error: ComposeError, edits: &[Edit]) -> EditError {
    let ComposeError::Transform { node: wrong } = &error;
    let touches = |edit: &Edit| match edit {
        Edit::Add(add) => add.node == *wrong,
        Edit::Set(set) => set.node == *wrong,
        _ => false,
    };
    let at = edits.iter().rposition(touches).map_or("edits".to_owned(), |index| format!("edits[{index}]"));
    EditError { code: error.code(), message: error.to_string(), at }
}
