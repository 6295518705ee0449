//! The submission of recorded work.

use std::collections::{BTreeMap, BTreeSet};
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
        let name = commands.name().to_owned();
        self.submit_all(vec![commands], wait_for)?.pop().ok_or(GpuError::Order { object: name })
    }

    fn count(&self, more: Work) {
        let mut work = self.work.lock().unwrap_or_else(PoisonError::into_inner);
        work.submissions += more.submissions;
        work.dispatches += more.dispatches;
        work.barriers += more.barriers;
    }

    /// Gives several to their queues, each of which is called once however many are its own. In the order of the list, as far
    /// as they use the same resources; one may build upon those before it, on whichever queue they are.
    ///
    /// # Errors
    /// As for [`Device::submit`]. Where a queue refuses when others have taken their part, that part goes on without it: what
    /// it wrote is undetermined.
    pub fn submit_all(&self, all: Vec<Commands>, wait_for: &[&Submission]) -> Result<Vec<Submission>, GpuError> {
        if let Some(other) = all.iter().find(|commands| !std::ptr::eq(Arc::as_ptr(commands.device()), self)) {
            return Err(GpuError::OtherDevice { object: other.name().into() });
        }
        self.release.collect()?;
        // All locks are taken in the order of the queues, so that two threads never wait for each other.
        let used: BTreeSet<usize> = all.iter().map(Commands::queue).collect();
        let mut last: BTreeMap<usize, _> = (used.into_iter())
            .map(|at| (at, self.queues[at].last.lock().unwrap_or_else(PoisonError::into_inner)))
            .collect();
        let _gate = self.handle.gate.write().unwrap_or_else(PoisonError::into_inner);

        // Every value is known before anything is submitted, so that one queue may be told to wait for what another one has yet
        // to be given.
        let mut values: Vec<u64> = Vec::with_capacity(all.len());
        let mut waits = Vec::with_capacity(all.len());
        for (i, commands) in all.iter().enumerate() {
            let same_queue = all[..i].iter().filter(|before| before.queue() == commands.queue()).count() as u64;
            let base = last.get(&commands.queue()).map_or(0, |last| **last);
            waits.push(self.waits(commands, wait_for, &all[..i], &values)?);
            values.push(base + same_queue + 1);
        }

        let mut refused = None;
        for (at, last) in &mut last {
            let own: Vec<usize> = (0..all.len()).filter(|i| all[*i].queue() == *at).collect();
            let (queue, newest) = (&self.queues[*at], **last + own.len() as u64);
            let parts: Vec<_> = own.iter().map(|i| (&all[*i], &waits[*i], values[*i])).collect();
            if let Err(error) = self.submit_raw(queue, &parts) {
                // Others may wait for these values already.
                queue.timeline.skip_to(**last, newest);
                refused = Some((*at, error));
            }
            **last = newest;
        }
        drop(last);
        let parked = all.into_iter().zip(values).filter(|(commands, _)| {
            // What was refused never happened.
            refused.as_ref().is_none_or(|(at, _)| commands.queue() != *at)
        });
        let submissions = parked.map(|(commands, value)| self.park(commands, value)).collect();
        match refused {
            Some((_, error)) => Err(error),
            None => Ok(submissions),
        }
    }

    /// Keeps what submitted commands use until they have completed.
    fn park(&self, commands: Commands, value: u64) -> Submission {
        let (name, at) = (commands.name().to_owned(), commands.queue());
        let timeline = Arc::clone(&self.queues[at].timeline);
        let (encoder, kept, spans) = commands.submitted(value);
        let times = Arc::new(OnceLock::new());
        let told = Arc::clone(&times);
        self.release.park(Parked { timeline: Arc::clone(&timeline), value, encoder, kept, spans, times: told });
        Submission { name, queue: at, timeline, value, release: Arc::clone(&self.release), times }
    }

    /// What commands must wait for: of each queue but their own, the latest value. `before` are those of the same list that
    /// come before them, with the values that these will have.
    fn waits(
        &self,
        commands: &Commands,
        wait_for: &[&Submission],
        before: &[Commands],
        values: &[u64],
    ) -> Result<Waits, GpuError> {
        let mut all = Vec::new();
        for ticket in commands.depends() {
            let listed = before.iter().position(|other| Arc::ptr_eq(other.ticket(), ticket));
            match (listed, ticket.phase()) {
                (Some(i), _) => all.push((ticket.queue, &ticket.timeline, values[i])),
                (None, Phase::Submitted(value)) => all.push((ticket.queue, &ticket.timeline, value)),
                (None, Phase::Recorded | Phase::Abandoned) => {
                    return Err(GpuError::Order { object: commands.name().into() });
                }
            }
        }
        for submission in wait_for {
            if !Arc::ptr_eq(submission.timeline.device(), &self.handle) {
                return Err(GpuError::OtherDevice { object: submission.name.clone() });
            }
            all.push((submission.queue, &submission.timeline, submission.value));
        }
        let mut waits = Waits::new();
        for (queue, timeline, value) in all {
            if queue != commands.queue() {
                let wait = waits.entry(queue).or_insert_with(|| (Arc::clone(timeline), value));
                wait.1 = wait.1.max(value);
            }
        }
        Ok(waits)
    }

    /// Gives a queue its part, in one call.
    fn submit_raw(&self, queue: &Queue, parts: &[(&Commands, &Waits, u64)]) -> Result<(), GpuError> {
        let semaphore = |timeline: &Timeline, value| {
            vk::SemaphoreSubmitInfo::default()
                .semaphore(timeline.raw())
                .value(value)
                .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
        };
        // Images of surfaces are taken and handed over by semaphores without values.
        let binary =
            |raw| vk::SemaphoreSubmitInfo::default().semaphore(raw).stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS);
        let waits: Vec<Vec<_>> = (parts.iter())
            .map(|(commands, waits, _)| {
                let taken = commands.surface().map(|[taken, _]| binary(taken));
                waits.values().map(|(timeline, value)| semaphore(timeline, *value)).chain(taken).collect()
            })
            .collect();
        let signals: Vec<Vec<_>> = (parts.iter())
            .map(|(commands, _, value)| {
                let drawn = commands.surface().map(|[_, drawn]| binary(drawn));
                let shared = commands.shared().map(|(timeline, value)| binary(timeline.raw()).value(*value));
                [semaphore(&queue.timeline, *value)].into_iter().chain(drawn).chain(shared).collect()
            })
            .collect();
        let buffers: Vec<_> = (parts.iter())
            .map(|(commands, ..)| [vk::CommandBufferSubmitInfo::default().command_buffer(commands.raw())])
            .collect();
        let infos: Vec<_> = (waits.iter().zip(&signals).zip(&buffers))
            .map(|((waits, signals), buffers)| {
                vk::SubmitInfo2::default()
                    .wait_semaphore_infos(waits)
                    .command_buffer_infos(buffers)
                    .signal_semaphore_infos(signals)
            })
            .collect();
        let name = parts.first().map_or("", |(commands, ..)| commands.name());
        // SAFETY: the queue's lock is held by the caller. The command buffers are complete and submitted this once; all
        // that they use, and their timeline, are parked by the caller until they have completed. The semaphores are
        // timelines of this device, or those of a surface's image, which was taken; the values waited for were submitted, or are
        // by the caller after this, which sees to it that they come even where that fails; those signalled are the next: of
        // a shared timeline by the order of `Recorder::hand_out`.
        unsafe { self.handle.raw.queue_submit2(queue.raw, &infos, vk::Fence::null()) }
            .map_err(|result| GpuError::vulkan(format!("submitting {name:?}"), result))?;
        self.count(Work { submissions: 1, ..Work::default() });
        parts.iter().for_each(|(commands, ..)| self.count(commands.work()));
        Ok(())
    }
}

