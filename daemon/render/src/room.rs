//! The room: what an eye sees of the props under all projectors' light, through their own calibrations.

use std::sync::Arc;

use glam::dcamera::rh::{proj, view};
use glam::{DMat4, DVec2, DVec3, UVec2};
use lantern_calibration::{Calibration, CalibrationError, Convention, Frustum, GpuFrustum};
use lantern_gpu::{Buffer, BufferKind, Device, Recorder};
use lantern_scene::{PRIMARY_ROLES, Role, Scene};

use crate::RenderError;
use crate::catalogue::Catalogue;
use crate::frame::{FrameBlocks, GpuFrame, GpuSetup};
use crate::jitter::sample_state;
use crate::pipelines::Pipelines;
use crate::readback::{LayerImage, Texels, read_words};
use crate::record;
use crate::settings::Settings;
use crate::targets::COUNTER_WORDS;

/// Whose light, on what.
pub(crate) struct View<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) settings: &'a Settings,
    /// First texel of the environment.
    pub(crate) environment_first: u32,
    /// Where each projector's rays leave, in order.
    pub(crate) frusta: Vec<Frustum>,
    /// What each shows.
    pub(crate) pictures: Vec<Arc<Buffer>>,
}

/// Renders the view from `eye` toward what the projectors light, as wide as that is.
pub(crate) fn render(
    device: &Arc<Device>,
    pipelines: &Pipelines,
    shared: &Catalogue,
    view: &View<'_>,
    eye: DVec3,
    size_px: [u32; 2],
) -> Result<LayerImage, RenderError> {
    let camera = look_at(eye, &subject(view), size_px)?;
    let frustum = GpuFrustum::new(&Frustum::new(camera), view.scene.origin_m);
    let setup = GpuSetup {
        environment_first: view.environment_first,
        ..GpuSetup::new(view.scene, &[eye], view.settings, (0, view.pictures.len()))
    };

    let pixels = u64::from(size_px[0]) * u64::from(size_px[1]);
    let frame = FrameBlocks::new(device, "room")?;
    let state = Buffer::new(device, "room/sample state", BufferKind::Storage, u64::from(view.settings.samples) * 4)?;
    let counters = Buffer::new(device, "room/counters", BufferKind::Storage, COUNTER_WORDS * 4)?;
    let records = record::buffer(device, "room", false)?;
    let seen = Buffer::new(device, "room/seen", BufferKind::Storage, pixels * 16)?;
    frame.write(&GpuFrame::new(frustum, view.scene, &[eye]), &setup)?;

    // Each projector adds its light to each sample of each of the eye's pixels.
    let mut recorder = Recorder::new(device, 0, "room")?;
    recorder.upload(&state, 0, bytemuck::cast_slice(&sample_state("room", view.settings.samples)))?;
    recorder.fill(&seen, 0)?;
    recorder.fill(&counters, 0)?;
    for (index, picture) in view.pictures.iter().enumerate() {
        let bindings = frame
            .list(shared.clone())
            .with_buffer("SampleState", &state)
            .with_buffer("Counters", &counters)
            .with_buffer("Records", &records)
            .with_buffer("Color", picture)
            .with_buffer("Room", &seen)
            .bind(&*pipelines.room)?;
        for sample in 0..view.settings.samples {
            let push = [sample, index as u32];
            let groups = [size_px[0].div_ceil(8), size_px[1].div_ceil(8), 1];
            recorder.dispatch(&pipelines.room, &bindings, bytemuck::bytes_of(&push), groups)?;
        }
    }
    device.submit(recorder.finish()?, &[])?.wait(device.hung_after())?;
    let words = read_words(device, &seen)?;
    let rgb = |c: &[u32]| [f32::from_bits(c[0]), f32::from_bits(c[1]), f32::from_bits(c[2])];
    Ok(LayerImage {
        width: size_px[0],
        height: size_px[1],
        texels: Texels::Rgb(words.chunks_exact(4).map(rgb).collect()),
    })
}

/// Columns and rows of the rays by which a projector's lit points are found.
const GRID: [u32; 2] = [24, 16];

/// What to look at: points that projectors light, m; the corners of the props where none is lit, and of the world's middle where there
/// is no prop either.
fn subject(view: &View<'_>) -> Vec<DVec3> {
    let mut lit = Vec::new();
    for frustum in &view.frusta {
        let size_px = frustum.calibration().resolution_px().as_dvec2();
        for place in (0..GRID[0]).flat_map(|x| (0..GRID[1]).map(move |y| DVec2::new(f64::from(x), f64::from(y)) + 0.5))
        {
            let place_px = place / DVec2::new(f64::from(GRID[0]), f64::from(GRID[1])) * size_px;
            let Some(ray) = frustum.ray(place_px) else { continue };
            let hit = view.scene.cast(ray.origin_m, ray.direction, 0.0, ray.t_max_m, PRIMARY_ROLES);
            lit.extend(hit.map(|h| ray.origin_m + ray.direction * h.t));
        }
    }
    if !lit.is_empty() {
        return lit;
    }
    let physical = |i: &&lantern_scene::Instance| i.visible && matches!(i.role, Role::Prop | Role::Mask);
    let boxes = view.scene.instances.iter().filter(physical).filter_map(|i| view.scene.bounds_of(i.node));
    let props: Vec<_> = boxes.flat_map(|(low, high)| corners(low, high)).collect();
    if props.is_empty() { corners(DVec3::splat(-1.0), DVec3::splat(1.0)).into() } else { props }
}

fn corners(low: DVec3, high: DVec3) -> [DVec3; 8] {
    std::array::from_fn(|i| {
        let pick = |axis: usize| if i >> axis & 1 == 0 { low[axis] } else { high[axis] };
        DVec3::new(pick(0), pick(1), pick(2))
    })
}

/// A camera at `eye` that sees all of these points, of which there is at least one, with a little room around them.
fn look_at(eye: DVec3, points: &[DVec3], size_px: [u32; 2]) -> Result<Calibration, CalibrationError> {
    let low = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let middle = (low + high) * 0.5;
    let radius = ((high - low).length() * 0.5).max(1e-3);
    let distance = (eye - middle).length().max(1e-3);
    let forward = (middle - eye).normalize_or(DVec3::NEG_Z);
    let up = if forward.y.abs() > 0.999 { DVec3::NEG_Z } else { DVec3::Y };
    let eye_from_world = view::look_to_mat4(eye, forward, up);

    // The smallest field of view that holds them; an eye among the props gets a wide one.
    let aspect = f64::from(size_px[0]) / f64::from(size_px[1]);
    let mut tangent = 0.02_f64;
    for point in points {
        let at = eye_from_world.transform_point3(*point);
        let ahead = (-at.z).max(1e-6);
        tangent = tangent.max(at.y.abs() / ahead).max(at.x.abs() / ahead / aspect);
    }
    let vertical_fov = 2.0 * (tangent * 1.08).min(1.2).atan();
    let near = (distance - 2.0 * radius).max(distance * 0.02);
    let clip_from_eye = proj::opengl::perspective(vertical_fov, aspect, near, distance + radius * 4.0);
    let rows = |m: DMat4| m.transpose().to_cols_array_2d();
    Calibration::from_matrices(&rows(clip_from_eye), &rows(eye_from_world), Convention::OpenGl, UVec2::from(size_px))
}
