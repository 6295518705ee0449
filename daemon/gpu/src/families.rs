//! Which queue families serve: one for the projectors, and one for uploads where the device has engines for copies alone.

use ash::vk;

use crate::instance::Instance;

/// A queue family, as far as the choice depends on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Family {
    pub(crate) index: u32,
    pub(crate) flags: vk::QueueFlags,
    pub(crate) count: u32,
    /// Bits of a timestamp that count; 0 where it has none.
    pub(crate) timestamp_valid_bits: u32,
}

/// The families of a device.
pub(crate) fn all(instance: &Instance, device: vk::PhysicalDevice) -> Vec<Family> {
    // SAFETY: the device is one that this instance listed.
    let families = unsafe { instance.raw().get_physical_device_queue_family_properties(device) };
    (0u32..)
        .zip(families)
        .map(|(index, family)| Family {
            index,
            flags: family.queue_flags,
            count: family.queue_count,
            timestamp_valid_bits: family.timestamp_valid_bits,
        })
        .collect()
}

/// The family whose queues serve the projectors (graphics, compute and so transfer): of several, the one with most queues,
/// since every projector wants its own.
pub(crate) fn serving(families: &[Family]) -> Option<Family> {
    let wanted = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
    let able = families.iter().copied().filter(|family| family.flags.contains(wanted) && family.count > 0);
    able.max_by_key(|family| (family.count, std::cmp::Reverse(family.index)))
}

/// The family for uploads: one that copies and neither draws nor computes, which is how drivers show the engines that copy
/// beside all other work. Of several the one that can do least else, so that video engines are left alone.
pub(crate) fn transfer(families: &[Family]) -> Option<Family> {
    let busy = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
    let able = families.iter().copied().filter(|family| {
        family.flags.contains(vk::QueueFlags::TRANSFER) && !family.flags.intersects(busy) && family.count > 0
    });
    let others = |family: &Family| {
        (family.flags & !(vk::QueueFlags::TRANSFER | vk::QueueFlags::SPARSE_BINDING)).as_raw().count_ones()
    };
    able.min_by_key(|family| (others(family), family.index))
}

#[cfg(test)]
mod tests {
    use super::*;
    use vk::QueueFlags as F;

    fn table(rows: &[(F, u32)]) -> Vec<Family> {
        let family = |(index, (flags, count)): (u32, &(F, u32))| Family {
            index,
            flags: *flags,
            count: *count,
            timestamp_valid_bits: 64,
        };
        (0u32..).zip(rows).map(family).collect()
    }

    fn chosen(rows: &[(F, u32)]) -> (Option<u32>, Option<u32>) {
        let families = table(rows);
        (serving(&families).map(|f| f.index), transfer(&families).map(|f| f.index))
    }

    /// Tables as drivers show them.
    #[test]
    fn copies_go_to_the_engine_that_does_nothing_else() {
        let all = F::GRAPHICS | F::COMPUTE | F::TRANSFER;
        let sparse = F::SPARSE_BINDING;
        // A software driver: one family, one queue.
        assert_eq!(chosen(&[(all, 1)]), (Some(0), None));
        // A discrete one with copy engines, asynchronous compute, and video.
        let rows = [
            (all | sparse, 16),
            (F::TRANSFER | sparse, 2),
            (F::COMPUTE | F::TRANSFER | sparse, 8),
            (F::TRANSFER | F::VIDEO_DECODE_KHR | sparse, 1),
        ];
        assert_eq!(chosen(&rows), (Some(0), Some(1)));
        // Video engines copy as well, and are taken where there is nothing better.
        assert_eq!(chosen(&[(all, 1), (F::TRANSFER | F::VIDEO_ENCODE_KHR, 1)]), (Some(0), Some(1)));
        // In whatever order they come.
        let rows = [(F::TRANSFER | F::VIDEO_DECODE_KHR, 1), (F::COMPUTE | F::TRANSFER, 4), (F::TRANSFER, 1), (all, 1)];
        assert_eq!(chosen(&rows), (Some(3), Some(2)));
        // An integrated one: compute beside graphics, and no copy engine.
        assert_eq!(chosen(&[(all, 1), (F::COMPUTE | F::TRANSFER, 4)]), (Some(0), None));
        // A family without queues is none.
        assert_eq!(chosen(&[(all, 4), (F::TRANSFER, 0), (all, 8)]), (Some(2), None));
        // Nothing that draws: such a device cannot serve.
        assert_eq!(chosen(&[(F::COMPUTE | F::TRANSFER, 4)]).0, None);
    }
}
