//! Ray queries (`VK_KHR_ray_query`) of a device: whether it has them, and what is switched on where they are wanted.

use std::ffi::CStr;

use ash::{khr, vk};

use crate::features::Features;
use crate::instance::Instance;

/// By what rays are traced.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum RayTracing {
    /// By the device's own ray queries where it has them and is no processor, which would only imitate them.
    Auto,
    /// By walking the scene's own structures in the shaders: every device can.
    #[default]
    Bvh,
    /// By the device's ray queries.
    RayQuery,
}

/// The extensions that ray queries take; the last is one that the first depends upon and nothing here calls.
pub(crate) const EXTENSIONS: [&CStr; 3] =
    [khr::ray_query::NAME, khr::acceleration_structure::NAME, khr::deferred_host_operations::NAME];

/// Whether a device has all that ray queries take: the extensions, and the features behind them.
pub(crate) fn is_offered(instance: &Instance, device: vk::PhysicalDevice, features: &Features) -> bool {
    // SAFETY: the device is one that this instance listed. One that cannot list its extensions has none to use.
    let listed = unsafe { instance.raw().enumerate_device_extension_properties(device) }.unwrap_or_default();
    let has = |name: &CStr| listed.iter().any(|extension| extension.extension_name_as_c_str() == Ok(name));
    if !EXTENSIONS.into_iter().all(has) || features.v12.buffer_device_address == vk::FALSE {
        return false;
    }
    let mut structures = vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default();
    let mut queries = vk::PhysicalDeviceRayQueryFeaturesKHR::default();
    let mut all = vk::PhysicalDeviceFeatures2::default().push_next(&mut structures).push_next(&mut queries);
    // SAFETY: as above, and the device has the extensions of these structures.
    unsafe { instance.raw().get_physical_device_features2(device, &mut all) };
    structures.acceleration_structure == vk::TRUE && queries.ray_query == vk::TRUE
}

/// The structures by which a device is asked to switch them on.
pub(crate) fn switches()
-> (vk::PhysicalDeviceAccelerationStructureFeaturesKHR<'static>, vk::PhysicalDeviceRayQueryFeaturesKHR<'static>) {
    (
        vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default().acceleration_structure(true),
        vk::PhysicalDeviceRayQueryFeaturesKHR::default().ray_query(true),
    )
}

/// The functions of an opened device's ray queries, and their limits.
pub(crate) struct RayQueries {
    pub(crate) raw: khr::acceleration_structure::Device,
    /// The most triangles of a bottom level.
    pub(crate) max_triangles: u64,
    /// The most instances of a top level.
    pub(crate) max_instances: u64,
    /// The most structures that a shader stage binds.
    pub(crate) max_stage_structures: u32,
    /// What addresses of scratch memory are multiples of, in bytes.
    pub(crate) scratch_alignment: u64,
}

impl RayQueries {
    /// Those of a device that was opened with [`EXTENSIONS`] and [`switches`].
    pub(crate) fn new(instance: &Instance, physical: vk::PhysicalDevice, device: &ash::Device) -> RayQueries {
        let mut limits = vk::PhysicalDeviceAccelerationStructurePropertiesKHR::default();
        let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut limits);
        // SAFETY: the device is one that this instance listed, and has the extension of this structure.
        unsafe { instance.raw().get_physical_device_properties2(physical, &mut all) };
        RayQueries {
            raw: khr::acceleration_structure::Device::new(instance.raw(), device),
            max_triangles: limits.max_primitive_count,
            max_instances: limits.max_instance_count,
            max_stage_structures: limits.max_per_stage_descriptor_acceleration_structures,
            scratch_alignment: u64::from(limits.min_acceleration_structure_scratch_offset_alignment).max(1),
        }
    }
}
