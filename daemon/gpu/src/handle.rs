//! The logical device itself, which every object on it keeps alive.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, RwLock};

use ash::{ext, vk};
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationSizes, AllocatorDebugSettings};

use crate::error::GpuError;
use crate::families::Family;
use crate::features::Features;
use crate::info::DeviceInfo;
use crate::instance::Instance;
use crate::naming::Naming;
use crate::optional::Optional;
use crate::patience::Patience;
use crate::ray_query::{self, RayQueries};

/// Bytes of the memory blocks that objects share: small, so that a small scene shows as one, and growing with use.
const BLOCK_BYTES: (u64, u64) = (16 << 20, 256 << 20);

/// What the device allows, as far as this crate checks it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Limits {
    /// The largest buffer of any kind, in bytes.
    pub max_buffer_bytes: u64,
    /// The largest piece of memory, in bytes.
    pub max_memory_bytes: u64,
    /// The longest range of one storage buffer, in bytes.
    pub max_storage_buffer_bytes: u64,
    /// The longest range of one uniform buffer, in bytes.
    pub max_uniform_buffer_bytes: u64,
    /// The most elements of one texel buffer.
    pub max_texel_buffer_elements: u64,
    /// The most bytes of push constants.
    pub max_push_bytes: u32,
    /// The most workgroups of a dispatch, by axis.
    pub max_groups: [u32; 3],
    /// The most invocations of a workgroup, by axis.
    pub max_group_size: [u32; 3],
    /// The most invocations of a workgroup in all.
    pub max_group_invocations: u32,
    /// The most pixels of an image along either side.
    pub max_image_px: u32,
    /// The most pixels of a render target along width and height.
    pub max_target_px: [u32; 2],
    /// The most colour attachments of a rendering.
    pub max_color_attachments: u32,
    /// The most uniform buffers of a shader stage.
    pub max_stage_uniform_buffers: u32,
    /// The most storage buffers of a shader stage.
    pub max_stage_storage_buffers: u32,
    /// The most texel buffers and sampled images of a shader stage, together.
    pub max_stage_sampled: u32,
    /// The most storage images of a shader stage.
    pub max_stage_storage_images: u32,
    /// The most resources of a shader stage, attachments included.
    pub max_stage_resources: u32,
    /// Nanoseconds of one tick of a timestamp; 0 where the device has none.
    pub timestamp_period_ns: f32,
    /// Bits of a timestamp that count.
    pub timestamp_valid_bits: u32,
}

/// A logical device, its allocator and what is known of it.
///
/// Objects hold this and not [`Device`](crate::Device), because that one parks objects until they are no longer in
/// use: parked objects must not keep their parking place alive.
pub(crate) struct DeviceHandle {
    pub(crate) raw: ash::Device,
    pub(crate) instance: Arc<Instance>,
    pub(crate) naming: Naming,
    pub(crate) info: DeviceInfo,
    pub(crate) limits: Limits,
    pub(crate) features: Features,
    /// What outputs use of it, all switched on.
    pub(crate) optional: Optional,
    /// Where the device was opened with them.
    ray_queries: Option<RayQueries>,
    pub(crate) physical: vk::PhysicalDevice,
    /// Of all queues that were opened, by index, each once: the projectors' first.
    pub(crate) families: Vec<u32>,
    /// None only while the handle is being dropped.
    pub(crate) allocator: Mutex<Option<Allocator>>,
    pub(crate) allocated_bytes: AtomicU64,
    /// Held shared while the host touches mapped memory, and exclusively while commands are submitted: so nothing
    /// starts to use mapped memory while the host is at it.
    pub(crate) gate: RwLock<()>,
    pub(crate) patience: Patience,
}

impl DeviceHandle {
    /// Creates the logical device with `queues` queues of the first family, and one of the second, which is for uploads; and with
    /// ray queries where they are wanted, which the caller has found it to have.
    pub(crate) fn create(
        instance: &Arc<Instance>,
        physical: vk::PhysicalDevice,
        info: DeviceInfo,
        (serving, transfer): (Family, Option<Family>),
        queues: u32,
        wants_ray_queries: bool,
    ) -> Result<Arc<DeviceHandle>, GpuError> {
        let features = Features::query(instance, physical).enabled(wants_ray_queries);
        let optional = Optional::query(instance, physical);
        let families = (serving, transfer, queues);
        let raw = create_raw(instance, physical, &features, families, (optional, wants_ray_queries), &info.name)?;

        // From here on the device is owned by the handle, so that it is destroyed if the allocator cannot be made.
        let has_names = instance.has(ext::debug_utils::NAME);
        let naming = Naming(has_names.then(|| ext::debug_utils::Device::new(instance.raw(), &raw)));
        let handle = DeviceHandle {
            instance: Arc::clone(instance),
            naming,
            patience: Patience::with(info.kind),
            limits: limits(instance, physical, serving.timestamp_valid_bits),
            info,
            features,
            optional,
            ray_queries: wants_ray_queries.then(|| RayQueries::new(instance, physical, &raw)),
            physical,
            families: [Some(serving), transfer].into_iter().flatten().map(|family| family.index).collect(),
            allocator: Mutex::new(None),
            allocated_bytes: AtomicU64::new(0),
            gate: RwLock::new(()),
            raw,
        };
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.raw().clone(),
            device: handle.raw.clone(),
            physical_device: physical,
            debug_settings: AllocatorDebugSettings::default(),
            buffer_device_address: wants_ray_queries,
            allocation_sizes: AllocationSizes::new(BLOCK_BYTES.0, BLOCK_BYTES.0)
                .with_max_device_memblock_size(BLOCK_BYTES.1)
                .with_max_host_memblock_size(BLOCK_BYTES.1),
        })
        .map_err(|error| GpuError::Memory { object: handle.info.name.clone(), detail: error.to_string() })?;
        *handle.allocator.lock().unwrap_or_else(PoisonError::into_inner) = Some(allocator);
        Ok(Arc::new(handle))
    }

    /// The device's ray queries; refused where it was opened without them.
    pub(crate) fn ray_queries(&self) -> Result<&RayQueries, GpuError> {
        let missing = || "ray queries, or was opened without them".into();
        self.ray_queries
            .as_ref()
            .ok_or_else(|| GpuError::Unsupported { device: format!("device {:?}", self.info.name), missing: missing() })
    }

    /// The most acceleration structures of a shader stage.
    pub(crate) fn max_stage_structures(&self) -> u32 {
        self.ray_queries.as_ref().map_or(0, |queries| queries.max_stage_structures)
    }

    /// Bytes that live objects take.
    pub(crate) fn allocated_bytes(&self) -> u64 {
        self.allocated_bytes.load(Ordering::Relaxed)
    }
}

