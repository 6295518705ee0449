//! Recording commands, with the barriers that they need.

mod copy;
mod draw;
mod hand_out;
mod recording;
mod structure;
mod uses;

use std::sync::{Arc, PoisonError};

use ash::vk;

use crate::access::{Access, AccessSet};
use crate::barrier::{Covered, Gathered};
use crate::binding::{Bindings, layout_of};
use crate::buffer::{Buffer, BufferKind};
use crate::device::Device;
use crate::encoder::{Encoder, QUERIES};
use crate::error::GpuError;
use crate::layout::Layout;
use crate::pipeline::ComputePipeline;
use recording::Recording;
use uses::Uses;

pub use copy::CopyRegion;
pub use draw::{Draws, Load};
pub use recording::Commands;

/// Records commands for one queue.
///
/// Operations run as if one after the other: before each the recorder puts what barrier it needs, and none where
/// operations do not touch the same thing or only read it. Buffers and images remember their uses in the order of
/// recording, on whichever recorder and thread, so commands that touch the same things must be submitted in that
/// order; several recorders may be open at once, as one for each projector. Work of another queue that is built upon
/// is waited for on the device when the commands are submitted.
///
/// A call that fails records nothing. What is dropped without being submitted never happened.
pub struct Recorder {
    recording: Recording,
    covered: Covered,
    /// Counts operations, from 1.
    operation: u64,
    /// Whether mapped buffers were written, which the host must see.
    written_for_host: bool,
    next_query: u32,
    /// Spans that have begun and not ended: each will need one more query.
    open_spans: u32,
    /// Set while a rendering is open, and for good when one was left open by a panic.
    in_rendering: bool,
    /// Whether it is for the queue of uploads.
    copies_alone: bool,
}

impl std::fmt::Debug for Recorder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Recorder({:?}, {} operations)", self.recording.name, self.operation)
    }
}

impl Recorder {
    /// Begins a recording for the queue of projector `queue` (see [`Device::queue`]).
    ///
    /// # Errors
    /// No memory, or [`GpuError::DeviceLost`].
    pub fn new(device: &Arc<Device>, queue: usize, name: &str) -> Result<Recorder, GpuError> {
        Recorder::on(device, queue % device.queue_count(), name, false)
    }

    /// Begins a recording for the queue of uploads, which is one for copies alone where the device has one: nothing else can be
    /// recorded, whatever the device.
    ///
    /// # Errors
    /// No memory, or [`GpuError::DeviceLost`].
    pub fn for_uploads(device: &Arc<Device>, name: &str) -> Result<Recorder, GpuError> {
        Recorder::on(device, device.upload_at(), name, true)
    }

    fn on(device: &Arc<Device>, at: usize, name: &str, copies_alone: bool) -> Result<Recorder, GpuError> {
        let family = device.queues[at].family;
        let mut encoder = match device.release().take_spare(family) {
            Some(encoder) => encoder,
            None => Encoder::new(device.handle(), family)?,
        };
        encoder.begin(name)?;
        let recording = Recording {
            device: Arc::clone(device),
            name: name.into(),
            ticket: device.ticket(at),
            depends: Vec::new(),
            kept: Vec::new(),
            spans: Vec::new(),
            barriers: 0,
            dispatches: 0,
            surface: None,
            shared: None,
            encoder: Some(encoder),
        };
        let mut recorder = Recorder {
            recording,
            covered: Covered::default(),
            operation: 0,
            written_for_host: false,
            next_query: 0,
            open_spans: 0,
            in_rendering: false,
            copies_alone,
        };
        recorder.timestamp();
        Ok(recorder)
    }

    /// Records `f` under a label, with a timestamp at both ends: the frame of a pass.
    ///
    /// # Errors
    /// Those of `f`, and [`GpuError::Misuse`] for more spans than a recording has timestamps for (127).
    pub fn span<R>(
        &mut self,
        name: &'static str,
        f: impl FnOnce(&mut Recorder) -> Result<R, GpuError>,
    ) -> Result<R, GpuError> {
        self.check_outside()?;
        if self.next_query + self.open_spans + 2 > QUERIES {
            return Err(GpuError::misuse(&self.recording.name, format!("no timestamps are left for span {name:?}")));
        }
        let (commands, ticket) = (self.recording.commands(), Arc::clone(&self.recording.ticket));
        // SAFETY: the command buffer is being recorded, by this recorder alone.
        unsafe { self.device().handle().naming.begin(commands, name) };
        let first = self.timestamp();
        self.open_spans += 1;
        let result = f(self);

        // Whatever `f` did to the place behind its reference, only the recording that began the span may end it.
        if !Arc::ptr_eq(&self.recording.ticket, &ticket) || self.in_rendering {
            self.in_rendering = true;
            return Err(GpuError::misuse(&self.recording.name, format!("span {name:?} ended in another recording")));
        }
        self.open_spans -= 1;
        let last = self.timestamp();
        // SAFETY: as above, and the label was opened in this very recording.
        unsafe { self.device().handle().naming.end(commands) };
        self.recording.spans.push((name, first, last));
        result
    }

