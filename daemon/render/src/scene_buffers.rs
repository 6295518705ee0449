//! The scene on the device: blocks that many revisions share, and small sections, one buffer each, which are written whole when
//! they are others than last time.

use std::sync::Arc;

use bytemuck::Pod;
use lantern_gpu::{Buffer, BufferKind, Device, GpuError, Recorder, TexelFormat};
use lantern_scene::pack::{GpuInstance, GpuLight, GpuMaterial, GpuTexture, GpuTop};
use lantern_scene::{GpuTextures, Mesh, Scene};

use crate::block::{Block, ENVIRONMENTS, IMAGES, NODES, TRIANGLES, VERTICES};
use crate::catalogue::Catalogue;
use crate::loads::{Loads, Ways};
use crate::settings::Walk;
use crate::store::{Advanced, SMALLEST, Store};
use crate::structures::Structures;

/// A buffer as large as its section, or up to four times that. Its name is what shaders call it.
struct Slot {
    name: &'static str,
    kind: BufferKind,
    buffer: Arc<Buffer>,
}

impl Slot {
    fn new(device: &Arc<Device>, name: &'static str, kind: BufferKind) -> Result<Self, GpuError> {
        Ok(Self { name, kind, buffer: Buffer::new(device, name, kind, SMALLEST)? })
    }

    /// Writes `data`. True when the buffer had to be replaced, so that what binds it must bind it again.
    fn write<T: Pod>(&mut self, device: &Arc<Device>, recorder: &mut Recorder, data: &[T]) -> Result<bool, GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let needed = (bytes.len() as u64).max(SMALLEST);
        let fits = (needed..=4 * needed).contains(&self.buffer.bytes());
        if !fits {
            self.buffer = Buffer::new(device, self.name, self.kind, needed)?;
        }
        if !bytes.is_empty() {
            recorder.upload(&self.buffer, 0, bytes)?;
        }
        Ok(!fits)
    }
}

/// The small sections that lie on the device now.
#[derive(Default)]
struct Resident {
    top: Option<Arc<GpuTop>>,
    materials: Option<Arc<Vec<GpuMaterial>>>,
    lights: Option<Arc<Vec<GpuLight>>>,
    textures: Option<Arc<GpuTextures>>,
    /// Those that the instances point to.
    meshes: Vec<Arc<Mesh>>,
}

/// Whether `now` is another section than the one that was uploaded; remembers it.
fn replaced<T>(was: &mut Option<Arc<T>>, now: &Arc<T>) -> bool {
    let same = was.as_ref().is_some_and(|w| Arc::ptr_eq(w, now));
    *was = Some(now.clone());
    !same
}

/// Whether these are the same meshes.
fn same(old: &[Arc<Mesh>], new: &[Arc<Mesh>]) -> bool {
    old.iter().map(Arc::as_ptr).eq(new.iter().map(Arc::as_ptr))
}

/// The scene's buffers, shared by the projectors of a device.
pub(crate) struct SceneBuffers {
    device: Arc<Device>,
    ways: Ways,
    store: Store,
    resident: Resident,
    slots: [Slot; 6],
    /// On a device with ray queries.
    structures: Option<Structures>,
}

const INSTANCES: usize = 0;
const TLAS_NODES: usize = 1;
const TLAS_ORDER: usize = 2;
const MATERIALS: usize = 3;
const LIGHTS: usize = 4;
const TEXTURES: usize = 5;

impl SceneBuffers {
    pub(crate) fn new(device: &Arc<Device>, walk: Walk) -> Result<Self, GpuError> {
        let ways = Ways::of(device, walk.loads, walk.texel_elements);
        let uints = BufferKind::Texel(TexelFormat::Rgba32Uint);
        let words = BufferKind::Texel(TexelFormat::R32Uint);
        let slot = |name, kind| Slot::new(device, name, kind);
        Ok(Self {
            device: device.clone(),
            store: Store::new(device, ways.clone())?,
            ways,
            resident: Resident::default(),
            structures: device.has_ray_queries().then(Structures::default),
            slots: [
                slot("instances", uints)?,
                slot("tlas_nodes", uints)?,
                slot("tlas_order", words)?,
                slot("materials", uints)?,
                slot("lights", uints)?,
                slot("Textures", BufferKind::Storage)?,
            ],
        })
    }

