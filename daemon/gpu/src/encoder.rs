//! What a recording writes into: a command pool with its one buffer, and the queries of its timestamps. Reused once the
//! device is done with it.

use std::sync::Arc;

use ash::vk;

use crate::error::GpuError;
use crate::handle::DeviceHandle;

/// Queries of one recording: one at its beginning and two for each span.
pub(crate) const QUERIES: u32 = 256;

/// A command buffer, alone in its pool, and a query pool.
pub(crate) struct Encoder {
    pub(crate) device: Arc<DeviceHandle>,
    pub(crate) commands: vk::CommandBuffer,
    /// Null where the queue family has no timestamps.
    pub(crate) queries: vk::QueryPool,
    pool: vk::CommandPool,
    /// Whose queues it records for.
    pub(crate) family: u32,
}

impl Encoder {
    /// A new encoder for queues of `family`.
    pub(crate) fn new(device: &Arc<DeviceHandle>, family: u32) -> Result<Encoder, GpuError> {
        let refused = |result| GpuError::vulkan("making a command buffer", result);
        // Owned from the start, so that what was made is destroyed when a later step fails.
        let mut encoder = Encoder {
            device: Arc::clone(device),
            commands: vk::CommandBuffer::null(),
            queries: vk::QueryPool::null(),
            pool: vk::CommandPool::null(),
            family,
        };
        let pool_info = vk::CommandPoolCreateInfo::default()
            .flags(vk::CommandPoolCreateFlags::TRANSIENT)
            .queue_family_index(family);
        // SAFETY: the family is one that the device was opened with; one buffer is taken from the new pool.
        unsafe {
            encoder.pool = device.raw.create_command_pool(&pool_info, None).map_err(refused)?;
            let info = vk::CommandBufferAllocateInfo::default()
                .command_pool(encoder.pool)
                .level(vk::CommandBufferLevel::PRIMARY)
                .command_buffer_count(1);
            let buffers = device.raw.allocate_command_buffers(&info).map_err(refused)?;
            encoder.commands = buffers.first().copied().unwrap_or_default();
        }
        // Queries are the projectors' queues' alone: one for copies can neither reset them nor, often, tell the time.
        if device.limits.timestamp_period_ns > 0.0 && device.families.first() == Some(&family) {
            let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(QUERIES);
            // SAFETY: a pool of timestamps, which this queue family has.
            encoder.queries = unsafe { device.raw.create_query_pool(&info, None) }.map_err(refused)?;
        }
        Ok(encoder)
    }

    /// Begins the command buffer under a name.
    pub(crate) fn begin(&mut self, name: &str) -> Result<(), GpuError> {
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the encoder is held alone, and its command buffer is in its initial state: new, or reset.
        unsafe {
            self.device.naming.name(self.commands, name);
            self.device
                .raw
                .begin_command_buffer(self.commands, &info)
                .map_err(|result| GpuError::vulkan(format!("beginning {name:?}"), result))?;
            if self.queries != vk::QueryPool::null() {
                self.device.raw.cmd_reset_query_pool(self.commands, self.queries, 0, QUERIES);
            }
        }
        Ok(())
    }

    /// Makes it ready for another recording. The device must be done with it.
    ///
    /// # Safety
    /// The command buffer was never submitted, or has completed.
    pub(crate) unsafe fn reset(&mut self) -> Result<(), GpuError> {
        // SAFETY: by this function's contract, the pool's one command buffer is not pending.
        unsafe { self.device.raw.reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty()) }
            .map_err(|result| GpuError::vulkan("resetting a command buffer", result))
    }
}

impl Drop for Encoder {
    fn drop(&mut self) {
        // SAFETY: an encoder that was submitted is parked until the device is done with it. The command buffer goes
        // with its pool; either pool may be null when its creation failed.
        unsafe {
            self.device.raw.destroy_query_pool(self.queries, None);
            self.device.raw.destroy_command_pool(self.pool, None);
        }
    }
}
