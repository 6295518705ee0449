//! What `lanternd devices` tells about each device.

use std::collections::BTreeMap;
use std::ffi::{CStr, c_char};

use ash::{ext, khr, nv, vk};

use crate::error::GpuError;
use crate::families::{self, Family};
use crate::features::Features;
use crate::instance::{Instance, version_text};
use crate::ray_query;

/// A Vulkan device: who it is, what it has, what it can do.
#[derive(Debug, Clone, Default)]
pub struct DeviceInfo {
    /// Its place in the loader's list.
    pub index: usize,
    /// Its name, such as `llvmpipe (LLVM 15.0.6, 256 bits)`.
    pub name: String,
    /// Its driver, such as `llvmpipe` or `NVIDIA`.
    pub driver_name: String,
    /// The driver's version in its own words.
    pub driver_info: String,
    /// `cpu`, `integrated`, `discrete`, `virtual` or `other`.
    pub kind: &'static str,
    /// The device's UUID, 32 lower-case hex digits in the usual groups.
    pub uuid: String,
    /// The driver's UUID, in the same form: memory is shared by devices and drivers of the same UUIDs.
    pub driver_uuid: String,
    /// The Vulkan version that it speaks, such as `1.3.230`.
    pub api_version: String,
    /// Its queue families.
    pub queue_families: Vec<QueueFamily>,
    /// The family whose queues the projectors have, by its index.
    pub projector_family: Option<u32>,
    /// The family that uploads go through beside the frames: one for copies alone. None: they share the projectors' first queue.
    pub upload_family: Option<u32>,
    /// The displays that are wired to it, where the driver lists them.
    pub displays: Vec<Display>,
    /// Optional abilities by name, and whether it has them.
    pub abilities: BTreeMap<&'static str, bool>,
    /// What it lacks to serve here at all; empty for a device that serves.
    pub lacks: Vec<&'static str>,
    /// The longest range of one storage buffer, in bytes.
    pub max_storage_buffer_bytes: u64,
    /// The most elements of one texel buffer.
    pub max_texel_buffer_elements: u64,
    /// Invocations of a subgroup.
    pub subgroup_size: u32,
    /// Its memory.
    pub memory_heaps: Vec<MemoryHeap>,
}

/// Queues of one kind.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct QueueFamily {
    /// The family's index.
    pub index: u32,
    /// What its queues can do, in words: `graphics`, `compute`, `transfer`, `sparse-binding`, `protected`, …
    pub flags: Vec<&'static str>,
    /// How many queues it has.
    pub count: u32,
}

/// A display that is wired to a device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Display {
    /// The driver's name of the connector and the display.
    pub connector: String,
    /// The modes it can show.
    pub modes: Vec<DisplayMode>,
}

/// A mode of a display.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DisplayMode {
    /// Width in pixels.
    pub width_px: u32,
    /// Height in pixels.
    pub height_px: u32,
    /// Refresh rate in thousandths of a hertz.
    pub refresh_mhz: u32,
}

impl DisplayMode {
    /// Refresh rate in hertz.
    pub fn refresh_hz(&self) -> f64 {
        f64::from(self.refresh_mhz) / 1000.0
    }
}

/// A heap of a device's memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryHeap {
    /// Its size in bytes.
    pub bytes: u64,
    /// Whether it is the device's own.
    pub device_local: bool,
}

impl Instance {
    /// All devices, in the loader's order, with what they can do.
    ///
    /// # Errors
    /// When the loader cannot list them.
    pub fn devices(&self) -> Result<Vec<DeviceInfo>, GpuError> {
        let physical = self.physical_devices()?;
        Ok(physical.iter().enumerate().map(|(index, &device)| query(self, device, index)).collect())
    }
}