impl Drop for DeviceHandle {
    fn drop(&mut self) {
        // The allocator gives its blocks back to the device, so it goes first.
        drop(self.allocator.get_mut().unwrap_or_else(PoisonError::into_inner).take());
        // SAFETY: every object of the device holds this handle by Arc, so none is left.
        unsafe { self.raw.destroy_device(None) };
    }
}

fn create_raw(
    instance: &Instance,
    physical: vk::PhysicalDevice,
    features: &Features,
    (serving, transfer, queues): (Family, Option<Family>, u32),
    (optional, with_ray_queries): (Optional, bool),
    name: &str,
) -> Result<ash::Device, GpuError> {
    let priorities = vec![1.0; queues as usize];
    let of = |family: Family, count: usize| {
        vk::DeviceQueueCreateInfo::default().queue_family_index(family.index).queue_priorities(&priorities[..count])
    };
    let queue_infos: Vec<_> =
        [Some(of(serving, queues as usize)), transfer.map(|family| of(family, 1))].into_iter().flatten().collect();
    let mut features = *features;
    let mut all = vk::PhysicalDeviceFeatures2::default()
        .features(features.core)
        .push_next(&mut features.v11)
        .push_next(&mut features.v12)
        .push_next(&mut features.v13);
    let mut info = vk::DeviceCreateInfo::default().queue_create_infos(&queue_infos).push_next(&mut all);
    let mut names = optional.extensions();
    let (mut structures, mut queries) = ray_query::switches();
    if with_ray_queries {
        names.extend(ray_query::EXTENSIONS);
        info = info.push_next(&mut structures).push_next(&mut queries);
    }
    let mut switches = Optional::switches();
    if optional.present_wait {
        info = info.push_next(&mut switches.present_id).push_next(&mut switches.present_wait);
    }
    if optional.present_barrier {
        info = info.push_next(&mut switches.present_barrier);
    }
    let extensions: Vec<_> = names.into_iter().map(std::ffi::CStr::as_ptr).collect();
    info = info.enabled_extension_names(&extensions);
    // SAFETY: the physical device is of this instance, has that many queues in these families, which differ, and
    // has every feature and extension asked for; all that `info` points to lives until the call returns.
    unsafe { instance.raw().create_device(physical, &info, None) }
        .map_err(|result| GpuError::vulkan(format!("opening device {name:?}"), result))
}

fn limits(instance: &Instance, physical: vk::PhysicalDevice, timestamp_valid_bits: u32) -> Limits {
    let mut v11 = vk::PhysicalDeviceVulkan11Properties::default();
    let mut v13 = vk::PhysicalDeviceVulkan13Properties::default();
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut v11).push_next(&mut v13);
    // SAFETY: the physical device is one that this instance listed, and speaks 1.3, so that it knows these structures.
    unsafe { instance.raw().get_physical_device_properties2(physical, &mut all) };
    let core = all.properties.limits;
    Limits {
        max_buffer_bytes: v13.max_buffer_size,
        max_memory_bytes: v11.max_memory_allocation_size,
        max_storage_buffer_bytes: u64::from(core.max_storage_buffer_range),
        max_uniform_buffer_bytes: u64::from(core.max_uniform_buffer_range),
        max_texel_buffer_elements: u64::from(core.max_texel_buffer_elements),
        max_push_bytes: core.max_push_constants_size,
        max_groups: core.max_compute_work_group_count,
        max_group_size: core.max_compute_work_group_size,
        max_group_invocations: core.max_compute_work_group_invocations,
        max_image_px: core.max_image_dimension2_d,
        max_target_px: [core.max_framebuffer_width, core.max_framebuffer_height],
        max_color_attachments: core.max_color_attachments,
        max_stage_uniform_buffers: core.max_per_stage_descriptor_uniform_buffers,
        max_stage_storage_buffers: core.max_per_stage_descriptor_storage_buffers,
        max_stage_sampled: core.max_per_stage_descriptor_sampled_images,
        max_stage_storage_images: core.max_per_stage_descriptor_storage_images,
        max_stage_resources: core.max_per_stage_resources,
        timestamp_period_ns: if timestamp_valid_bits > 0 { core.timestamp_period } else { 0.0 },
        timestamp_valid_bits,
    }
}
