//! The barrier before one operation: gathered from all its hazards, emitted once.

use ash::vk;

use crate::access::{Access, AccessSet};
use crate::history::Before;

/// Which accesses were made to wait for which, so that no barrier is said twice: for each pair, the operation before
/// which the last such barrier stands. 0: none in this recording.
pub(crate) struct Covered([[u64; Access::COUNT]; Access::COUNT]);

impl Default for Covered {
    fn default() -> Covered {
        Covered([[0; Access::COUNT]; Access::COUNT])
    }
}

impl Covered {
    /// Whether a barrier since `operation` orders all of `first` before all of `then`.
    fn covers(&self, first: AccessSet, operation: u64, then: AccessSet) -> bool {
        first.iter().all(|a| then.iter().all(|b| self.0[a as usize][b as usize] > operation))
    }

    fn note(&mut self, first: AccessSet, then: AccessSet, operation: u64) {
        for a in first.iter() {
            for b in then.iter() {
                self.0[a as usize][b as usize] = operation;
            }
        }
    }
}

/// The barrier that is being gathered for one operation.
#[derive(Default)]
pub(crate) struct Gathered {
    first: AccessSet,
    then: AccessSet,
    images: Vec<vk::ImageMemoryBarrier2<'static>>,
    buffers: Vec<vk::BufferMemoryBarrier2<'static>>,
}

impl Gathered {
    /// Adds what `before` asks for ahead of accesses `then`.
    pub(crate) fn add(&mut self, covered: &Covered, before: &Before, then: AccessSet) {
        for &(first, operation) in &before.here {
            if !covered.covers(first, operation, then) {
                self.first.insert(first);
                self.then.insert(then);
            }
        }
    }

    /// Adds an order of all of `first` before all of `then`, whatever stands already.
    pub(crate) fn add_always(&mut self, first: AccessSet, then: AccessSet) {
        self.first.insert(first);
        self.then.insert(then);
    }

    /// Adds the change of an image's layout ahead of accesses `then`.
    pub(crate) fn add_layout(
        &mut self,
        image: vk::Image,
        range: vk::ImageSubresourceRange,
        before: &Before,
        then: AccessSet,
        layout: vk::ImageLayout,
    ) {
        let mut first = AccessSet::default();
        for &(accesses, _) in &before.here {
            first.insert(accesses);
        }
        let (mut src_stages, src_access) = source(first);
        if before.elsewhere {
            // The semaphore wait stands before all stages; the change of layout must follow it.
            src_stages |= vk::PipelineStageFlags2::ALL_COMMANDS;
        }
        let (dst_stages, dst_access) = destination(then);
        self.images.push(
            vk::ImageMemoryBarrier2::default()
                .src_stage_mask(src_stages)
                .src_access_mask(src_access)
                .dst_stage_mask(dst_stages)
                .dst_access_mask(dst_access)
                .old_layout(before.layout)
                .new_layout(layout)
                .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
                .image(image)
                .subresource_range(range),
        );
    }

    /// Adds the hand-over of a buffer from a family of queues to the one that stands for other processes, after what `before` asks for.
    pub(crate) fn add_release(&mut self, buffer: vk::Buffer, [family, importers]: [u32; 2], before: &Before) {
        let mut first = AccessSet::default();
        for &(accesses, _) in &before.here {
            first.insert(accesses);
        }
        let (src_stages, src_access) = source(first);
        let (dst_stages, dst_access) = destination(AccessSet::of(Access::External));
        self.buffers.push(
            vk::BufferMemoryBarrier2::default()
                .src_stage_mask(src_stages)
                .src_access_mask(src_access)
                .dst_stage_mask(dst_stages)
                .dst_access_mask(dst_access)
                .src_queue_family_index(family)
                .dst_queue_family_index(importers)
                .buffer(buffer)
                .size(vk::WHOLE_SIZE),
        );
    }

