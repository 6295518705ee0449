//! `lanternd bench`: times stages as CONTRACT, Bench, says.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;

use comfy_table::{Table, presets};
use glam::DVec3;
use hdrhistogram::Histogram;
use lantern_gpu::{Device, Work};
use lantern_render::stale::Stale;
use lantern_render::{ProjectorReport, RayCounts, Renderer, Settings, Span};
use lantern_scene::{Editor, Role};
use serde_json::{Value, json};

use super::dump;
use super::progress::Progress;
use crate::service::setup::{self, Loaded};
use crate::service::vulkan::{open_device, open_vulkan};

/// Longest frame that a histogram tells apart, µs.
const LONGEST_US: u64 = 600_000_000;

/// Frames before the ones that count.
const WARM_UP: u32 = 2;

/// What changes from frame to frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Case {
    /// Nothing.
    Static,
    /// The eye.
    Viewer,
    /// One prop.
    Node,
    /// Everything is traced anew.
    Full,
}

impl Case {
    const ALL: [Self; 4] = [Self::Static, Self::Viewer, Self::Node, Self::Full];

    fn name(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Viewer => "viewer",
            Self::Node => "node",
            Self::Full => "full",
        }
    }
}

/// One projector's times in a case, µs.
struct Times {
    frame: Histogram<u64>,
    stages: BTreeMap<&'static str, Histogram<u64>>,
    rays: RayCounts,
    /// Of the projector alone.
    gpu_bytes: u64,
    /// When the passes of the last frame ran.
    timeline: Vec<Span>,
}

/// What was measured in a case.
struct Measured {
    projectors: BTreeMap<String, Times>,
    /// What one frame of the case submits, of all projectors and the scene together.
    work: Work,
}

fn histogram() -> Histogram<u64> {
    #[expect(clippy::unwrap_used, reason = "the bounds are constants that the histogram takes")]
    Histogram::new_with_bounds(1, LONGEST_US, 3).unwrap()
}

/// What to time.
#[derive(Clone, Debug)]
pub struct Options {
    /// The configuration; the demo's where it is absent.
    pub config: Option<PathBuf>,
    /// Frames of each case.
    pub frames: u32,
    /// Which cases, by name; all where it is empty.
    pub cases: Vec<Case>,
    /// Where to write rays and hits for another tracer.
    pub dump: Option<PathBuf>,
    /// For programs.
    pub json: bool,
}

/// Times frames of each case and prints them.
///
/// # Errors
/// A bad configuration, no Vulkan, or a dump that cannot be written.
pub fn bench(options: &Options) -> anyhow::Result<()> {
    let frames = options.frames;
    let chosen: Vec<Case> =
        Case::ALL.into_iter().filter(|case| options.cases.is_empty() || options.cases.contains(case)).collect();
    let mut loaded = match &options.config {
        Some(path) => setup::load(path)?,
        None => setup::from_config(super::demo::config()?, "config/demo.toml")?,
    };
    let device = open_device(&open_vulkan()?, &loaded.config)?;
    let settings = setup::settings(&loaded.config);

    // Where the configuration has the viewer, or before the scene where it has none.
    let viewer = loaded.config.viewer().map(|body| DVec3::from(body.position_m) + DVec3::from(body.offset_m));
    let viewer = viewer.unwrap_or(DVec3::new(0.0, 1.6, 2.2));

    // Rays are counted in a run of their own: counting costs time.
    let mut cases = Cases::new();
    let mut gpu_bytes = 0;
    let progress = Progress::new(2 * chosen.len() as u64);
    for counting in [true, false] {
        let settings = Settings { count_rays: counting, ..settings };
        let mut renderer = Renderer::new(&device, loaded.projectors.clone(), settings, loaded.editor.current())?;
        for &case in &chosen {
            let frames = if counting { 1 } else { frames };
            progress.step(&format!("{}: {}", case.name(), if counting { "counting rays" } else { "timing" }));
            let mut measured = run_case(&mut renderer, &mut loaded.editor, viewer, case, frames)?;
            if let Some(counted) = cases.get(case.name()) {
                for (projector, times) in &mut measured.projectors {
                    times.rays = counted.projectors.get(projector).map_or(times.rays, |c| c.rays);
                }
            }
            cases.insert(case.name(), measured);
        }
        gpu_bytes = device.allocated_bytes();
    }
    progress.finish();
    let dumped = match &options.dump {
        Some(folder) => Some(dump::dump(&device, &loaded, settings, viewer, folder)?),
        None => None,
    };
    let done = Done { device: &device, loaded: &loaded, settings: &settings, cases: &cases, frames, gpu_bytes, dumped };
    if options.json {
        say!("{}", serde_json::to_string_pretty(&to_json(&done))?);
    } else {
        say!("{}", to_text(&done));
    }
    Ok(())
}

