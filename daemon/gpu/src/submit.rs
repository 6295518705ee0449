//! The submission of recorded work.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock, PoisonError};

use ash::vk;

use crate::command::Commands;
use crate::device::{Device, Work};
use crate::error::GpuError;
use crate::queue::Queue;
use crate::release::Parked;
use crate::submission::Submission;
use crate::ticket::{Phase, Timeline};

impl Device {
    /// Gives recorded commands to their queue.
    ///
    /// Commands must be submitted in the order of their recording, as far as they use the same resources: the barriers
    /// in them rely on it. What they use and another queue used before is waited for on the device, with its memory;
    /// `wait_for` adds more to wait for.
    ///
    /// # Errors
    /// [`GpuError::Order`] where commands that these depend on were not submitted, [`GpuError::OtherDevice`],
    /// [`GpuError::DeviceLost`] or no memory. The commands are dropped then, as if never recorded.
    pub fn submit(&self, commands: Commands, wait_for: &[&Submission]) -> Result<Submission, GpuError> {
        if !std::ptr::eq(Arc::as_ptr(commands.device()), self) {
            return Err(GpuError::OtherDevice { object: commands.name().into() });
        }
        self.release.collect()?;
        let at = commands.queue();
        let queue = &self.queues[at];
        let mut last = queue.last.lock().unwrap_or_else(PoisonError::into_inner);
        let _gate = self.handle.gate.write().unwrap_or_else(PoisonError::into_inner);

        let waits = self.waits(&commands, wait_for)?;
        let value = *last + 1;
        self.submit_raw(queue, &commands, waits.values(), value)?;
        *last = value;
        self.count(commands.work());
        let name = commands.name().to_owned();
        let (encoder, kept, spans) = commands.submitted(value);
        let times = Arc::new(OnceLock::new());
        let (timeline, told) = (Arc::clone(&queue.timeline), Arc::clone(&times));
        self.release.park(Parked { timeline, value, encoder, kept, spans, times: told });
        Ok(Submission {
            name,
            queue: at,
            timeline: Arc::clone(&queue.timeline),
            value,
            release: Arc::clone(&self.release),
            times,
        })
    }

    fn count(&self, more: Work) {
        let mut work = self.work.lock().unwrap_or_else(PoisonError::into_inner);
        work.submissions += more.submissions;
        work.dispatches += more.dispatches;
        work.barriers += more.barriers;
    }

    /// What commands must wait for: of each queue but their own, the latest value.
    fn waits(
        &self,
        commands: &Commands,
        wait_for: &[&Submission],
    ) -> Result<BTreeMap<usize, (Arc<Timeline>, u64)>, GpuError> {
        let mut all = Vec::new();
        for ticket in commands.depends() {
            match ticket.phase() {
                Phase::Submitted(value) => all.push((ticket.queue, &ticket.timeline, value)),
                Phase::Recorded | Phase::Abandoned => return Err(GpuError::Order { object: commands.name().into() }),
            }
        }
        for submission in wait_for {
            if !Arc::ptr_eq(submission.timeline.device(), &self.handle) {
                return Err(GpuError::OtherDevice { object: submission.name.clone() });
            }
            all.push((submission.queue, &submission.timeline, submission.value));
        }
        let mut waits: BTreeMap<usize, (Arc<Timeline>, u64)> = BTreeMap::new();
        for (queue, timeline, value) in all {
            if queue != commands.queue() {
                let wait = waits.entry(queue).or_insert_with(|| (Arc::clone(timeline), value));
                wait.1 = wait.1.max(value);
            }
        }
        Ok(waits)
    }

