//! The rays of a frame, written down: what `bench --dump` gives another tracer to be measured on.
//!
//! A buffer holds but so many rays, and a frame has more. So each frame keeps those of one kind and of one part, by a hash of their
//! bits; the rays of a frame that is rendered again are the same to the bit, and so the parts add up to the whole.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use lantern_gpu::{Buffer, BufferKind, Device, GpuError, Recorder};

/// Kinds of rays, by what they can meet and what ends them (CONTRACT, Roles). Twins of the `RAY_` constants in
/// `shaders-glsl/include/record.glsl`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum RayKind {
    /// From the projector: the nearest physical thing.
    Primary,
    /// From the eye's line of sight on: the nearest thing.
    Secondary,
    /// From the eye: the nearest virtual thing before a point.
    Virtual,
    /// Toward lights: anything.
    Shadow,
    /// Toward other projectors: any physical thing.
    Blend,
}

impl RayKind {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; 5] = [Self::Primary, Self::Secondary, Self::Virtual, Self::Shadow, Self::Blend];

    /// Its name in a dump.
    pub fn name(self) -> &'static str {
        match self {
            Self::Primary => "primary",
            Self::Secondary => "secondary",
            Self::Virtual => "virtual",
            Self::Shadow => "shadow",
            Self::Blend => "blend",
        }
    }

    /// Whether it looks for the nearest hit; else any ends it.
    pub fn is_closest(self) -> bool {
        self < Self::Shadow
    }
}

/// One ray and what it found. Twin of the struct of the same name in `shaders-glsl/include/record.glsl`; 56 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct RecordedRay {
    /// World, m, relative to the scene's origin.
    pub origin: [f32; 3],
    /// m, with a direction of unit length.
    pub t_min: f32,
    /// World.
    pub direction: [f32; 3],
    /// m.
    pub t_max: f32,
    /// m; +inf for a miss.
    pub t: f32,
    /// Index into [`lantern_scene::Scene::instances`]; 2³² − 1 for a miss.
    pub instance: u32,
    /// The mesh's own number.
    pub triangle: u32,
    /// Row times width, plus column.
    pub pixel: u32,
    /// Which of the pixel's samples.
    pub sample_index: u32,
    /// Which of the sample's rays in its pass.
    pub turn: u32,
}

/// What stands before the rays in `Records`; 40 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct RecordHead {
    /// Rays of this [`RayKind`] are kept.
    pub wanted_kind: u32,
    /// Of these, one part,
    pub wanted_part: u32,
    /// out of so many; at least 1.
    pub part_count: u32,
    /// Rays that the buffer holds.
    pub record_room: u32,
    /// Rays that were to be kept, also those for which there was no room.
    pub records_kept: u32,
    /// Rays by kind, kept or not.
    pub rays_traced: [u32; RayKind::ALL.len()],
}

/// What one projector's rays were.
#[derive(Clone, Debug, PartialEq)]
pub struct Recorded {
    /// Rays of the frame by [`RayKind`], kept or not.
    pub traced: [u32; RayKind::ALL.len()],
    /// Rays that were to be kept; the list has fewer where the buffer had no room.
    pub wanted: u32,
    /// Those kept, in no order.
    pub rays: Vec<RecordedRay>,
}

const HEAD_BYTES: u64 = size_of::<RecordHead>() as u64;
const RAY_BYTES: u64 = size_of::<RecordedRay>() as u64;

/// The largest buffer, however much more a device would bind.
const MOST_BYTES: u64 = 128 << 20;

/// A buffer for rays: where none are recorded, one that holds a head to bind.
pub(crate) fn buffer(device: &Arc<Device>, name: &str, recording: bool) -> Result<Arc<Buffer>, GpuError> {
    let bytes = if recording { device.limits().max_storage_buffer_bytes.min(MOST_BYTES) } else { 0 };
    Buffer::new(device, &format!("{name}/records"), BufferKind::Storage, bytes.max(HEAD_BYTES + RAY_BYTES))
}

/// Empties a buffer, and says what of the next frame it is to keep.
pub(crate) fn begin(
    device: &Arc<Device>,
    buffer: &Arc<Buffer>,
    kind: RayKind,
    part: u32,
    part_count: u32,
) -> Result<(), GpuError> {
    let record_room = u32::try_from((buffer.bytes() - HEAD_BYTES) / RAY_BYTES).unwrap_or(u32::MAX);
    let head = RecordHead {
        wanted_kind: kind as u32,
        wanted_part: part,
        part_count,
        record_room,
        records_kept: 0,
        rays_traced: [0; 5],
    };
    let mut recorder = Recorder::new(device, 0, "records")?;
    recorder.upload(buffer, 0, bytemuck::bytes_of(&head))?;
    device.submit(recorder.finish()?, &[])?.wait(device.hung_after())
}

/// What a buffer has kept.
pub(crate) fn read(device: &Arc<Device>, buffer: &Arc<Buffer>) -> Result<Recorded, GpuError> {
    let read = |bytes: u64| {
        let to = Buffer::new(device, "records read back", BufferKind::Readback, bytes)?;
        let mut recorder = Recorder::new(device, 0, "records")?;
        recorder.copy_buffer(buffer, 0, &to, 0, bytes)?;
        device.submit(recorder.finish()?, &[])?.wait(device.hung_after())?;
        to.read(0, bytes)
    };
    let head: RecordHead = bytemuck::pod_read_unaligned(&read(HEAD_BYTES)?);
    let rays = u64::from(head.records_kept.min(head.record_room)) * RAY_BYTES;
    let bytes = read(HEAD_BYTES + rays)?;
    let rays = bytemuck::pod_collect_to_vec(&bytes[HEAD_BYTES as usize..]);
    Ok(Recorded { traced: head.rays_traced, wanted: head.records_kept, rays })
}