    /// Hands the barrier to `emit`, unless there is none to say, and notes that it stands before `operation`. Returns
    /// whether there was one.
    pub(crate) fn flush(
        self,
        covered: &mut Covered,
        operation: u64,
        emit: impl FnOnce(&vk::DependencyInfo<'_>),
    ) -> bool {
        if self.first.is_empty() && self.images.is_empty() && self.buffers.is_empty() {
            return false;
        }
        let (src_stages, src_access) = source(self.first);
        let (dst_stages, dst_access) = destination(self.then);
        let memory = [vk::MemoryBarrier2::default()
            .src_stage_mask(src_stages)
            .src_access_mask(src_access)
            .dst_stage_mask(dst_stages)
            .dst_access_mask(dst_access)];
        let mut info =
            vk::DependencyInfo::default().image_memory_barriers(&self.images).buffer_memory_barriers(&self.buffers);
        if !self.first.is_empty() {
            info = info.memory_barriers(&memory);
        }
        emit(&info);
        covered.note(self.first, self.then, operation);
        true
    }
}

/// The first half of a barrier: all stages, and of the accesses those that write.
fn source(accesses: AccessSet) -> (vk::PipelineStageFlags2, vk::AccessFlags2) {
    let none = (vk::PipelineStageFlags2::NONE, vk::AccessFlags2::NONE);
    accesses.iter().map(Access::scope).fold(none, |(s, a), scope| (s | scope.stages, a | scope.written()))
}

/// The second half of a barrier.
fn destination(accesses: AccessSet) -> (vk::PipelineStageFlags2, vk::AccessFlags2) {
    let none = (vk::PipelineStageFlags2::NONE, vk::AccessFlags2::NONE);
    accesses.iter().map(Access::scope).fold(none, |(s, a), scope| (s | scope.stages, a | scope.access))
}

#[cfg(test)]
mod tests {
    use super::*;
    use vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};

    const READ: AccessSet = AccessSet::of(Access::ComputeStorageRead);
    const WRITE: AccessSet = AccessSet::of(Access::ComputeStorageWrite);
    const COPY: AccessSet = AccessSet::of(Access::CopyRead);

    fn after(here: &[(AccessSet, u64)]) -> Before {
        Before { here: here.to_vec(), ..Default::default() }
    }

    #[test]
    fn all_hazards_of_an_operation_become_one_memory_barrier() {
        let mut covered = Covered::default();
        let mut gathered = Gathered::default();
        gathered.add(&covered, &after(&[(WRITE, 1)]), COPY);
        gathered.add(&covered, &after(&[(READ, 2)]), WRITE);
        let mut seen = 0;
        let emitted = gathered.flush(&mut covered, 3, |info| {
            // SAFETY: the pointer and its count are those of the one barrier that the caller holds.
            let barriers =
                unsafe { std::slice::from_raw_parts(info.p_memory_barriers, info.memory_barrier_count as usize) };
            let [barrier] = barriers else { panic!("{} barriers", barriers.len()) };
            assert_eq!(barrier.src_stage_mask, S::COMPUTE_SHADER);
            // A read has nothing to make available.
            assert_eq!(barrier.src_access_mask, A::SHADER_STORAGE_WRITE);
            assert_eq!(barrier.dst_stage_mask, S::COMPUTE_SHADER | S::ALL_TRANSFER);
            assert_eq!(barrier.dst_access_mask, A::SHADER_STORAGE_WRITE | A::TRANSFER_READ);
            assert_eq!(info.image_memory_barrier_count, 0);
            seen += 1;
        });
        assert!(emitted && seen == 1);

        // What stands is not said again, neither for these operations nor for earlier ones; for later ones it is.
        for (before, then, needed) in [
            (after(&[(WRITE, 2)]), COPY, false),
            (after(&[(WRITE, 0)]), COPY, false),
            (after(&[(WRITE, 3)]), COPY, true),
            (after(&[(COPY, 2)]), WRITE, true),
            (after(&[]), WRITE, false),
        ] {
            let mut gathered = Gathered::default();
            gathered.add(&covered, &before, then);
            let mut scratch = Covered(covered.0);
            assert_eq!(gathered.flush(&mut scratch, 4, |_| ()), needed, "{:?} then {then:?}", before.here);
        }
    }

    #[test]
    fn a_change_of_layout_keeps_the_contents_and_follows_the_wait_for_another_queue() {
        for elsewhere in [false, true] {
            let mut gathered = Gathered::default();
            let before = Before { layout: L::GENERAL, elsewhere, ..after(&[(WRITE, 0)]) };
            let range = vk::ImageSubresourceRange::default();
            gathered.add_layout(vk::Image::null(), range, &before, COPY, L::TRANSFER_SRC_OPTIMAL);
            let emitted = gathered.flush(&mut Covered::default(), 1, |info| {
                assert_eq!((info.memory_barrier_count, info.image_memory_barrier_count), (0, 1));
                // SAFETY: there is one, as just seen, and the caller holds it.
                let barrier = unsafe { &*info.p_image_memory_barriers };
                assert_eq!((barrier.old_layout, barrier.new_layout), (L::GENERAL, L::TRANSFER_SRC_OPTIMAL));
                assert_eq!(barrier.src_stage_mask.contains(S::ALL_COMMANDS), elsewhere);
                assert!(barrier.src_stage_mask.contains(S::COMPUTE_SHADER));
                assert_eq!(barrier.src_access_mask, A::SHADER_STORAGE_WRITE);
                assert_eq!((barrier.dst_stage_mask, barrier.dst_access_mask), (S::ALL_TRANSFER, A::TRANSFER_READ));
            });
            assert!(emitted);
        }
    }
}
