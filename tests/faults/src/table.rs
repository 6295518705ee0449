//! The calls that can be failed: all that return a result in Vulkan 1.3's core and in the extensions that Lantern may enable.
//!
//! A test compares this table with what crate `ash` knows of each (`tests/tests/faults.rs`), so that none is missing.

use std::ffi::CString;
use std::marker::PhantomData;

use ash::vk;

use crate::dispatch::Function;
use crate::hook::{Id, eight, five, four, one, pipelines, seven, six, three, two};

/// A call.
pub struct Call {
    pfn: &'static str,
    /// The extension that it belongs to; empty for the core's.
    pub extension: &'static str,
    hook: fn() -> Function,
}

impl Call {
    /// Its name, as the loader knows it.
    pub fn name(&self) -> &'static str {
        self.pfn.strip_prefix("PFN_").unwrap_or(self.pfn)
    }

    pub(crate) fn c_name(&self) -> CString {
        // No name in the table has a zero byte.
        CString::new(self.name()).unwrap_or_default()
    }

    /// What stands in its place.
    pub(crate) fn hook(&self) -> Function {
        (self.hook)()
    }
}

/// Extensions that bring no call which returns a result, beside those of [`CALLS`].
pub const SILENT_EXTENSIONS: [&str; 12] = [
    "VK_EXT_external_memory_dma_buf",
    "VK_EXT_hdr_metadata",
    "VK_EXT_memory_budget",
    "VK_EXT_physical_device_drm",
    "VK_EXT_queue_family_foreign",
    "VK_EXT_swapchain_colorspace",
    "VK_EXT_validation_features",
    "VK_KHR_external_memory",
    "VK_KHR_external_semaphore",
    "VK_KHR_present_id",
    "VK_KHR_ray_query",
    "VK_NV_present_barrier",
];

macro_rules! calls {
    ($($extension:literal => $($shape:ident $pfn:ident),+;)+) => {
        /// Each call's place in [`CALLS`].
        #[expect(non_camel_case_types, reason = "these are the names of the types of Vulkan's functions")]
        #[repr(usize)]
        enum Place { $($($pfn),+),+ }

        /// All of them.
        pub static CALLS: &[Call] = &[$($(Call {
            pfn: stringify!($pfn),
            extension: $extension,
            hook: || $shape(Id::<{ Place::$pfn as usize }>, PhantomData::<vk::$pfn>),
        }),+),+];
    };
}

