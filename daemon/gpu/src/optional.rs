//! What outputs use of a device where it is there: extensions that frames themselves do without.

use std::ffi::CStr;

use ash::{ext, khr, nv, vk};

use crate::instance::Instance;

/// Which of them a device has, with the features behind them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Optional {
    /// `VK_KHR_swapchain`: images to show on a surface.
    pub(crate) swapchain: bool,
    /// `VK_KHR_present_id` and `VK_KHR_present_wait`: when an image was shown.
    pub(crate) present_wait: bool,
    /// `VK_EXT_hdr_metadata`: how bright the image's white is meant to be.
    pub(crate) hdr_metadata: bool,
    /// `VK_NV_present_barrier`: swapchains that flip together, over several screens and machines.
    pub(crate) present_barrier: bool,
    /// `VK_KHR_external_memory_fd`: memory that other processes import.
    pub(crate) memory_fd: bool,
    /// `VK_EXT_external_memory_dma_buf`: the same, for whoever speaks another language than Vulkan.
    pub(crate) dma_buf: bool,
    /// `VK_EXT_queue_family_foreign`: buffers may be handed over to whoever speaks another language than Vulkan.
    pub(crate) foreign: bool,
    /// `VK_KHR_external_semaphore_fd`, for timelines.
    pub(crate) timeline_fd: bool,
}

/// The structures by which a device is asked to switch features on, to be chained where [`Optional`] says so.
pub(crate) struct Switches {
    pub(crate) present_id: vk::PhysicalDevicePresentIdFeaturesKHR<'static>,
    pub(crate) present_wait: vk::PhysicalDevicePresentWaitFeaturesKHR<'static>,
    pub(crate) present_barrier: vk::PhysicalDevicePresentBarrierFeaturesNV<'static>,
}

impl Optional {
    /// Asks a device, which speaks 1.3.
    pub(crate) fn query(instance: &Instance, device: vk::PhysicalDevice) -> Optional {
        // SAFETY: the device is one that this instance listed. One that cannot list its extensions has none to use.
        let listed = unsafe { instance.raw().enumerate_device_extension_properties(device) }.unwrap_or_default();
        let has = |name: &CStr| listed.iter().any(|extension| extension.extension_name_as_c_str() == Ok(name));
        let memory_fd = has(khr::external_memory_fd::NAME);
        let exports = Optional {
            memory_fd,
            dma_buf: memory_fd && has(ext::external_memory_dma_buf::NAME),
            foreign: memory_fd && has(ext::queue_family_foreign::NAME),
            timeline_fd: has(khr::external_semaphore_fd::NAME) && exports_timelines(instance, device),
            ..Optional::default()
        };
        let swapchain = instance.has(khr::surface::NAME) && has(khr::swapchain::NAME);
        if !swapchain {
            return exports;
        }

        // Only structures of extensions that are there may be asked for.
        let may_wait = has(khr::present_id::NAME) && has(khr::present_wait::NAME);
        let may_bar = has(nv::present_barrier::NAME) && instance.has(khr::get_surface_capabilities2::NAME);
        let mut id = vk::PhysicalDevicePresentIdFeaturesKHR::default();
        let mut wait = vk::PhysicalDevicePresentWaitFeaturesKHR::default();
        let mut barrier = vk::PhysicalDevicePresentBarrierFeaturesNV::default();
        let mut all = vk::PhysicalDeviceFeatures2::default();
        if may_wait {
            all = all.push_next(&mut id).push_next(&mut wait);
        }
        if may_bar {
            all = all.push_next(&mut barrier);
        }
        // SAFETY: the device is one that this instance listed, and has the extensions of the chained structures.
        unsafe { instance.raw().get_physical_device_features2(device, &mut all) };
        Optional {
            swapchain,
            present_wait: id.present_id == vk::TRUE && wait.present_wait == vk::TRUE,
            hdr_metadata: has(ext::hdr_metadata::NAME),
            present_barrier: barrier.present_barrier == vk::TRUE,
            ..exports
        }
    }

    /// The extensions to switch on.
    pub(crate) fn extensions(self) -> Vec<&'static CStr> {
        let mut all = Vec::new();
        if self.swapchain {
            all.push(khr::swapchain::NAME);
        }
        if self.present_wait {
            all.extend([khr::present_id::NAME, khr::present_wait::NAME]);
        }
        if self.hdr_metadata {
            all.push(ext::hdr_metadata::NAME);
        }
        if self.present_barrier {
            all.push(nv::present_barrier::NAME);
        }
        if self.memory_fd {
            all.push(khr::external_memory_fd::NAME);
        }
        if self.dma_buf {
            all.push(ext::external_memory_dma_buf::NAME);
        }
        if self.foreign {
            all.push(ext::queue_family_foreign::NAME);
        }
        if self.timeline_fd {
            all.push(khr::external_semaphore_fd::NAME);
        }
        all
    }

    /// The features to switch on.
    pub(crate) fn switches() -> Switches {
        Switches {
            present_id: vk::PhysicalDevicePresentIdFeaturesKHR::default().present_id(true),
            present_wait: vk::PhysicalDevicePresentWaitFeaturesKHR::default().present_wait(true),
            present_barrier: vk::PhysicalDevicePresentBarrierFeaturesNV::default().present_barrier(true),
        }
    }
}

/// How timelines are exported.
pub(crate) const TIMELINE_HANDLE: vk::ExternalSemaphoreHandleTypeFlags =
    vk::ExternalSemaphoreHandleTypeFlags::OPAQUE_FD;

/// Whether a device exports timelines as descriptors.
fn exports_timelines(instance: &Instance, device: vk::PhysicalDevice) -> bool {
    let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
    let info = vk::PhysicalDeviceExternalSemaphoreInfo::default().handle_type(TIMELINE_HANDLE).push_next(&mut kind);
    let mut properties = vk::ExternalSemaphoreProperties::default();
    // SAFETY: the device is one that this instance listed, and speaks 1.3.
    unsafe { instance.raw().get_physical_device_external_semaphore_properties(device, &info, &mut properties) };
    properties.external_semaphore_features.contains(vk::ExternalSemaphoreFeatureFlags::EXPORTABLE)
}