    /// Runs a compute pipeline on `groups` workgroups.
    ///
    /// # Errors
    /// [`GpuError::Binding`] for bindings of another table, [`GpuError::PushConstants`] for another size than the
    /// shader declares, [`GpuError::TooLarge`] for too many workgroups, [`GpuError::Unwritten`].
    pub fn dispatch(
        &mut self,
        pipeline: &Arc<ComputePipeline>,
        bindings: &Arc<Bindings>,
        push: &[u8],
        groups: [u32; 3],
    ) -> Result<(), GpuError> {
        self.check_outside()?;
        self.check_pipeline(&pipeline.layout, bindings, push)?;
        for (asked, limit) in groups.into_iter().zip(self.device().limits().max_groups) {
            if asked > limit {
                return Err(GpuError::TooLarge {
                    object: pipeline.name().into(),
                    asked: asked.into(),
                    limit: limit.into(),
                    unit: "workgroups",
                });
            }
        }
        let mut uses = Uses::default();
        uses.add_bindings(bindings)?;
        self.apply(&uses)?;
        self.bind(vk::PipelineBindPoint::COMPUTE, pipeline.raw, &pipeline.layout, bindings, push);
        // SAFETY: pipeline, bindings and push constants are bound, all for this layout; the counts are within limits.
        unsafe { self.raw().cmd_dispatch(self.recording.commands(), groups[0], groups[1], groups[2]) };
        self.recording.dispatches += 1;
        self.keep(pipeline);
        self.keep(bindings);
        Ok(())
    }

    /// Runs a compute pipeline on as many workgroups as the three words at the beginning of `counts` say when the device
    /// gets there. What writes them is trusted as every shader is, to stay within the device's limit.
    ///
    /// # Errors
    /// As for [`Recorder::dispatch`], and [`GpuError::Misuse`] for a buffer of another kind than storage.
    pub fn dispatch_indirect(
        &mut self,
        pipeline: &Arc<ComputePipeline>,
        bindings: &Arc<Bindings>,
        push: &[u8],
        counts: &Arc<Buffer>,
    ) -> Result<(), GpuError> {
        self.dispatch_indirect_at(pipeline, bindings, push, (counts, 0))
    }

    /// The same, where the three words stand at an offset into the buffer, bytes.
    ///
    /// # Errors
    /// As for [`Recorder::dispatch_indirect`]; and [`GpuError::Misuse`] for an offset that is no multiple of 4.
    pub fn dispatch_indirect_at(
        &mut self,
        pipeline: &Arc<ComputePipeline>,
        bindings: &Arc<Bindings>,
        push: &[u8],
        (counts, offset): (&Arc<Buffer>, u64),
    ) -> Result<(), GpuError> {
        self.check_outside()?;
        self.check_pipeline(&pipeline.layout, bindings, push)?;
        if counts.kind() != BufferKind::Storage {
            return Err(GpuError::misuse(counts.name(), "counts of an indirect dispatch lie in a storage buffer"));
        }
        if !offset.is_multiple_of(4) {
            return Err(GpuError::misuse(counts.name(), "counts of an indirect dispatch begin at a whole word"));
        }
        counts.check_range(offset, 12)?;
        let mut uses = Uses::default();
        uses.add_bindings(bindings)?;
        uses.add_buffer(counts, AccessSet::of(Access::Indirect));
        self.apply(&uses)?;
        self.bind(vk::PipelineBindPoint::COMPUTE, pipeline.raw, &pipeline.layout, bindings, push);
        // SAFETY: pipeline, bindings and push constants are bound, all for this layout; the buffer may hold counts, has
        // three words at the offset, is kept below and was made available by the barrier before.
        unsafe { self.raw().cmd_dispatch_indirect(self.recording.commands(), counts.raw, offset) };
        self.recording.dispatches += 1;
        self.keep(pipeline);
        self.keep(bindings);
        self.keep(counts);
        Ok(())
    }

    /// How many barriers stand in the recording so far: each costs the device a pause, so tests of passes count them.
    pub fn barriers(&self) -> u32 {
        self.recording.barriers
    }

    /// Ends the recording. What it wrote to mapped buffers, the host will see once it has completed.
    ///
    /// # Errors
    /// No memory, or [`GpuError::Misuse`] when a rendering was left by a panic.
    pub fn finish(mut self) -> Result<Commands, GpuError> {
        self.check_outside()?;
        self.show_host();
        // SAFETY: the command buffer is being recorded, outside of a rendering; this recorder is its only user.
        unsafe { self.raw().end_command_buffer(self.recording.commands()) }
            .map_err(|result| GpuError::vulkan(format!("ending {:?}", self.recording.name), result))?;
        Ok(Commands(self.recording))
    }