/// Asks a device everything.
pub(crate) fn query(instance: &Instance, device: vk::PhysicalDevice, index: usize) -> DeviceInfo {
    // SAFETY: the device is one that this instance listed, here and in the calls below.
    let core = unsafe { instance.raw().get_physical_device_properties(device) };
    let of = families::all(instance, device);
    let mut info = DeviceInfo {
        index,
        name: text(core.device_name_as_c_str().ok()),
        kind: kind_word(core.device_type),
        api_version: version_text(core.api_version),
        max_storage_buffer_bytes: u64::from(core.limits.max_storage_buffer_range),
        max_texel_buffer_elements: u64::from(core.limits.max_texel_buffer_elements),
        queue_families: queue_families(&of),
        projector_family: families::serving(&of).map(|family| family.index),
        upload_family: families::transfer(&of).map(|family| family.index),
        memory_heaps: memory_heaps(instance, device),
        ..Default::default()
    };

    // The structures below exist from 1.3 on, and an older device cannot serve anyway.
    if core.api_version < vk::API_VERSION_1_3 {
        info.lacks.push("Vulkan 1.3");
        return info;
    }
    let mut v11 = vk::PhysicalDeviceVulkan11Properties::default();
    let mut v12 = vk::PhysicalDeviceVulkan12Properties::default();
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut v11).push_next(&mut v12);
    // SAFETY: as above, and the device knows these structures.
    unsafe { instance.raw().get_physical_device_properties2(device, &mut all) };
    info.uuid = uuid_text(&v11.device_uuid);
    info.driver_uuid = uuid_text(&v11.driver_uuid);
    info.subgroup_size = v11.subgroup_size;
    info.driver_name = text(v12.driver_name_as_c_str().ok());
    info.driver_info = text(v12.driver_info_as_c_str().ok());

    let features = Features::query(instance, device);
    info.lacks = features.missing();
    if families::serving(&of).is_none() {
        info.lacks.push("a queue for graphics and compute");
    }
    info.displays = displays(instance, device);
    info.abilities = abilities(instance, device, &of, &features, &core.limits);
    info
}

fn queue_families(of: &[Family]) -> Vec<QueueFamily> {
    let words = [
        (vk::QueueFlags::GRAPHICS, "graphics"),
        (vk::QueueFlags::COMPUTE, "compute"),
        (vk::QueueFlags::TRANSFER, "transfer"),
        (vk::QueueFlags::SPARSE_BINDING, "sparse-binding"),
        (vk::QueueFlags::PROTECTED, "protected"),
        (vk::QueueFlags::VIDEO_DECODE_KHR, "video-decode"),
        (vk::QueueFlags::VIDEO_ENCODE_KHR, "video-encode"),
        (vk::QueueFlags::OPTICAL_FLOW_NV, "optical-flow"),
    ];
    let flags =
        |given: vk::QueueFlags| words.iter().filter(|(flag, _)| given.contains(*flag)).map(|(_, word)| *word).collect();
    of.iter()
        .map(|family| QueueFamily { index: family.index, flags: flags(family.flags), count: family.count })
        .collect()
}

fn memory_heaps(instance: &Instance, device: vk::PhysicalDevice) -> Vec<MemoryHeap> {
    // SAFETY: the device is one that this instance listed.
    let memory = unsafe { instance.raw().get_physical_device_memory_properties(device) };
    memory
        .memory_heaps_as_slice()
        .iter()
        .map(|heap| MemoryHeap {
            bytes: heap.size,
            device_local: heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL),
        })
        .collect()
}

fn displays(instance: &Instance, device: vk::PhysicalDevice) -> Vec<Display> {
    if !instance.has(khr::display::NAME) {
        return Vec::new();
    }
    let loader = khr::display::Instance::new(instance.entry(), instance.raw());
    // SAFETY: the extension is enabled, and the device is one that this instance listed. A driver that cannot answer
    // has no displays.
    let listed = unsafe { loader.get_physical_device_display_properties(device) }.unwrap_or_default();
    let mode_of = |mode: &vk::DisplayModePropertiesKHR| DisplayMode {
        width_px: mode.parameters.visible_region.width,
        height_px: mode.parameters.visible_region.height,
        refresh_mhz: mode.parameters.refresh_rate,
    };
    listed
        .iter()
        .map(|display| {
            // SAFETY: the display was listed by this device right now, and its name is null or a C string.
            let (modes, name) = unsafe {
                let modes = loader.get_display_mode_properties(device, display.display).unwrap_or_default();
                (modes, name_at(display.display_name))
            };
            Display { connector: name, modes: modes.iter().map(mode_of).collect() }
        })
        .collect()
}

