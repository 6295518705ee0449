//! `lanternd check`: loads everything, renders nothing, and says in words what each projector sees.

use std::path::Path;

use glam::DVec2;
use lantern_calibration::Frustum;
use lantern_calibration::describe::Description;
use lantern_calibration::doctor::{Ailment, Finding, nothing_in_view};
use lantern_config::{Drives, Problem};
use lantern_render::ProjectorSpec;
use lantern_scene::pack::{ROLE_MASK, ROLE_PROP};
use lantern_scene::{Role, Scene};
use serde_json::{Value, json};

use crate::service::setup::{self, Loaded, Problems};

/// Columns at most of the grid of rays by which the share of pixels that hit a prop is estimated; a narrower image has a ray
/// for each of its pixels.
const GRID: u32 = 320;

/// Prints what a configuration amounts to. True when nothing is wrong with it.
///
/// # Errors
/// When the result cannot be printed.
pub fn check(path: &Path, as_json: bool) -> anyhow::Result<bool> {
    match setup::load(path) {
        Ok(loaded) => {
            let projectors = see_all(&loaded);
            if as_json {
                say!("{}", serde_json::to_string_pretty(&to_json(path, &loaded, &projectors))?);
            } else {
                print_text(path, &loaded, &projectors);
            }
            Ok(true)
        }
        Err(Problems(problems)) => {
            if as_json {
                let all: Vec<Value> = problems
                    .iter()
                    .map(|p| {
                        let (file, line, column) = (&p.file, p.line, p.column);
                        json!({ "severity": "error", "file": file, "line": line, "column": column, "message": p.message, "hint": p.hint })
                    })
                    .collect();
                say!("{}", serde_json::to_string_pretty(&json!({ "ok": false, "problems": all }))?);
            } else {
                for problem in &problems {
                    eprintln!("{problem}");
                }
            }
            Ok(false)
        }
    }
}

/// What one projector sees.
struct Seen {
    name: String,
    description: Description,
    /// Of its pixels that hit a prop, 0 to 1.
    on_props: f64,
    /// Of its pixels that hit a mask.
    on_masks: f64,
    /// What is suspicious.
    findings: Vec<Finding>,
}

/// What every projector sees, and what is suspicious about it. Rays tell better than boxes whether a prop is in view.
fn see_all(loaded: &Loaded) -> Vec<Seen> {
    let scene = loaded.editor.current();
    let props = setup::props(&scene);
    // What is rasterised is drawn whether or not a ray meets anything.
    let shows_raster = scene.instances.iter().any(|i| i.visible && i.role == Role::Raster);
    let of_all = loaded.config.projectors.iter().zip(&loaded.projectors);
    of_all
        .map(|(configured, spec)| {
            let mut seen = see(spec, &scene);
            let of_it = loaded.suspicions.iter().filter(|(name, _)| *name == spec.name);
            seen.findings.extend(of_it.map(|(_, finding)| finding.clone()));
            // Rays know better than the corners of the props' box, which a lens may bend into the image.
            seen.findings.retain(|finding| seen.on_props == 0.0 || finding.ailment != Ailment::NothingInView);
            if seen.on_props == 0.0 && !shows_raster && !seen.findings.iter().any(explains_darkness) {
                seen.findings.push(nothing_in_view(&configured.calibration, &spec.calibration, props.as_ref()));
            }
            seen
        })
        .collect()
}

fn explains_darkness(finding: &Finding) -> bool {
    matches!(finding.ailment, Ailment::NothingInView | Ailment::NearPlaneBehindProps | Ailment::WrongUnits)
}

fn see(projector: &ProjectorSpec, scene: &Scene) -> Seen {
    let frustum = Frustum::new(projector.calibration.clone());
    let resolution_px = projector.calibration.resolution_px();
    let size_px = resolution_px.as_dvec2();
    let columns = GRID.min(resolution_px.x);
    let rows = ((f64::from(columns) * size_px.y / size_px.x).round() as u32).max(1);
    let (mut props, mut masks) = (0_u32, 0_u32);
    for row in 0..rows {
        for column in 0..columns {
            let place = DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5);
            let place_px = place / DVec2::new(f64::from(columns), f64::from(rows)) * size_px;
            let Some(ray) = frustum.ray(place_px) else { continue };
            let hit = scene.cast(ray.origin_m, ray.direction, 0.0, ray.t_max_m, ROLE_PROP | ROLE_MASK);
            let role = hit.map(|h| lantern_scene::role_bit(scene.instances[h.instance].role));
            props += u32::from(role == Some(ROLE_PROP));
            masks += u32::from(role == Some(ROLE_MASK));
        }
    }
    let all = f64::from(columns * rows);
    Seen {
        name: projector.name.clone(),
        description: Description::of(&frustum),
        on_props: f64::from(props) / all,
        on_masks: f64::from(masks) / all,
        findings: Vec::new(),
    }
}

