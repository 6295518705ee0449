//! The device, as those know it who never talk to it: the frame thread opens it, and tells here what it has opened.

use std::sync::{Mutex, MutexGuard, PoisonError};

use lantern_gpu::Device;
use lantern_proto::status::{DeviceStatus, QueueStatus};

/// What is known.
#[derive(Debug, Default)]
struct Known {
    device: DeviceStatus,
    /// Those of the projectors.
    queues: Vec<QueueStatus>,
}

/// What `status` says of the device and its queues.
#[derive(Debug, Default)]
pub struct Hardware(Mutex<Known>);

impl Hardware {
    fn lock(&self) -> MutexGuard<'_, Known> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// This device renders from now on.
    pub fn opened(&self, device: &Device) {
        let info = device.info();
        let mut known = self.lock();
        known.device = DeviceStatus {
            name: info.name.clone(),
            driver: format!("{} {}", info.driver_name, info.driver_info),
            kind: info.kind.to_owned(),
            ..known.device
        };
        let queue = |at| QueueStatus { family: device.queue(at).family, index: device.queue(at).index, shared: false };
        known.queues = (0..device.queue_count()).map(queue).collect();
    }

    /// It was lost.
    pub fn lost(&self) {
        self.lock().device.lost += 1;
    }

    /// The device.
    pub fn device(&self) -> DeviceStatus {
        self.lock().device.clone()
    }

    /// Where the work of projector `i` of `projectors` is submitted: where there are fewer queues than projectors, these take turns.
    pub fn queue(&self, i: usize, projectors: usize) -> QueueStatus {
        let queues = &self.lock().queues;
        let count = queues.len().max(1);
        let shared = (0..projectors).any(|other| other != i && other % count == i % count);
        QueueStatus { shared, ..queues.get(i % count).copied().unwrap_or_default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn queues_are_shared_where_there_are_fewer_than_projectors() {
        let hardware = Hardware::default();
        hardware.lock().queues = [0, 1].map(|index| QueueStatus { family: 2, index, shared: false }).into();
        let of =
            |projectors| (0..projectors).map(|i| hardware.queue(i, projectors)).map(|q| (q.index, q.shared)).collect();
        let (two, three): (Vec<_>, Vec<_>) = (of(2), of(3));
        assert_eq!(two, [(0, false), (1, false)]);
        assert_eq!(three, [(0, true), (1, false), (0, true)]);
        assert_eq!(hardware.queue(1, 2).family, 2);
    }
}