fn abilities(
    instance: &Instance,
    device: vk::PhysicalDevice,
    of: &[Family],
    features: &Features,
    limits: &vk::PhysicalDeviceLimits,
) -> BTreeMap<&'static str, bool> {
    // SAFETY: the device is one that this instance listed. One that cannot list its extensions has none to use.
    let listed = unsafe { instance.raw().enumerate_device_extension_properties(device) }.unwrap_or_default();
    let has = |name: &CStr| listed.iter().any(|extension| extension.extension_name_as_c_str() == Ok(name));
    let on = |feature: vk::Bool32| feature == vk::TRUE;
    let timestamps = families::serving(of).is_some_and(|family| family.timestamp_valid_bits > 0);
    BTreeMap::from([
        ("acquire_drm_display", instance.has(ext::acquire_drm_display::NAME)),
        ("acceleration_structure", has(khr::acceleration_structure::NAME)),
        ("calibrated_timestamps", has(ext::calibrated_timestamps::NAME) || has(khr::calibrated_timestamps::NAME)),
        ("descriptor_indexing", on(features.v12.descriptor_indexing)),
        ("display", instance.has(khr::display::NAME)),
        ("dma_buf", has(ext::external_memory_dma_buf::NAME)),
        ("dynamic_rendering", on(features.v13.dynamic_rendering)),
        ("external_memory_fd", has(khr::external_memory_fd::NAME)),
        ("external_semaphore_fd", has(khr::external_semaphore_fd::NAME)),
        ("headless_surface", instance.has(ext::headless_surface::NAME)),
        ("hdr_metadata", has(ext::hdr_metadata::NAME)),
        ("present_barrier", has(nv::present_barrier::NAME)),
        ("present_id", has(khr::present_id::NAME)),
        ("present_wait", has(khr::present_wait::NAME)),
        ("ray_query", ray_query::is_offered(instance, device, features)),
        ("robust_buffer_access", on(features.core.robust_buffer_access)),
        ("scalar_block_layout", on(features.v12.scalar_block_layout)),
        ("swapchain", has(khr::swapchain::NAME)),
        ("swapchain_colorspace", instance.has(ext::swapchain_colorspace::NAME)),
        ("synchronization2", on(features.v13.synchronization2)),
        ("timeline_semaphore", on(features.v12.timeline_semaphore)),
        ("window_wayland", instance.offers(khr::wayland_surface::NAME)),
        ("window_x11", instance.has(khr::xcb_surface::NAME)),
        ("timestamps", timestamps && limits.timestamp_period > 0.0),
    ])
}

fn kind_word(kind: vk::PhysicalDeviceType) -> &'static str {
    match kind {
        vk::PhysicalDeviceType::CPU => "cpu",
        vk::PhysicalDeviceType::INTEGRATED_GPU => "integrated",
        vk::PhysicalDeviceType::DISCRETE_GPU => "discrete",
        vk::PhysicalDeviceType::VIRTUAL_GPU => "virtual",
        _ => "other",
    }
}

fn uuid_text(uuid: &[u8; vk::UUID_SIZE]) -> String {
    let mut text = String::new();
    for (i, byte) in uuid.iter().enumerate() {
        if [4, 6, 8, 10].contains(&i) {
            text.push('-');
        }
        text.push_str(&format!("{byte:02x}"));
    }
    text
}

fn text(name: Option<&CStr>) -> String {
    name.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// The text at a pointer that may be null.
///
/// # Safety
/// The pointer is null or a C string that lives through this call.
pub(crate) unsafe fn name_at(name: *const c_char) -> String {
    // SAFETY: by this function's contract, once it is not null.
    let name = (!name.is_null()).then(|| unsafe { CStr::from_ptr(name) });
    text(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uuid_is_written_in_its_usual_groups() {
        assert_eq!(uuid_text(b"mesa22.3.6\0\0\0\0\0\0"), "6d657361-3232-2e33-2e36-000000000000");
    }

    #[test]
    fn a_version_is_written_as_people_write_it() {
        assert_eq!(version_text(vk::make_api_version(0, 1, 3, 230)), "1.3.230");
    }
}
