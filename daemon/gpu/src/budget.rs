//! How much device memory there is, and how much of it is free.

use ash::{ext, vk};

use crate::device::Device;

/// The device's own memory: that of its largest heap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MemoryBudget {
    /// What this process may take of it, bytes: less than there is where others take theirs and the driver tells
    /// (`VK_EXT_memory_budget`).
    pub bytes: u64,
    /// What is left of that, bytes.
    pub free_bytes: u64,
}

impl Device {
    /// How much device memory there is now.
    pub fn memory_budget(&self) -> MemoryBudget {
        let handle = self.handle();
        // SAFETY: the physical device is one that this instance listed. One that cannot list its extensions tells of none.
        let listed =
            unsafe { handle.instance.raw().enumerate_device_extension_properties(handle.physical) }.unwrap_or_default();
        let tells = listed.iter().any(|e| e.extension_name_as_c_str() == Ok(ext::memory_budget::NAME));

        let mut budgets = vk::PhysicalDeviceMemoryBudgetPropertiesEXT::default();
        let mut all = vk::PhysicalDeviceMemoryProperties2::default();
        if tells {
            all = all.push_next(&mut budgets);
        }
        // SAFETY: as above; the device speaks 1.3, and knows the structure that is chained where it has its extension.
        unsafe { handle.instance.raw().get_physical_device_memory_properties2(handle.physical, &mut all) };
        let heaps = all.memory_properties;
        let largest = (heaps.memory_heaps_as_slice().iter().enumerate())
            .filter(|(_, heap)| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL))
            .max_by_key(|(_, heap)| heap.size);
        let Some((at, heap)) = largest else { return MemoryBudget::default() };
        let (bytes, used) =
            if tells { (budgets.heap_budget[at], budgets.heap_usage[at]) } else { (heap.size, self.allocated_bytes()) };
        MemoryBudget { bytes, free_bytes: bytes.saturating_sub(used) }
    }
}
