//! Device features: what is required, what is taken where it is there.

use ash::vk;

use crate::instance::Instance;

/// The features of a device as the driver's structures, their chains not yet linked.
#[derive(Clone, Copy, Default)]
pub(crate) struct Features {
    pub(crate) core: vk::PhysicalDeviceFeatures,
    pub(crate) v11: vk::PhysicalDeviceVulkan11Features<'static>,
    pub(crate) v12: vk::PhysicalDeviceVulkan12Features<'static>,
    pub(crate) v13: vk::PhysicalDeviceVulkan13Features<'static>,
}

impl Features {
    /// What a device offers. It must speak Vulkan 1.3.
    pub(crate) fn query(instance: &Instance, device: vk::PhysicalDevice) -> Features {
        let mut v11 = vk::PhysicalDeviceVulkan11Features::default();
        let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
        let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
        let mut all =
            vk::PhysicalDeviceFeatures2::default().push_next(&mut v11).push_next(&mut v12).push_next(&mut v13);
        // SAFETY: the device is one that this instance listed and speaks 1.3, so that it knows these structures.
        unsafe { instance.raw().get_physical_device_features2(device, &mut all) };
        let core = all.features;

        // The chain pointed at this function's variables; nothing may follow it further.
        v11.p_next = std::ptr::null_mut();
        v12.p_next = std::ptr::null_mut();
        v13.p_next = std::ptr::null_mut();
        Features { core, v11, v12, v13 }
    }

    /// What is missing without which nothing works.
    pub(crate) fn missing(&self) -> Vec<&'static str> {
        let required = [
            ("timeline semaphores", self.v12.timeline_semaphore),
            ("synchronization2", self.v13.synchronization2),
            ("dynamic rendering", self.v13.dynamic_rendering),
        ];
        required.into_iter().filter(|&(_, there)| there == vk::FALSE).map(|(name, _)| name).collect()
    }

    /// What is enabled: the required, and of the rest what shaders may profit from, where the device has it; with
    /// `ray_queries` also what these take.
    pub(crate) fn enabled(&self, ray_queries: bool) -> Features {
        let (core, v11, v12, v13) = (&self.core, &self.v11, &self.v12, &self.v13);
        Features {
            core: vk::PhysicalDeviceFeatures {
                // An index out of bounds in a shader must not reach memory of others: this crate promises safety.
                robust_buffer_access: core.robust_buffer_access,
                fragment_stores_and_atomics: core.fragment_stores_and_atomics,
                vertex_pipeline_stores_and_atomics: core.vertex_pipeline_stores_and_atomics,
                shader_storage_image_extended_formats: core.shader_storage_image_extended_formats,
                shader_storage_image_read_without_format: core.shader_storage_image_read_without_format,
                shader_storage_image_write_without_format: core.shader_storage_image_write_without_format,
                shader_int64: core.shader_int64,
                shader_int16: core.shader_int16,
                shader_float64: core.shader_float64,
                ..Default::default()
            },
            v11: vk::PhysicalDeviceVulkan11Features {
                storage_buffer16_bit_access: v11.storage_buffer16_bit_access,
                shader_draw_parameters: v11.shader_draw_parameters,
                ..Default::default()
            },
            v12: vk::PhysicalDeviceVulkan12Features {
                timeline_semaphore: v12.timeline_semaphore,
                scalar_block_layout: v12.scalar_block_layout,
                uniform_buffer_standard_layout: v12.uniform_buffer_standard_layout,
                storage_buffer8_bit_access: v12.storage_buffer8_bit_access,
                shader_int8: v12.shader_int8,
                shader_float16: v12.shader_float16,
                shader_subgroup_extended_types: v12.shader_subgroup_extended_types,
                vulkan_memory_model: v12.vulkan_memory_model,
                vulkan_memory_model_device_scope: v12.vulkan_memory_model_device_scope,
                // Structures name what they are built from, and each other, by address; shaders name nothing by it.
                buffer_device_address: v12.buffer_device_address & vk::Bool32::from(ray_queries),
                ..Default::default()
            },
            v13: vk::PhysicalDeviceVulkan13Features {
                synchronization2: v13.synchronization2,
                dynamic_rendering: v13.dynamic_rendering,
                maintenance4: v13.maintenance4,
                robust_image_access: v13.robust_image_access,
                shader_terminate_invocation: v13.shader_terminate_invocation,
                shader_demote_to_helper_invocation: v13.shader_demote_to_helper_invocation,
                shader_zero_initialize_workgroup_memory: v13.shader_zero_initialize_workgroup_memory,
                shader_integer_dot_product: v13.shader_integer_dot_product,
                ..Default::default()
            },
        }
    }
}
