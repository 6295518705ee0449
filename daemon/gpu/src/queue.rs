//! Queues, which projectors share where the device has too few.

use std::sync::{Arc, Mutex};

use ash::vk;

use crate::error::GpuError;
use crate::handle::DeviceHandle;
use crate::ticket::Timeline;

/// A queue for graphics, compute and copies.
pub struct Queue {
    /// The index of its family.
    pub family: u32,
    /// Its index in the family.
    pub index: u32,
    pub(crate) raw: vk::Queue,
    pub(crate) timeline: Arc<Timeline>,
    /// The value of the last submission. Whoever submits holds this lock.
    pub(crate) last: Mutex<u64>,
}

impl std::fmt::Debug for Queue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Queue(family {}, index {})", self.family, self.index)
    }
}

impl Queue {
    /// The queues of a device that was opened with `count` queues of `family`.
    pub(crate) fn all(device: &Arc<DeviceHandle>, family: u32, count: u32) -> Result<Vec<Queue>, GpuError> {
        (0..count)
            .map(|index| {
                let name = format!("queue {index}");
                let timeline = Timeline::new(device, &name)?;
                // SAFETY: the device was created with this many queues of this family.
                let raw = unsafe {
                    let raw = device.raw.get_device_queue(family, index);
                    device.naming.name(raw, &name);
                    raw
                };
                Ok(Queue { family, index, raw, timeline, last: Mutex::new(0) })
            })
            .collect()
    }
}
