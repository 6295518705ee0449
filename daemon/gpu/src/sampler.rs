//! The one sampler: nearest texel, clamped to the edge.

use std::sync::Arc;

use ash::vk;

use crate::error::GpuError;
use crate::handle::DeviceHandle;

/// A sampler that every sampled image is read through.
pub(crate) struct Sampler {
    pub(crate) raw: vk::Sampler,
    device: Arc<DeviceHandle>,
}

impl Sampler {
    pub(crate) fn nearest_clamp(device: &Arc<DeviceHandle>) -> Result<Sampler, GpuError> {
        let info = vk::SamplerCreateInfo::default()
            .mag_filter(vk::Filter::NEAREST)
            .min_filter(vk::Filter::NEAREST)
            .mipmap_mode(vk::SamplerMipmapMode::NEAREST)
            .address_mode_u(vk::SamplerAddressMode::CLAMP_TO_EDGE)
            .address_mode_v(vk::SamplerAddressMode::CLAMP_TO_EDGE)
            .address_mode_w(vk::SamplerAddressMode::CLAMP_TO_EDGE);
        // SAFETY: a sampler without optional features; it is named before anyone else has it.
        let raw = unsafe {
            let raw = device
                .raw
                .create_sampler(&info, None)
                .map_err(|result| GpuError::vulkan("creating the sampler", result))?;
            device.naming.name(raw, "nearest-clamp");
            raw
        };
        Ok(Sampler { raw, device: Arc::clone(device) })
    }
}

impl Drop for Sampler {
    fn drop(&mut self) {
        // SAFETY: the layout that holds the sampler is held by whatever uses it on the device until it has completed.
        unsafe { self.device.raw.destroy_sampler(self.raw, None) };
    }
}
