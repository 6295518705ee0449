//! From the configuration to the parts.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;
use lantern_calibration::doctor::{self, Finding, Props};
use lantern_calibration::formats::{self, FileError};
use lantern_calibration::{Calibration, LoadError};
use lantern_config::{Body, Config, Drives, Problem};
use lantern_render::{ProjectorSpec, RasterOrder, Settings};
use lantern_scene::{Editor, Role, Scene, Structures};

use super::frames::Setup;
use super::sources::Sources;
use crate::control::Door;
use crate::output::OutputSpec;

/// Everything wrong with a configuration and what it names.
#[derive(Debug, thiserror::Error)]
#[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
pub struct Problems(pub Vec<Problem>);

/// A configuration with the scene that it names, loaded.
pub struct Loaded {
    /// The configuration.
    pub config: Config,
    /// The projectors' matrices.
    pub projectors: Vec<ProjectorSpec>,
    /// The scene.
    pub editor: Editor,
    /// What is suspicious about calibrations, by the projector's name.
    pub suspicions: Vec<(String, Finding)>,
}

impl Loaded {
    /// Logs what works and is still worth a look.
    pub fn warn(&self) {
        for node in &self.editor.current().nodes {
            for warning in node.warnings() {
                tracing::warn!(node = node.name, "{warning}");
            }
        }
        for (projector, finding) in &self.suspicions {
            tracing::warn!(projector, "{finding}");
        }
    }
}

/// Reads a configuration file and everything that it names.
///
/// # Errors
/// Every problem, with its place.
pub fn load(path: &Path) -> Result<Loaded, Problems> {
    load_from(&mut Sources::read(path).map_err(Problems)?)
}

/// The same from sources, which read the calibrations that they do not have.
///
/// # Errors
/// Every problem, with its place.
pub fn load_from(sources: &mut Sources) -> Result<Loaded, Problems> {
    let config = sources.config().map_err(Problems)?;
    from_config_by(config, &sources.name(), |path| sources.calibration(path))
}

/// Loads everything that a configuration names.
///
/// # Errors
/// Every problem, with its place.
pub fn from_config(config: Config, file: &str) -> Result<Loaded, Problems> {
    from_config_by(config, file, |path| formats::read(path).map(Arc::new))
}

fn from_config_by(
    config: Config,
    file: &str,
    mut read: impl FnMut(&Path) -> Result<Arc<Vec<u8>>, FileError>,
) -> Result<Loaded, Problems> {
    let mut problems = Vec::new();
    if let Some(Err(error)) = config.daemon.group.as_deref().map(Door::for_group) {
        problems.push(problem(&config, file, "daemon", "group", &error.to_string()));
    }
    let mut projectors = Vec::new();
    for projector in &config.projectors {
        match Calibration::from_config_by(projector, &mut read) {
            Ok(calibration) => projectors.push(ProjectorSpec { name: projector.name.clone(), calibration }),
            Err(error) => problems.push(calibration_problem(&config, file, &projector.name, &error)),
        }
    }
    let limits = (&config.limits).into();
    let mut editor = Editor::new(limits, vec![]).with_structures(structures(&config));
    let shown = editor.reconfigure(&config.scene, &config.base_dir, limits, config.daemon.asset_roots.clone());
    // What is certain is a problem like any other; a projector whose matrices are none has no more to say.
    let props = shown.as_ref().ok().and_then(|scene| props(scene));
    let mut suspicions = Vec::new();
    for (projector, spec) in
        config.projectors.iter().filter_map(|p| Some((p, projectors.iter().find(|s| s.name == p.name)?)))
    {
        for finding in doctor::examine(&projector.calibration, &spec.calibration, props.as_ref()) {
            if finding.certain {
                let at = format!("projector {:?}", projector.name);
                let field = format!("calibration.{}", finding.key);
                problems.push(problem(&config, file, &at, &field, &finding.to_string()));
            } else {
                suspicions.push((projector.name.clone(), finding));
            }
        }
    }
    match shown.map(|_| editor) {
        Ok(editor) if problems.is_empty() => Ok(Loaded { config, projectors, editor, suspicions }),
        Ok(_) => Err(Problems(problems)),
        Err(of_scene) => {
            problems.extend(of_scene.into_iter().map(|p| problem(&config, file, &p.at, p.field, &p.message)));
            Err(Problems(problems))
        }
    }
}