fn to_json(path: &Path, loaded: &Loaded, projectors: &[Seen]) -> Value {
    let scene = loaded.editor.current();
    let counts = loaded.editor.structures().counts();
    let of_projector = |seen: &Seen| {
        let d = &seen.description;
        let middle = d.middle.as_ref();
        json!({
            "name": seen.name,
            "carried_by": carrier(loaded, &seen.name),
            "resolution_px": d.resolution_px.to_array(),
            "position_m": d.position_m.map(|p| p.to_array()),
            "direction": middle.map(|m| m.direction.to_array()),
            "field_of_view_deg": d.field_of_view_rad.map(|f| [f.x.to_degrees(), f.y.to_degrees()]),
            "lens_shift": d.lens_shift.map(|s| s.to_array()),
            "mirrored": middle.map(|m| m.mirrored),
            "near_m": middle.map(|m| m.near_m),
            "far_m": middle.map(|m| m.far_m).filter(|m| m.is_finite()),
            "share_on_props": seen.on_props,
            "share_on_masks": seen.on_masks,
            "findings": seen.findings.iter().map(|f| finding(path, loaded, seen, f)).collect::<Vec<_>>(),
        })
    };
    json!({
        "ok": true,
        "problems": [],
        "file": path.display().to_string(),
        "scene": { "nodes": scene.nodes.len(), "triangles": scene.triangle_count(), "bytes": scene.device_bytes() },
        "structures": { "built": counts.built, "cached": counts.cached },
        "warnings": warnings(path, loaded, projectors),
        "projectors": projectors.iter().map(of_projector).collect::<Vec<_>>(),
    })
}

fn finding(path: &Path, loaded: &Loaded, seen: &Seen, finding: &Finding) -> Value {
    let Finding { ailment, message, hint, .. } = finding;
    let Problem { file, line, column, .. } = placed(path, loaded, seen, finding);
    json!({
        "severity": "warning", "kind": ailment.as_str(), "file": file, "line": line, "column": column,
        "message": message, "hint": hint,
    })
}

/// A finding where the configuration's text has what it is about.
fn placed(path: &Path, loaded: &Loaded, seen: &Seen, finding: &Finding) -> Problem {
    setup::suspicion(&loaded.config, &path.display().to_string(), &seen.name, finding)
}

fn print_text(path: &Path, loaded: &Loaded, projectors: &[Seen]) {
    let scene = loaded.editor.current();
    say!(
        "{}: good. {} nodes, {} triangles, {:.1} MiB on the device.",
        path.display(),
        scene.nodes.len(),
        scene.triangle_count(),
        scene.device_bytes() as f64 / f64::from(1 << 20)
    );
    for seen in projectors {
        say!("\nprojector {:?}\n{}", seen.name, seen.description);
        if let Some(body) = carrier(loaded, &seen.name) {
            say!("carried by the body {body:?}: this is where it stands until that body moves");
        }
        say!("{:.1} % of its pixels hit a prop, {:.1} % a mask.", seen.on_props * 100.0, seen.on_masks * 100.0);
    }
    for warning in warnings(path, loaded, projectors) {
        say!("\nwarning: {warning}");
    }
}

/// The body that carries a projector.
fn carrier<'a>(loaded: &'a Loaded, projector: &str) -> Option<&'a str> {
    let carries = |drives: &Drives| matches!(drives, Drives::Projector(name) if name == projector);
    loaded.config.bodies.iter().find(|body| body.drives.as_ref().is_some_and(carries)).map(|body| body.name.as_str())
}

/// What works and is still worth a look.
fn warnings(path: &Path, loaded: &Loaded, projectors: &[Seen]) -> Vec<String> {
    let scene = loaded.editor.current();
    let no_folder = loaded.config.daemon.asset_roots.iter().filter(|root| !root.is_dir()).map(|root| {
        format!("daemon.asset_roots: {} is no folder, so no client can have a file from it\nhint: make it, or remove it there", root.display())
    });
    let of_projector = |seen: &Seen| -> Vec<String> {
        seen.findings.iter().map(|finding| placed(path, loaded, seen, finding).to_string()).collect()
    };
    let suspicious = projectors.iter().flat_map(of_projector);
    let of_files = scene.nodes.iter().flat_map(|n| n.warnings().iter().map(move |w| format!("node {:?}: {w}", n.name)));
    suspicious.chain(no_folder).chain(of_files).collect()
}