fn run_case(
    renderer: &mut Renderer,
    editor: &mut Editor,
    viewer: DVec3,
    case: Case,
    frames: u32,
) -> anyhow::Result<Measured> {
    let names: Vec<String> = renderer.projectors().map(|p| p.name.clone()).collect();
    let nothing = |gpu_bytes| Times {
        frame: histogram(),
        stages: BTreeMap::new(),
        rays: RayCounts::default(),
        gpu_bytes,
        timeline: Vec::new(),
    };
    let mut all: BTreeMap<String, Times> =
        names.iter().zip(renderer.projector_bytes()).map(|(n, bytes)| (n.clone(), nothing(bytes))).collect();
    // One prop moves; a scene without any has none to move.
    let prop = renderer
        .scene()
        .nodes
        .iter()
        .rev()
        .find(|n| n.role == Role::Prop)
        .map(|n| (n.name.clone(), n.translation_m, n.rotation));
    let mut eye = viewer;
    let mut work = Work::default();
    for frame in 0..WARM_UP + frames {
        let phase = f64::from(frame) * 0.7;
        match case {
            Case::Static => {}
            Case::Viewer => eye = viewer + DVec3::new(0.3 * phase.sin(), 0.1 * phase.cos(), 0.0),
            Case::Node => {
                if let Some((name, translation, rotation)) = &prop {
                    let moved = *translation + DVec3::new(0.01 * phase.sin(), 0.0, 0.01 * phase.cos());
                    renderer.set_scene(editor.place(name, moved, *rotation)?);
                }
            }
            Case::Full => renderer.make_stale(Stale::EVERYTHING),
        }
        let (start, before) = (std::time::Instant::now(), renderer.device().work());
        let report = renderer.render(|| vec![eye])?;
        let took = start.elapsed().as_micros() as u64;
        let after = renderer.device().work();
        work = Work {
            submissions: after.submissions - before.submissions,
            dispatches: after.dispatches - before.dispatches,
            barriers: after.barriers - before.barriers,
        };
        if frame < WARM_UP {
            continue;
        }
        match report {
            Some(report) => {
                for p in &report.projectors {
                    if let Some(times) = all.get_mut(&names[p.projector]) {
                        add(times, p);
                    }
                }
            }
            None => all.values_mut().for_each(|t| t.frame.saturating_record(took.max(1))),
        }
    }
    if let Some((name, translation, rotation)) = &prop {
        renderer.set_scene(editor.place(name, *translation, *rotation)?);
    }
    Ok(Measured { projectors: all, work })
}

fn add(times: &mut Times, report: &ProjectorReport) {
    times.frame.saturating_record(((report.frame_ms * 1e3) as u64).max(1));
    for (stage, ms) in &report.stages_ms {
        times.stages.entry(stage).or_insert_with(histogram).saturating_record(((ms * 1e3) as u64).max(1));
    }
    times.rays = report.rays.unwrap_or(times.rays);
    times.timeline.clone_from(&report.timeline);
}

fn ms(histogram: &Histogram<u64>, quantile: f64) -> f64 {
    histogram.value_at_quantile(quantile) as f64 / 1e3
}