/// The box around everything that a projector is to light.
pub fn props(scene: &Scene) -> Option<Props> {
    let is_prop = |node: &usize| scene.instances.iter().any(|i| i.node == *node && i.visible && i.role == Role::Prop);
    let boxes = (0..scene.nodes.len()).filter(is_prop).filter_map(|node| scene.bounds_of(node));
    let (low_m, high_m) = boxes.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
    Some(Props { low_m, high_m })
}

/// A problem of an entry of the configuration; `hint:` in the message starts the remedy.
fn problem(config: &Config, file: &str, at: &str, field: &str, message: &str) -> Problem {
    let (message, hint) = message.split_once("hint:").unwrap_or((message, "see the configuration's reference"));
    let message = message.trim_end().trim_end_matches(';');
    let (line, column) = config.places.of(&format!("{at}.{field}")).unwrap_or_default();
    Problem { file: file.to_owned(), line, column, message: format!("{at}: {message}"), hint: hint.trim().to_owned() }
}

fn calibration_problem(config: &Config, file: &str, projector: &str, error: &LoadError) -> Problem {
    let at = format!("projector {projector:?}");
    problem(config, file, &at, &format!("calibration.{}", error.key()), &error.to_string())
}

/// What is suspicious about a projector's calibration, with its place: the key that it is about, or the whole table.
pub fn suspicion(config: &Config, file: &str, projector: &str, finding: &Finding) -> Problem {
    let at = format!("projector {projector:?}");
    let of_key = config.places.of(&format!("{at}.calibration.{}", finding.key));
    let (line, column) = of_key.or_else(|| config.places.of(&format!("{at}.calibration"))).unwrap_or_default();
    let message = format!("{at}: {}", finding.message);
    Problem { file: file.to_owned(), line, column, message, hint: finding.hint.clone() }
}

/// How the configuration wants frames rendered.
pub fn settings(config: &Config) -> Settings {
    let render = &config.render;
    Settings {
        samples: render.samples,
        max_depth: render.max_depth,
        raster: match render.raster {
            lantern_config::RasterOrder::Before => RasterOrder::Before,
            lantern_config::RasterOrder::After => RasterOrder::After,
        },
        blend: render.blend,
        always_full: render.always_full,
        ..Settings::default()
    }
}

/// By projector that is carried: where its body stood when it was calibrated, m.
pub fn homes_m(bodies: &[Body]) -> BTreeMap<String, DVec3> {
    let home = |body: &Body| match &body.drives {
        Some(Drives::Projector(projector)) => Some((projector.clone(), body.position_m.into())),
        _ => None,
    };
    bodies.iter().filter_map(home).collect()
}

/// What the frame thread is to do.
pub fn setup(config: &Config, projectors: Vec<ProjectorSpec>, scene: Arc<Scene>) -> Setup {
    let output = |projector: &lantern_config::Projector| OutputSpec {
        projector: projector.name.clone(),
        size_px: projector.resolution_px,
        output: projector.output.clone(),
    };
    Setup {
        projectors,
        homes_m: homes_m(&config.bodies),
        outputs: config.projectors.iter().map(output).collect(),
        degrade: config.render.degrade,
        settings: settings(config),
        scene,
    }
}

/// Structures that were built before: beside the pipelines, or with the state of a service that has no such place.
fn structures(config: &Config) -> Arc<Structures> {
    let with_the_state = || Some(config.daemon.state_dir.as_ref()?.join("cache"));
    let folder = cache_dir().or_else(with_the_state);
    Arc::new(folder.map_or_else(Structures::default, |folder| Structures::in_folder(folder.join("structures"))))
}

/// Where pipelines are cached: beside other caches of the user, or of the system for root.
pub fn cache_dir() -> Option<PathBuf> {
    let of_user = || std::env::var_os("HOME").map(|home| PathBuf::from(home).join(".cache"));
    let base = std::env::var_os("CACHE_DIRECTORY").map(PathBuf::from).or_else(|| {
        let xdg = std::env::var_os("XDG_CACHE_HOME").map(PathBuf::from).filter(|p| p.is_absolute());
        Some(xdg.or_else(of_user)?.join("lantern"))
    })?;
    Some(base)
}