    /// Makes what was written to mapped buffers, which is done by copies alone, visible to the host.
    fn show_host(&mut self) {
        if !self.written_for_host {
            return;
        }
        self.written_for_host = false;
        self.operation += 1;
        let mut gathered = Gathered::default();
        gathered.add_always(AccessSet::of(Access::CopyWrite), AccessSet::of(Access::HostRead));
        self.flush(gathered);
    }

    /// Puts a gathered barrier before the operation that is about to be recorded.
    fn flush(&mut self, gathered: Gathered) {
        let handle = Arc::clone(self.device().handle());
        let commands = self.recording.commands();
        // SAFETY: the command buffer is being recorded, outside of a rendering; the images in the barrier are of this
        // device, in the layout that their history says, and are kept by whoever records the operation.
        let emit = |info: &vk::DependencyInfo<'_>| unsafe { handle.raw.cmd_pipeline_barrier2(commands, info) };
        if gathered.flush(&mut self.covered, self.operation, emit) {
            self.recording.barriers += 1;
        }
    }

    fn device(&self) -> &Arc<Device> {
        &self.recording.device
    }

    fn raw(&self) -> &ash::Device {
        &self.recording.device.handle().raw
    }

    fn keep<T: Send + Sync + 'static>(&mut self, object: &Arc<T>) {
        self.recording.kept.push(Arc::clone(object) as crate::release::Kept);
    }

    /// Refuses what may not stand inside a rendering.
    fn check_outside(&self) -> Result<(), GpuError> {
        if self.in_rendering {
            return Err(GpuError::misuse(&self.recording.name, "a rendering was left open in this recording"));
        }
        Ok(())
    }

    /// Refuses what a queue for copies alone cannot do.
    fn check_draws_and_computes(&self) -> Result<(), GpuError> {
        if self.copies_alone {
            return Err(GpuError::misuse(&self.recording.name, "a recording of uploads holds copies of buffers alone"));
        }
        Ok(())
    }

    fn check_pipeline(&self, layout: &Layout, bindings: &Bindings, push: &[u8]) -> Result<(), GpuError> {
        self.check_draws_and_computes()?;
        if !Arc::ptr_eq(&layout.device, self.device().handle()) {
            return Err(GpuError::OtherDevice { object: layout.name.clone() });
        }
        if !bindings.layout.serves(layout) {
            let problem = format!("these bindings were made for {:?}, whose table differs", bindings.layout.name);
            return Err(GpuError::Binding { pipeline: layout.name.clone(), binding: "*".into(), problem });
        }
        if push.len() != layout.push_bytes as usize {
            return Err(GpuError::PushConstants {
                pipeline: layout.name.clone(),
                given: push.len(),
                declared: layout.push_bytes,
            });
        }
        Ok(())
    }

    /// Binds a pipeline with its resources, which `check_pipeline` has found to fit.
    fn bind(
        &self,
        point: vk::PipelineBindPoint,
        pipeline: vk::Pipeline,
        layout: &Layout,
        bindings: &Bindings,
        push: &[u8],
    ) {
        let commands = self.recording.commands();
        // SAFETY: the command buffer is being recorded; pipeline, set and push constants are all of compatible
        // layouts of this device, and are kept until the recording has completed.
        unsafe {
            self.raw().cmd_bind_pipeline(commands, point, pipeline);
            self.raw().cmd_bind_descriptor_sets(commands, point, layout.raw, 0, &[bindings.set], &[]);
            if !push.is_empty() {
                self.raw().cmd_push_constants(commands, layout.raw, layout.stages, 0, push);
            }
        }
    }

    /// Starts an operation that uses `uses`: checks them, and puts the barrier before it.
    fn apply(&mut self, uses: &Uses) -> Result<(), GpuError> {
        // Everything that can fail comes first, so that a refused operation leaves no trace.
        let handle = Arc::clone(self.device().handle());
        for (buffer, _) in &uses.buffers {
            if !Arc::ptr_eq(&buffer.device, &handle) {
                return Err(GpuError::OtherDevice { object: buffer.name().into() });
            }
        }
        for used in &uses.images {
            if !Arc::ptr_eq(&used.image.device, &handle) {
                return Err(GpuError::OtherDevice { object: used.image.name().into() });
            }
            let history = used.image.history.lock().unwrap_or_else(PoisonError::into_inner);
            if used.needs_contents && history.layout() == vk::ImageLayout::UNDEFINED {
                return Err(GpuError::Unwritten { object: used.image.name().into() });
            }
        }

        self.operation += 1;
        let mut gathered = Gathered::default();
        for (buffer, accesses) in &uses.buffers {
            let mut history = buffer.history.lock().unwrap_or_else(PoisonError::into_inner);
            let before = history.note(&self.recording.ticket, self.operation, *accesses, None);
            drop(history);
            gathered.add(&self.covered, &before, *accesses);
            self.depend(before.tickets);
            self.written_for_host |= accesses.writes() && buffer.is_mapped();
        }
        for used in &uses.images {
            let layout = layout_of(used.accesses);
            let mut history = used.image.history.lock().unwrap_or_else(PoisonError::into_inner);
            let mut before = history.note(&self.recording.ticket, self.operation, used.accesses, Some(layout));
            drop(history);
            // As from another queue: a semaphore gives the image, before all stages.
            before.elsewhere |= used.image.is_of_swapchain();
            if before.layout == layout {
                gathered.add(&self.covered, &before, used.accesses);
            } else {
                gathered.add_layout(used.image.raw, used.image.range(), &before, used.accesses, layout);
            }
            self.depend(before.tickets);
        }

        self.flush(gathered);
        Ok(())
    }

    fn depend(&mut self, tickets: Vec<Arc<crate::ticket::Ticket>>) {
        for ticket in tickets {
            if !self.recording.depends.iter().any(|known| Arc::ptr_eq(known, &ticket)) {
                self.recording.depends.push(ticket);
            }
        }
    }

    /// Writes the next timestamp and returns its number. The caller has seen that one is left.
    fn timestamp(&mut self) -> u32 {
        let (query, queries) = (self.next_query, self.recording.queries());
        self.next_query += 1;
        if queries != vk::QueryPool::null() {
            // SAFETY: the command buffer is being recorded; the query is in the pool, since `span` sees to it that one is
            // left, was reset at the beginning, and is written this once.
            unsafe {
                self.raw().cmd_write_timestamp2(
                    self.recording.commands(),
                    vk::PipelineStageFlags2::ALL_COMMANDS,
                    queries,
                    query,
                );
            }
        }
        query
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::buffer::{Buffer, BufferKind};
    use crate::instance::{Instance, Validation};

    /// The silence that other tests demand of the layer means something only if it can speak: here two fills of one
    /// buffer are put in behind the recorder's back, without a barrier between them.
    #[test]
    fn the_layer_hears_a_missing_barrier() {
        let instance = Instance::new(Validation::On).unwrap();
        let device = Device::open(&instance, None, 1, None).unwrap();
        let buffer = Buffer::new(&device, "victim", BufferKind::Storage, 64).unwrap();
        let recorder = Recorder::new(&device, 0, "careless").unwrap();
        for value in [1, 2] {
            // SAFETY: recording, outside of a rendering, into a buffer that lives until the end of this test; the
            // commands are never submitted.
            unsafe {
                recorder.raw().cmd_fill_buffer(recorder.recording.commands(), buffer.raw, 0, vk::WHOLE_SIZE, value);
            }
        }
        drop(recorder);
        let messages = instance.validation_messages();
        assert!(messages.iter().any(|message| message.contains("SYNC-HAZARD-WRITE-AFTER-WRITE")), "{messages:?}");
    }

    #[test]
    fn what_the_host_will_read_is_made_visible_to_it() {
        let instance = Instance::new(Validation::On).unwrap();
        let device = Device::open(&instance, None, 1, None).unwrap();
        let storage = Buffer::new(&device, "storage", BufferKind::Storage, 64).unwrap();
        let readback = Buffer::new(&device, "readback", BufferKind::Readback, 64).unwrap();
        // Device memory, which the host does not see, needs one barrier: it is filled once more.
        for (buffer, barriers) in [(&storage, 1), (&readback, 2)] {
            let mut recorder = Recorder::new(&device, 0, "host").unwrap();
            recorder.fill(buffer, 1).unwrap();
            recorder.fill(buffer, 2).unwrap();
            assert_eq!(recorder.barriers(), 1);
            let commands = recorder.finish().unwrap();
            assert_eq!(commands.0.barriers, barriers);
        }
        drop((storage, readback, device));
        assert_eq!(instance.validation_messages(), Vec::<String>::new());
    }

    /// And the same for what is not about synchronisation.
    #[test]
    fn the_layer_hears_a_bad_create_info() {
        let instance = Instance::new(Validation::On).unwrap();
        let device = Device::open(&instance, None, 1, None).unwrap();
        let info = vk::SamplerCreateInfo::default().min_lod(2.0).max_lod(1.0);
        // SAFETY: the driver takes no harm from a range of levels that is empty; the sampler is destroyed at once.
        unsafe {
            let sampler = device.handle().raw.create_sampler(&info, None).unwrap();
            device.handle().raw.destroy_sampler(sampler, None);
        }
        assert!(!instance.validation_messages().is_empty());
    }
}