/// Rays of a kind and the stage that traces them.
fn kinds(rays: &RayCounts) -> [(&'static str, u32, &'static [&'static str]); 4] {
    [
        ("primary", rays.primary, &["primary"]),
        ("secondary", rays.secondary, &["secondary"]),
        ("shadow", rays.shadow, &["light", "secondary"]),
        ("blend", rays.blend, &["blend"]),
    ]
}

/// Millions of rays a second: those of a kind over the time of the stages that trace them, other kinds' included.
fn mray_s(times: &Times, count: u32, stages: &[&str]) -> Option<f64> {
    let spent: f64 = stages.iter().filter_map(|s| times.stages.get(s)).map(|h| ms(h, 0.5)).sum();
    (spent > 0.0 && count > 0).then(|| f64::from(count) / spent / 1e3)
}

type Cases = BTreeMap<&'static str, Measured>;

/// What was timed, and on what.
struct Done<'a> {
    device: &'a Arc<Device>,
    loaded: &'a Loaded,
    settings: &'a Settings,
    cases: &'a Cases,
    frames: u32,
    /// Of the scene and all projectors together.
    gpu_bytes: u64,
    /// What `dump.json` says, where there is a dump.
    dumped: Option<Value>,
}

fn to_json(done: &Done<'_>) -> Value {
    let Done { device, loaded, settings, cases, frames, gpu_bytes, .. } = *done;
    let percentiles = |h: &Histogram<u64>| json!({ "p50": ms(h, 0.5), "p95": ms(h, 0.95) });
    // A stage that a case leaves out took no time in it.
    let stages: BTreeSet<&str> =
        cases.values().flat_map(|case| case.projectors.values()).flat_map(|t| t.stages.keys().copied()).collect();
    let nothing = json!({ "p50": 0.0, "p95": 0.0 });
    let of_projector = |times: &Times| {
        let of_stage = |stage| times.stages.get(stage).map_or_else(|| nothing.clone(), percentiles);
        let stages: BTreeMap<_, _> = stages.iter().map(|stage| (*stage, of_stage(*stage))).collect();
        let rays: BTreeMap<_, _> = kinds(&times.rays).into_iter().map(|(k, n, _)| (k, n)).collect();
        let speed: BTreeMap<_, _> =
            kinds(&times.rays).into_iter().filter_map(|(k, n, s)| Some((k, mray_s(times, n, s)?))).collect();
        let span = |s: &Span| json!({ "pass": s.pass, "start_ms": s.start_ms, "end_ms": s.end_ms });
        let timeline: Vec<_> = times.timeline.iter().map(span).collect();
        json!({
            "frame_ms": percentiles(&times.frame), "stages_ms": stages, "rays": rays, "mray_s": speed,
            "gpu_bytes": times.gpu_bytes, "timeline": timeline,
        })
    };
    let of_case = |case: &Measured| {
        let all: BTreeMap<_, _> = case.projectors.iter().map(|(name, t)| (name, of_projector(t))).collect();
        let Work { submissions, dispatches, barriers } = case.work;
        let work = json!({ "submissions": submissions, "dispatches": dispatches, "barriers": barriers });
        json!({ "projectors": all, "gpu_bytes": gpu_bytes, "work": work })
    };
    let scene = loaded.editor.current();
    let resolutions: BTreeMap<_, _> =
        loaded.projectors.iter().map(|p| (&p.name, p.calibration.resolution_px().to_array())).collect();
    let mut told = json!({
        "device": { "name": device.info().name, "driver": device.info().driver_info, "kind": device.info().kind },
        "scene": { "nodes": scene.nodes.len(), "triangles": scene.triangle_count(), "bytes": scene.device_bytes() },
        "resolution_px": resolutions,
        "samples": settings.samples,
        "max_depth": settings.max_depth,
        "frames": frames,
        "gpu_bytes": gpu_bytes,
        "cases": cases.iter().map(|(case, p)| (*case, of_case(p))).collect::<BTreeMap<_, _>>(),
    });
    if let Some(dumped) = &done.dumped {
        told["dump"] = dumped.clone();
    }
    told
}

fn to_text(done: &Done<'_>) -> String {
    let Done { device, loaded, settings, cases, frames, gpu_bytes, .. } = *done;
    let scene = loaded.editor.current();
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_header(["case", "projector", "frame ms p50", "p95", "stages ms p50", "rays", "Mray/s"]);
    for case in Case::ALL {
        for (projector, times) in cases.get(case.name()).into_iter().flat_map(|c| &c.projectors) {
            let stages: Vec<_> = times.stages.iter().map(|(s, h)| format!("{s} {:.2}", ms(h, 0.5))).collect();
            let counted: Vec<_> = kinds(&times.rays).into_iter().filter(|(_, n, _)| *n > 0).collect();
            let rays: Vec<_> = counted.iter().map(|(k, n, _)| format!("{k} {n}")).collect();
            let speed: Vec<_> =
                counted.iter().filter_map(|(k, n, s)| Some(format!("{k} {:.2}", mray_s(times, *n, s)?))).collect();
            table.add_row([
                case.name().to_owned(),
                projector.clone(),
                format!("{:.3}", ms(&times.frame, 0.5)),
                format!("{:.3}", ms(&times.frame, 0.95)),
                stages.join("\n"),
                rays.join("\n"),
                speed.join("\n"),
            ]);
        }
    }
    format!(
        "{} ({}); {} nodes, {} triangles; {} samples a pixel; {frames} frames a case; {:.1} MiB of GPU memory\n{table}",
        device.info().name,
        device.info().driver_info,
        scene.nodes.len(),
        scene.triangle_count(),
        settings.samples,
        gpu_bytes as f64 / f64::from(1 << 20),
    )
}
