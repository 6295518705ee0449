//! The room: what an eye sees of the props under all projectors' light, through their own calibrations.

use std::sync::Arc;

use glam::dcamera::rh::{proj, view};
use glam::{DMat4, DVec3, UVec2};
use lantern_calibration::{Calibration, CalibrationError, Convention, Frustum, GpuFrustum};
use lantern_gpu::{Buffer, BufferKind, Device, Recorder};
use lantern_scene::{Role, Scene};

use crate::catalogue::Catalogue;
use crate::frame::GpuFrame;
use crate::jitter::sample_state;
use crate::pipelines::Pipelines;
use crate::readback::{LayerImage, Texels, read_words};
use crate::settings::{HUNG_AFTER, Settings};
use crate::targets::COUNTER_WORDS;
use crate::{RenderError, shaders};

/// Whose light, on what.
pub(crate) struct View<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) settings: &'a Settings,
    /// What each projector shows, in order.
    pub(crate) pictures: Vec<Arc<Buffer>>,
}

/// Renders the view from `eye` toward the middle of the props, as wide as they are.
pub(crate) fn render(
    device: &Arc<Device>,
    pipelines: &Pipelines,
    shared: &Catalogue,
    view: &View<'_>,
    eye: DVec3,
    size_px: [u32; 2],
) -> Result<LayerImage, RenderError> {
    let (low, high) = props_bounds(view.scene);
    let camera = look_at(eye, low, high, size_px)?;
    let frustum = GpuFrustum::new(&Frustum::new(camera), view.scene.origin_m);
    let frame = GpuFrame::new(frustum, view.scene, &[eye], view.settings, (0, view.pictures.len()));

    let pixels = u64::from(size_px[0]) * u64::from(size_px[1]);
    let frame_buffer = Buffer::new(device, "room/frame", BufferKind::Uniform, size_of::<GpuFrame>() as u64)?;
    let state = Buffer::new(device, "room/sample state", BufferKind::Storage, u64::from(view.settings.samples) * 4)?;
    let counters = Buffer::new(device, "room/counters", BufferKind::Storage, COUNTER_WORDS * 4)?;
    let seen = Buffer::new(device, "room/seen", BufferKind::Storage, pixels * 16)?;
    frame_buffer.write(0, bytemuck::bytes_of(&frame))?;

    // Each projector adds its light to each sample of each of the eye's pixels.
    let mut recorder = Recorder::new(device, 0, "room")?;
    recorder.upload(&state, 0, bytemuck::cast_slice(&sample_state("room", view.settings.samples)))?;
    recorder.fill(&seen, 0)?;
    recorder.fill(&counters, 0)?;
    for (index, picture) in view.pictures.iter().enumerate() {
        let bindings = shared
            .clone()
            .with_buffer("Frame", &frame_buffer)
            .with_buffer("SampleState", &state)
            .with_buffer("Counters", &counters)
            .with_buffer("Color", picture)
            .with_buffer("Room", &seen)
            .bind(&*pipelines.room, &[&shaders::ROOM_COMP])?;
        for sample in 0..view.settings.samples {
            let push = [sample, index as u32];
            let groups = [size_px[0].div_ceil(8), size_px[1].div_ceil(8), 1];
            recorder.dispatch(&pipelines.room, &bindings, bytemuck::bytes_of(&push), groups)?;
        }
    }
    device.submit(recorder.finish()?, &[])?.wait(HUNG_AFTER)?;
    let words = read_words(device, &seen)?;
    let rgb = |c: &[u32]| [f32::from_bits(c[0]), f32::from_bits(c[1]), f32::from_bits(c[2])];
    Ok(LayerImage {
        width: size_px[0],
        height: size_px[1],
        texels: Texels::Rgb(words.chunks_exact(4).map(rgb).collect()),
    })
}

/// The box around what stands physically in the room, m; around the origin where nothing does.
fn props_bounds(scene: &Scene) -> (DVec3, DVec3) {
    let physical = |i: &&lantern_scene::Instance| i.visible && matches!(i.role, Role::Prop | Role::Mask);
    let boxes = scene.instances.iter().filter(physical).filter_map(|i| scene.bounds_of(i.node));
    boxes.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or((DVec3::splat(-1.0), DVec3::splat(1.0)))
}

/// A camera at `eye` that looks at the middle of a box and sees all of it.
fn look_at(eye: DVec3, low: DVec3, high: DVec3, size_px: [u32; 2]) -> Result<Calibration, CalibrationError> {
    let middle = (low + high) * 0.5;
    let radius = (high - low).length() * 0.5;
    let distance = (eye - middle).length().max(1e-3);
    let forward = (middle - eye).normalize_or(DVec3::NEG_Z);
    let up = if forward.y.abs() > 0.999 { DVec3::NEG_Z } else { DVec3::Y };
    let eye_from_world = view::look_to_mat4(eye, forward, up);

    // The smallest field of view that holds the corners in front of the eye; an eye among the props gets a wide one.
    let aspect = f64::from(size_px[0]) / f64::from(size_px[1]);
    let mut tangent = 0.02_f64;
    for corner in 0..8 {
        let pick = |axis: usize| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] };
        let at = eye_from_world.transform_point3(DVec3::new(pick(0), pick(1), pick(2)));
        let ahead = (-at.z).max(1e-6);
        tangent = tangent.max(at.y.abs() / ahead).max(at.x.abs() / ahead / aspect);
    }
    let vertical_fov = 2.0 * tangent.min(1.2).atan();
    let near = (distance - radius).max(distance * 0.02);
    let clip_from_eye = proj::opengl::perspective(vertical_fov, aspect, near, distance + radius * 2.0);
    let rows = |m: DMat4| m.transpose().to_cols_array_2d();
    Calibration::from_matrices(&rows(clip_from_eye), &rows(eye_from_world), Convention::OpenGl, UVec2::from(size_px))
}