calls! {
    "" =>
        three PFN_vkEnumeratePhysicalDevices,
        seven PFN_vkGetPhysicalDeviceImageFormatProperties,
        four PFN_vkEnumerateDeviceExtensionProperties,
        four PFN_vkQueueSubmit,
        one PFN_vkQueueWaitIdle,
        one PFN_vkDeviceWaitIdle,
        four PFN_vkAllocateMemory,
        six PFN_vkMapMemory,
        three PFN_vkFlushMappedMemoryRanges,
        three PFN_vkInvalidateMappedMemoryRanges,
        four PFN_vkBindBufferMemory,
        four PFN_vkBindImageMemory,
        four PFN_vkQueueBindSparse,
        four PFN_vkCreateFence,
        three PFN_vkResetFences,
        two PFN_vkGetFenceStatus,
        five PFN_vkWaitForFences,
        four PFN_vkCreateSemaphore,
        four PFN_vkCreateEvent,
        two PFN_vkGetEventStatus,
        two PFN_vkSetEvent,
        two PFN_vkResetEvent,
        four PFN_vkCreateQueryPool,
        eight PFN_vkGetQueryPoolResults,
        four PFN_vkCreateBuffer,
        four PFN_vkCreateBufferView,
        four PFN_vkCreateImage,
        four PFN_vkCreateImageView,
        four PFN_vkCreateShaderModule,
        four PFN_vkCreatePipelineCache,
        four PFN_vkGetPipelineCacheData,
        four PFN_vkMergePipelineCaches,
        pipelines PFN_vkCreateGraphicsPipelines,
        pipelines PFN_vkCreateComputePipelines,
        four PFN_vkCreatePipelineLayout,
        four PFN_vkCreateSampler,
        four PFN_vkCreateDescriptorSetLayout,
        four PFN_vkCreateDescriptorPool,
        three PFN_vkResetDescriptorPool,
        three PFN_vkAllocateDescriptorSets,
        four PFN_vkFreeDescriptorSets,
        four PFN_vkCreateFramebuffer,
        four PFN_vkCreateRenderPass,
        four PFN_vkCreateCommandPool,
        three PFN_vkResetCommandPool,
        three PFN_vkAllocateCommandBuffers,
        two PFN_vkBeginCommandBuffer,
        one PFN_vkEndCommandBuffer,
        two PFN_vkResetCommandBuffer,
        three PFN_vkEnumeratePhysicalDeviceGroups,
        three PFN_vkGetPhysicalDeviceImageFormatProperties2,
        three PFN_vkBindBufferMemory2,
        three PFN_vkBindImageMemory2,
        four PFN_vkCreateSamplerYcbcrConversion,
        four PFN_vkCreateDescriptorUpdateTemplate,
        four PFN_vkCreateRenderPass2,
        three PFN_vkGetSemaphoreCounterValue,
        three PFN_vkWaitSemaphores,
        two PFN_vkSignalSemaphore,
        three PFN_vkGetPhysicalDeviceToolProperties,
        four PFN_vkCreatePrivateDataSlot,
        five PFN_vkSetPrivateData,
        four PFN_vkQueueSubmit2;
    "VK_KHR_acceleration_structure" =>
        four PFN_vkCreateAccelerationStructureKHR,
        five PFN_vkBuildAccelerationStructuresKHR,
        three PFN_vkCopyAccelerationStructureKHR,
        three PFN_vkCopyAccelerationStructureToMemoryKHR,
        three PFN_vkCopyMemoryToAccelerationStructureKHR,
        seven PFN_vkWriteAccelerationStructuresPropertiesKHR;
    "VK_KHR_deferred_host_operations" =>
        three PFN_vkCreateDeferredOperationKHR,
        two PFN_vkGetDeferredOperationResultKHR,
        two PFN_vkDeferredOperationJoinKHR;
    "VK_EXT_debug_utils" =>
        four PFN_vkCreateDebugUtilsMessengerEXT,
        two PFN_vkSetDebugUtilsObjectNameEXT,
        two PFN_vkSetDebugUtilsObjectTagEXT;
    "VK_KHR_surface" =>
        four PFN_vkGetPhysicalDeviceSurfaceSupportKHR,
        three PFN_vkGetPhysicalDeviceSurfaceCapabilitiesKHR,
        four PFN_vkGetPhysicalDeviceSurfaceFormatsKHR,
        four PFN_vkGetPhysicalDeviceSurfacePresentModesKHR;
    "VK_KHR_swapchain" =>
        four PFN_vkGetPhysicalDevicePresentRectanglesKHR,
        four PFN_vkCreateSwapchainKHR,
        four PFN_vkGetSwapchainImagesKHR,
        six PFN_vkAcquireNextImageKHR,
        two PFN_vkQueuePresentKHR,
        two PFN_vkGetDeviceGroupPresentCapabilitiesKHR,
        three PFN_vkGetDeviceGroupSurfacePresentModesKHR,
        three PFN_vkAcquireNextImage2KHR;
    "VK_KHR_display" =>
        three PFN_vkGetPhysicalDeviceDisplayPropertiesKHR,
        three PFN_vkGetPhysicalDeviceDisplayPlanePropertiesKHR,
        four PFN_vkGetDisplayPlaneSupportedDisplaysKHR,
        four PFN_vkGetDisplayModePropertiesKHR,
        five PFN_vkCreateDisplayModeKHR,
        four PFN_vkGetDisplayPlaneCapabilitiesKHR,
        four PFN_vkCreateDisplayPlaneSurfaceKHR;
    "VK_KHR_display_swapchain" =>
        five PFN_vkCreateSharedSwapchainsKHR;
    "VK_KHR_xcb_surface" =>
        four PFN_vkCreateXcbSurfaceKHR;
    "VK_KHR_xlib_surface" =>
        four PFN_vkCreateXlibSurfaceKHR;
    "VK_KHR_wayland_surface" =>
        four PFN_vkCreateWaylandSurfaceKHR;
    "VK_EXT_headless_surface" =>
        four PFN_vkCreateHeadlessSurfaceEXT;
    "VK_KHR_get_surface_capabilities2" =>
        three PFN_vkGetPhysicalDeviceSurfaceCapabilities2KHR,
        four PFN_vkGetPhysicalDeviceSurfaceFormats2KHR;
    "VK_EXT_acquire_drm_display" =>
        three PFN_vkAcquireDrmDisplayEXT,
        four PFN_vkGetDrmDisplayEXT;
    "VK_EXT_direct_mode_display" =>
        two PFN_vkReleaseDisplayEXT;
    "VK_EXT_display_surface_counter" =>
        three PFN_vkGetPhysicalDeviceSurfaceCapabilities2EXT;
    "VK_EXT_display_control" =>
        three PFN_vkDisplayPowerControlEXT,
        four PFN_vkRegisterDeviceEventEXT,
        five PFN_vkRegisterDisplayEventEXT,
        four PFN_vkGetSwapchainCounterEXT;
    "VK_KHR_external_memory_fd" =>
        three PFN_vkGetMemoryFdKHR,
        four PFN_vkGetMemoryFdPropertiesKHR;
    "VK_KHR_external_semaphore_fd" =>
        two PFN_vkImportSemaphoreFdKHR,
        three PFN_vkGetSemaphoreFdKHR;
    "VK_KHR_present_wait" =>
        four PFN_vkWaitForPresentKHR;
    "VK_GOOGLE_display_timing" =>
        three PFN_vkGetRefreshCycleDurationGOOGLE,
        four PFN_vkGetPastPresentationTimingGOOGLE;
    "VK_KHR_calibrated_timestamps" =>
        three PFN_vkGetPhysicalDeviceCalibrateableTimeDomainsKHR,
        five PFN_vkGetCalibratedTimestampsKHR;
    "VK_EXT_image_drm_format_modifier" =>
        three PFN_vkGetImageDrmFormatModifierPropertiesEXT;
}