/// By queue, its timeline and the value to wait for.
type Waits = BTreeMap<usize, (Arc<Timeline>, u64)>;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::buffer::{Buffer, BufferKind};
    use crate::cache::PipelineCache;
    use crate::command::Recorder;
    use crate::families;
    use crate::handle::DeviceHandle;
    use crate::instance::{Instance, Validation};
    use crate::select;
    use std::sync::Mutex;
    use std::time::Duration;

    /// A device whose queues are two names of one, so that what is between queues can be tested where there is but one.
    fn with_two_queues(instance: &Arc<Instance>, projector_queues: usize) -> Arc<Device> {
        let devices = instance.devices().unwrap();
        let info = select::choose(&devices, None).unwrap().clone();
        let physical = instance.physical_devices().unwrap()[info.index];
        let family = families::serving(&families::all(instance, physical)).unwrap();
        let handle = DeviceHandle::create(instance, physical, info, (family, None), 1, false).unwrap();
        let mut queues = Queue::all(&handle, family.index, 1).unwrap();
        queues.extend(Queue::all(&handle, family.index, 1).unwrap());
        let cache = PipelineCache::open(&handle, None).unwrap();
        Arc::new(Device { handle, queues, projector_queues, release: Arc::default(), cache, work: Mutex::default() })
    }

    fn buffer(device: &Arc<Device>, kind: BufferKind) -> Arc<Buffer> {
        Buffer::new(device, "buffer", kind, 64).unwrap()
    }

    #[test]
    fn work_of_another_queue_is_waited_for_without_being_told() {
        let instance = Instance::new(Validation::On).unwrap();
        let device = with_two_queues(&instance, 2);
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
        let device = with_two_queues(&instance, 2);
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
        assert_eq!(values(device.waits(&third, &[], &[], &[]).unwrap()), [(0, later.value)]);
        assert_eq!(values(device.waits(&third, &[&submission], &[], &[]).unwrap()), [(0, later.value)]);
        let third = device.submit(third, &[&submission]).unwrap();
        let own = Recorder::new(&device, 1, "own").unwrap().finish().unwrap();
        assert_eq!(values(device.waits(&own, &[&third], &[], &[]).unwrap()), []);
        assert_eq!(values(device.waits(&own, &[&later, &third, &submission], &[], &[]).unwrap()), [(0, later.value)]);
        drop(own);
        third.wait(Duration::from_secs(60)).unwrap();
        assert!(submission.is_done().unwrap());
        drop((data, submission, later, third, device));
        assert_eq!(instance.validation_messages(), Vec::<String>::new());
    }

    #[test]
    fn a_list_is_one_call_a_queue_and_may_cross_between_them() {
        let instance = Instance::new(Validation::On).unwrap();
        let device = with_two_queues(&instance, 2);
        let (left, right) = (buffer(&device, BufferKind::Storage), buffer(&device, BufferKind::Storage));
        let back = [buffer(&device, BufferKind::Readback), buffer(&device, BufferKind::Readback)];
        let calls = device.work().submissions;
        // Each queue writes its own, two recordings of each, in one call of each; the second call reads what the first one wrote.
        // Not the other way as well: the two are one queue here, whose calls come one after the other.
        let mut all = Vec::new();
        for (queue, own, value) in [(0, &left, 7), (1, &right, 9)] {
            let mut recorder = Recorder::new(&device, queue, "writes").unwrap();
            recorder.fill(own, value).unwrap();
            all.push(recorder.finish().unwrap());
        }
        for (queue, other) in [(0, &left), (1, &left)] {
            let mut recorder = Recorder::new(&device, queue, "reads").unwrap();
            recorder.copy_buffer(other, 0, &back[queue], 0, 64).unwrap();
            all.push(recorder.finish().unwrap());
        }
        let submissions = device.submit_all(all, &[]).unwrap();
        assert_eq!(device.work().submissions - calls, 2);
        assert_eq!(
            submissions.iter().map(|s| (s.queue, s.value)).collect::<Vec<_>>(),
            [(0, 1), (1, 1), (0, 2), (1, 2)]
        );
        for submission in &submissions {
            submission.wait(Duration::from_secs(60)).unwrap();
        }
        let words = [0, 1].map(|i: usize| back[i].read(0, 4).unwrap());
        assert_eq!(words, [7u32.to_ne_bytes().to_vec(), 7u32.to_ne_bytes().to_vec()]);

        // Out of order, nothing is submitted.
        let mut first = Recorder::new(&device, 0, "first").unwrap();
        first.fill(&left, 1).unwrap();
        let mut second = Recorder::new(&device, 1, "second").unwrap();
        second.copy_buffer(&left, 0, &back[1], 0, 64).unwrap();
        let (first, second) = (first.finish().unwrap(), second.finish().unwrap());
        assert!(matches!(device.submit_all(vec![second, first], &[]), Err(GpuError::Order { .. })));
        assert_eq!(device.work().submissions - calls, 2);
        drop((left, right, back, submissions, device));
        assert_eq!(instance.validation_messages(), Vec::<String>::new());
    }

    #[test]
    fn uploads_have_a_queue_of_their_own_where_there_is_one_and_frames_wait_for_it() {
        let instance = Instance::new(Validation::On).unwrap();
        let device = with_two_queues(&instance, 1);
        assert_eq!((device.queue_count(), device.upload_at()), (1, 1));
        let staging = buffer(&device, BufferKind::Staging);
        let (data, back) = (buffer(&device, BufferKind::Storage), buffer(&device, BufferKind::Readback));
        for turn in 0..20u8 {
            // While the frame before reads the first half, the second half is written.
            staging.write(0, &[turn; 64]).unwrap();
            let mut upload = Recorder::for_uploads(&device, "slice").unwrap();
            let half = |at| crate::CopyRegion { src_offset: at, dst_offset: at, bytes: 32 };
            upload.copy_regions(&staging, &data, &[half(32), half(0)]).unwrap();
            let upload = device.submit(upload.finish().unwrap(), &[]).unwrap();
            let mut frame = Recorder::new(&device, 5, "frame").unwrap();
            frame.copy_buffer(&data, 0, &back, 0, 64).unwrap();
            let frame = device.submit(frame.finish().unwrap(), &[]).unwrap();
            assert_eq!((upload.queue, frame.queue), (1, 0));
            frame.wait(Duration::from_secs(60)).unwrap();
            assert_eq!(back.read(0, 64).unwrap(), [turn; 64]);
        }
        drop((staging, data, back, device));
        assert_eq!(instance.validation_messages(), Vec::<String>::new());
    }

    #[test]
    fn copies_of_several_ranges_are_checked() {
        let instance = Instance::new(Validation::On).unwrap();
        let device = Device::open(&instance, None, 1, None).unwrap();
        assert_eq!(device.upload_queue().family, device.queue(0).family, "the reference driver has one family");
        let (from, to) = (buffer(&device, BufferKind::Staging), buffer(&device, BufferKind::Storage));
        let mut recorder = Recorder::for_uploads(&device, "slice").unwrap();
        let region = |src_offset, dst_offset, bytes| crate::CopyRegion { src_offset, dst_offset, bytes };
        let mut copy = |from: &Arc<Buffer>, regions: &[crate::CopyRegion]| recorder.copy_regions(from, &to, regions);
        assert!(matches!(copy(&from, &[region(0, 60, 8)]), Err(GpuError::Range { .. })));
        assert!(matches!(copy(&from, &[region(0, 8, 8), region(0, 0, 12)]), Err(GpuError::Misuse { .. })));
        assert!(matches!(copy(&to, &[region(0, 8, 8)]), Err(GpuError::Misuse { .. })));
        copy(&from, &[]).unwrap();
        copy(&from, &[region(0, 8, 8), region(0, 0, 8), region(3, 9, 0)]).unwrap();
        assert_eq!(recorder.barriers(), 0);
        drop(recorder);
        drop((from, to, device));
        assert_eq!(instance.validation_messages(), Vec::<String>::new());
    }
}