    fn submit_raw<'a>(
        &self,
        queue: &Queue,
        commands: &Commands,
        waits: impl Iterator<Item = &'a (Arc<Timeline>, u64)>,
        value: u64,
    ) -> Result<(), GpuError> {
        let semaphore = |timeline: &Timeline, value| {
            vk::SemaphoreSubmitInfo::default()
                .semaphore(timeline.raw())
                .value(value)
                .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
        };
        let waits: Vec<_> = waits.map(|(timeline, value)| semaphore(timeline, *value)).collect();
        let signals = [semaphore(&queue.timeline, value)];
        let buffers = [vk::CommandBufferSubmitInfo::default().command_buffer(commands.raw())];
        let info = vk::SubmitInfo2::default()
            .wait_semaphore_infos(&waits)
            .command_buffer_infos(&buffers)
            .signal_semaphore_infos(&signals);
        // SAFETY: the queue's lock is held by the caller. The command buffer is complete and submitted this once; all
        // that it uses, and its timeline, are parked by the caller until it has completed. The semaphores are
        // timelines of this device; the values waited for were submitted, and the one signalled is the next.
        unsafe { self.handle.raw.queue_submit2(queue.raw, &[info], vk::Fence::null()) }
            .map_err(|result| GpuError::vulkan(format!("submitting {:?}", commands.name()), result))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::buffer::{Buffer, BufferKind};
    use crate::cache::PipelineCache;
    use crate::command::Recorder;
    use crate::handle::DeviceHandle;
    use crate::info;
    use crate::instance::{Instance, Validation};
    use crate::select;
    use std::sync::Mutex;
    use std::time::Duration;

    /// A device whose queues are two names of one, so that what is between queues can be tested where there is but one.
    fn with_two_queues(instance: &Arc<Instance>) -> Arc<Device> {
        let devices = instance.devices().unwrap();
        let info = select::choose(&devices, None).unwrap().clone();
        let physical = instance.physical_devices().unwrap()[info.index];
        let (family, family_info) = info::serving_family(instance, physical).unwrap();
        let handle = DeviceHandle::create(instance, physical, info, (family, family_info), 1, false).unwrap();
        let mut queues = Queue::all(&handle, family, 1).unwrap();
        queues.extend(Queue::all(&handle, family, 1).unwrap());
        let cache = PipelineCache::open(&handle, None).unwrap();
        Arc::new(Device { handle, queues, release: Arc::default(), cache, work: Mutex::default() })
    }

    fn buffer(device: &Arc<Device>, kind: BufferKind) -> Arc<Buffer> {
        Buffer::new(device, "buffer", kind, 64).unwrap()
    }

    #[test]
    fn work_of_another_queue_is_waited_for_without_being_told() {
        let instance = Instance::new(Validation::On).unwrap();
        let device = with_two_queues(&instance);
        let data = buffer(&device, BufferKind::Storage);
        let back = buffer(&device, BufferKind::Readback);
        let mut last = None;
        for turn in 0..20u32 {
            // One queue writes, the other reads: each waits for the other's last.
            let mut writer = Recorder::new(&device, 0, "writer").unwrap();
            writer.fill(&data, turn).unwrap();
            assert_eq!(writer.barriers(), 0, "the semaphore needs no barrier beside it");
            let mut reader = Recorder::new(&device, 1, "reader").unwrap();
            reader.copy_buffer(&data, 0, &back, 0, 64).unwrap();
            let (writer, reader) = (writer.finish().unwrap(), reader.finish().unwrap());
            assert_eq!(writer.depends().len(), usize::from(turn > 0));
            assert!(reader.depends().iter().any(|ticket| ticket.queue == 0));
            device.submit(writer, &[]).unwrap();
            last = Some(device.submit(reader, &[]).unwrap());
        }
        last.unwrap().wait(Duration::from_secs(60)).unwrap();
        assert_eq!(back.read(0, 4).unwrap(), 19u32.to_ne_bytes());
        drop((data, back, device));
        assert_eq!(instance.validation_messages(), Vec::<String>::new());
    }

    #[test]
    fn order_is_kept_between_queues_as_well() {
        let instance = Instance::new(Validation::On).unwrap();
        let device = with_two_queues(&instance);
        let data = buffer(&device, BufferKind::Storage);
        let mut first = Recorder::new(&device, 0, "first").unwrap();
        first.fill(&data, 1).unwrap();
        let mut second = Recorder::new(&device, 1, "second").unwrap();
        second.fill(&data, 2).unwrap();
        let refused = device.submit(second.finish().unwrap(), &[]);
        assert!(matches!(refused, Err(GpuError::Order { .. })));
        let submission = device.submit(first.finish().unwrap(), &[]).unwrap();

        // What the caller names is waited for beside what is known: of each queue the latest, and not the own queue.
        let mut later = Recorder::new(&device, 0, "later").unwrap();
        later.fill(&data, 3).unwrap();
        let later = device.submit(later.finish().unwrap(), &[]).unwrap();
        let mut third = Recorder::new(&device, 1, "third").unwrap();
        third.fill(&data, 4).unwrap();
        let third = third.finish().unwrap();
        let values = |waits: BTreeMap<usize, (Arc<Timeline>, u64)>| {
            waits.into_iter().map(|(queue, (_, value))| (queue, value)).collect::<Vec<_>>()
        };
        assert_eq!(values(device.waits(&third, &[]).unwrap()), [(0, later.value)]);
        assert_eq!(values(device.waits(&third, &[&submission]).unwrap()), [(0, later.value)]);
        let third = device.submit(third, &[&submission]).unwrap();
        let own = Recorder::new(&device, 1, "own").unwrap().finish().unwrap();
        assert_eq!(values(device.waits(&own, &[&third]).unwrap()), []);
        assert_eq!(values(device.waits(&own, &[&later, &third, &submission]).unwrap()), [(0, later.value)]);
        drop(own);
        third.wait(Duration::from_secs(60)).unwrap();
        assert!(submission.is_done().unwrap());
        drop((data, submission, later, third, device));
        assert_eq!(instance.validation_messages(), Vec::<String>::new());
    }
}
