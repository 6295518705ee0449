//! The scene on the device: one buffer a section, uploaded when the section is another one than last time.

use std::sync::Arc;

use bytemuck::Pod;
use lantern_gpu::{Buffer, BufferKind, Device, GpuError, Recorder, TexelFormat};
use lantern_scene::Scene;
use lantern_scene::pack::{GpuEnvironment, GpuGeometry, GpuLight, GpuMaterial, GpuTextures, GpuTop};

use crate::catalogue::Catalogue;
use crate::structures::Structures;

/// A buffer that grows. Its name is what shaders call it.
struct Slot {
    name: &'static str,
    kind: fn() -> BufferKind,
    buffer: Arc<Buffer>,
}

impl Slot {
    fn new(device: &Arc<Device>, name: &'static str, kind: fn() -> BufferKind) -> Result<Self, GpuError> {
        Ok(Self { name, kind, buffer: Buffer::new(device, name, kind(), SMALLEST)? })
    }

    /// Writes `data`. True when the buffer had to be replaced, so that what binds it must bind it again.
    fn write<T: Pod>(&mut self, device: &Arc<Device>, recorder: &mut Recorder, data: &[T]) -> Result<bool, GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let grows = bytes.len() as u64 > self.buffer.bytes();
        if grows {
            self.buffer = Buffer::new(device, self.name, (self.kind)(), bytes.len() as u64)?;
        }
        if !bytes.is_empty() {
            recorder.upload(&self.buffer, 0, bytes)?;
        }
        Ok(grows)
    }
}

/// An empty section still has a buffer to bind: one of the widest texel.
const SMALLEST: u64 = 256;

/// The sections that lie on the device now.
#[derive(Default)]
struct Resident {
    geometry: Option<Arc<GpuGeometry>>,
    top: Option<Arc<GpuTop>>,
    materials: Option<Arc<Vec<GpuMaterial>>>,
    lights: Option<Arc<Vec<GpuLight>>>,
    textures: Option<Arc<GpuTextures>>,
    environment: Option<Arc<GpuEnvironment>>,
}

/// Whether `now` is another section than the one that was uploaded; remembers it.
fn replaced<T>(was: &mut Option<Arc<T>>, now: &Arc<T>) -> bool {
    let same = was.as_ref().is_some_and(|w| Arc::ptr_eq(w, now));
    *was = Some(now.clone());
    !same
}

/// The scene's buffers, shared by the projectors of a device.
pub(crate) struct SceneBuffers {
    device: Arc<Device>,
    resident: Resident,
    slots: [Slot; 12],
    /// On a device with ray queries.
    structures: Option<Structures>,
}

const BLAS_NODES: usize = 0;
const TRIANGLES: usize = 1;
const INDICES: usize = 2;
const VERTICES: usize = 3;
const INSTANCES: usize = 4;
const TLAS_NODES: usize = 5;
const TLAS_ORDER: usize = 6;
const MATERIALS: usize = 7;
const LIGHTS: usize = 8;
const TEXTURES: usize = 9;
const TEXELS: usize = 10;
const ENVIRONMENT: usize = 11;

impl SceneBuffers {
    pub(crate) fn new(device: &Arc<Device>) -> Result<Self, GpuError> {
        let uints: fn() -> BufferKind = || BufferKind::Texel(TexelFormat::Rgba32Uint);
        let floats: fn() -> BufferKind = || BufferKind::Texel(TexelFormat::Rgba32Float);
        let words: fn() -> BufferKind = || BufferKind::Texel(TexelFormat::R32Uint);
        let bytes: fn() -> BufferKind = || BufferKind::Texel(TexelFormat::Rgba8Unorm);
        let storage: fn() -> BufferKind = || BufferKind::Storage;
        let slot = |name, kind| Slot::new(device, name, kind);
        Ok(Self {
            device: device.clone(),
            resident: Resident::default(),
            structures: device.has_ray_queries().then(Structures::default),
            slots: [
                slot("blas_nodes", uints)?,
                slot("triangles", floats)?,
                slot("indices", uints)?,
                slot("vertices", uints)?,
                slot("instances", uints)?,
                slot("tlas_nodes", uints)?,
                slot("tlas_order", words)?,
                slot("materials", uints)?,
                slot("lights", uints)?,
                slot("Textures", storage)?,
                slot("texels", bytes)?,
                slot("environment_texels", floats)?,
            ],
        })
    }

    /// Whether any section of `scene` is not yet on the device.
    pub(crate) fn differs(&self, scene: &Scene) -> bool {
        fn other<T>(was: &Option<Arc<T>>, now: &Arc<T>) -> bool {
            !was.as_ref().is_some_and(|w| Arc::ptr_eq(w, now))
        }
        let r = &self.resident;
        other(&r.geometry, &scene.geometry)
            || other(&r.top, &scene.top)
            || other(&r.materials, &scene.gpu_materials)
            || other(&r.lights, &scene.lights)
            || other(&r.textures, &scene.textures)
            || other(&r.environment, &scene.environment)
    }

    /// Uploads the sections that differ. True when a buffer was replaced.
    pub(crate) fn update(&mut self, recorder: &mut Recorder, scene: &Scene) -> Result<bool, GpuError> {
        let Self { device, resident, slots, structures } = self;
        let mut rebound = false;
        if let Some(structures) = structures {
            rebound |= structures.update(recorder, scene)?;
        }
        if replaced(&mut resident.geometry, &scene.geometry) {
            rebound |= slots[BLAS_NODES].write(device, recorder, &scene.geometry.nodes)?;
            rebound |= slots[TRIANGLES].write(device, recorder, &scene.geometry.triangles)?;
            rebound |= slots[INDICES].write(device, recorder, &scene.geometry.indices)?;
            rebound |= slots[VERTICES].write(device, recorder, &scene.geometry.vertices)?;
        }
        if replaced(&mut resident.top, &scene.top) {
            rebound |= slots[INSTANCES].write(device, recorder, &scene.top.instances)?;
            rebound |= slots[TLAS_NODES].write(device, recorder, &scene.top.nodes)?;
            rebound |= slots[TLAS_ORDER].write(device, recorder, &scene.top.order)?;
        }
        if replaced(&mut resident.materials, &scene.gpu_materials) {
            rebound |= slots[MATERIALS].write(device, recorder, &scene.gpu_materials)?;
        }
        if replaced(&mut resident.lights, &scene.lights) {
            rebound |= slots[LIGHTS].write(device, recorder, &scene.lights)?;
        }
        if replaced(&mut resident.textures, &scene.textures) {
            rebound |= slots[TEXTURES].write(device, recorder, &scene.textures.headers)?;
            rebound |= slots[TEXELS].write(device, recorder, &scene.textures.texels)?;
        }
        if replaced(&mut resident.environment, &scene.environment) {
            rebound |= slots[ENVIRONMENT].write(device, recorder, &scene.environment.texels)?;
        }
        Ok(rebound)
    }

    /// Forgets what is resident, so that the next update uploads everything: after an upload that failed half way.
    pub(crate) fn forget(&mut self) {
        self.resident = Resident::default();
        self.structures = self.structures.take().map(|_| Structures::default());
    }

    /// Adds the scene's buffers.
    pub(crate) fn list(&self, catalogue: Catalogue) -> Catalogue {
        let with_buffers = self.slots.iter().fold(catalogue, |c, slot| c.with_buffer(slot.name, &slot.buffer));
        self.structures.iter().fold(with_buffers, |c, structures| structures.list(c))
    }
}