    /// Makes the blocks of these scenes the ones that are to be held.
    ///
    /// # Errors
    /// A buffer that the device cannot make, or cannot read together with the others; then nothing has changed.
    pub(crate) fn want<'a>(&mut self, scenes: impl Iterator<Item = &'a Arc<Scene>>) -> Result<(), GpuError> {
        self.store.want(scenes.flat_map(|scene| Block::all_of(scene)))
    }

    /// Sends at most about `budget` bytes of blocks on their way.
    ///
    /// # Errors
    /// What Vulkan says; then what was to be sent still is.
    pub(crate) fn advance(&mut self, budget: u64) -> Result<Advanced, GpuError> {
        let advanced = self.store.advance(budget)?;
        if advanced.moved {
            // Instances and textures say where blocks lie.
            self.resident.top = None;
            self.resident.textures = None;
        }
        Ok(advanced)
    }

    /// Whether blocks have yet to be sent.
    pub(crate) fn is_busy(&self) -> bool {
        self.store.is_busy()
    }

    /// Whether frames that are recorded from now on find every block of a scene there.
    pub(crate) fn has(&self, scene: &Scene) -> bool {
        self.store.has(Block::all_of(scene))
    }

    /// The first texel of a scene's environment.
    pub(crate) fn environment_first(&self, scene: &Scene) -> u32 {
        self.store.first(&Block::Environment(scene.environment.clone()), ENVIRONMENTS)
    }

    /// Whether any small section of `scene` is not yet on the device.
    pub(crate) fn differs(&self, scene: &Scene) -> bool {
        fn other<T>(was: &Option<Arc<T>>, now: &Arc<T>) -> bool {
            !was.as_ref().is_some_and(|w| Arc::ptr_eq(w, now))
        }
        let r = &self.resident;
        other(&r.top, &scene.top)
            || !same(&r.meshes, &scene.meshes)
            || other(&r.materials, &scene.gpu_materials)
            || other(&r.lights, &scene.lights)
            || other(&r.textures, &scene.textures)
    }

    /// Uploads the small sections that differ, of a scene whose blocks are there. True when a buffer was replaced.
    pub(crate) fn update(&mut self, recorder: &mut Recorder, scene: &Scene) -> Result<bool, GpuError> {
        let Self { device, store, resident, slots, structures, .. } = self;
        let mut rebound = false;
        if let Some(structures) = structures {
            rebound |= structures.update(recorder, scene)?;
        }
        if replaced(&mut resident.top, &scene.top) | !same(&resident.meshes, &scene.meshes) {
            resident.meshes.clone_from(&scene.meshes);
            rebound |= slots[INSTANCES].write(device, recorder, &placed_instances(store, scene))?;
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
            rebound |= slots[TEXTURES].write(device, recorder, &placed_textures(store, &scene.textures))?;
        }
        Ok(rebound)
    }

    /// Forgets which small sections are resident, so that the next update uploads all: after an upload that failed half way.
    pub(crate) fn forget(&mut self) {
        self.resident = Resident::default();
        self.structures = self.structures.take().map(|_| Structures::default());
    }

    /// How shaders read the buffers that there are now.
    ///
    /// # Errors
    /// A buffer that is too long for that.
    pub(crate) fn loads(&self) -> Result<Loads, GpuError> {
        let small = self.slots.iter().map(|slot| &slot.buffer);
        self.ways.through(small.chain(self.store.buffers().map(|(_, buffer)| buffer)))
    }

    /// Adds the scene's buffers.
    pub(crate) fn list(&self, catalogue: Catalogue) -> Catalogue {
        let small = self.slots.iter().map(|slot| (slot.name, &slot.buffer));
        let with_buffers = small.chain(self.store.buffers()).fold(catalogue, |c, (name, b)| c.with_buffer(name, b));
        self.structures.iter().fold(with_buffers, |c, structures| structures.list(c))
    }

    /// Bytes of all of them, with the device's own structures.
    pub(crate) fn bytes(&self) -> u64 {
        let small = self.slots.iter().map(|slot| slot.buffer.bytes());
        let buffers: u64 = small.chain(self.store.buffers().map(|(_, buffer)| buffer.bytes())).sum();
        buffers + self.structures.as_ref().map_or(0, |structures| structures.bytes())
    }
}

/// The scene's instances, told where their meshes lie.
fn placed_instances(store: &Store, scene: &Scene) -> Vec<GpuInstance> {
    let firsts: Vec<[u32; 3]> = (scene.meshes.iter())
        .map(|mesh| Block::Mesh(mesh.clone()))
        .map(|block| [NODES, TRIANGLES, VERTICES].map(|space| store.first(&block, space)))
        .collect();
    let instances = scene.top.instances.iter().zip(&scene.instances);
    instances
        .map(|(gpu, instance)| {
            let [node_base, triangle_base, vertex_base] = firsts[instance.mesh];
            GpuInstance { node_base, triangle_base, vertex_base, ..*gpu }
        })
        .collect()
}

/// The textures' headers, told where their images lie.
fn placed_textures(store: &Store, textures: &GpuTextures) -> Vec<GpuTexture> {
    let headers = textures.headers.iter().zip(&textures.image_of);
    headers
        .map(|(header, image)| {
            let image = Block::Image(textures.images[*image].clone());
            GpuTexture { first_texel: store.first(&image, IMAGES), ..*header }
        })
        .collect()
}
