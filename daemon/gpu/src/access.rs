//! The one table of accesses: for each way to use a resource, its pipeline stages, access mask and image layout.
//!
//! Nothing else in this crate spells a stage or an access mask of a barrier.

use ash::vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};

/// A way to use a buffer or an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(crate) enum Access {
    /// A uniform buffer in a compute shader.
    ComputeUniform,
    /// A storage buffer or image that a compute shader reads.
    ComputeStorageRead,
    /// A storage buffer or image that a compute shader writes.
    ComputeStorageWrite,
    /// A uniform texel buffer or a sampled image in a compute shader.
    ComputeSampled,
    /// A uniform buffer in a vertex or fragment shader.
    GraphicsUniform,
    /// A storage buffer or image that a vertex or fragment shader reads.
    GraphicsStorageRead,
    /// A storage buffer or image that a vertex or fragment shader writes.
    GraphicsStorageWrite,
    /// A uniform texel buffer or a sampled image in a vertex or fragment shader.
    GraphicsSampled,
    /// A colour attachment, loaded or cleared, and stored.
    ColorTarget,
    /// A depth attachment, loaded or cleared, tested, and stored.
    DepthTarget,
    /// The source of a copy.
    CopyRead,
    /// The destination of a copy or a fill.
    CopyWrite,
    /// A read through mapped memory.
    HostRead,
    /// Workgroup counts of an indirect dispatch.
    Indirect,
    /// What an acceleration structure is built from.
    StructureInput,
    /// A bottom level that a top level is built over.
    StructureRead,
    /// A structure that is built, or its scratch memory.
    StructureWrite,
    /// A structure that a compute shader walks.
    ComputeStructure,
    /// A structure that a vertex or fragment shader walks.
    GraphicsStructure,
    /// An image that a screen shows.
    Shown,
    /// Memory that another process reads.
    External,
}

/// What an access is in Vulkan's terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Scope {
    pub(crate) stages: S,
    pub(crate) access: A,
    /// The layout that an image must be in; UNDEFINED for what only buffers know.
    pub(crate) layout: L,
}

impl Access {
    pub(crate) const COUNT: usize = 21;

    pub(crate) const ALL: [Access; Access::COUNT] = [
        Access::ComputeUniform,
        Access::ComputeStorageRead,
        Access::ComputeStorageWrite,
        Access::ComputeSampled,
        Access::GraphicsUniform,
        Access::GraphicsStorageRead,
        Access::GraphicsStorageWrite,
        Access::GraphicsSampled,
        Access::ColorTarget,
        Access::DepthTarget,
        Access::CopyRead,
        Access::CopyWrite,
        Access::HostRead,
        Access::Indirect,
        Access::StructureInput,
        Access::StructureRead,
        Access::StructureWrite,
        Access::ComputeStructure,
        Access::GraphicsStructure,
        Access::Shown,
        Access::External,
    ];

    /// The table.
    pub(crate) fn scope(self) -> Scope {
        let compute = S::COMPUTE_SHADER;
        let graphics = S::VERTEX_SHADER | S::FRAGMENT_SHADER;
        let color = A::COLOR_ATTACHMENT_READ | A::COLOR_ATTACHMENT_WRITE;
        let depth = A::DEPTH_STENCIL_ATTACHMENT_READ | A::DEPTH_STENCIL_ATTACHMENT_WRITE;
        let depth_tests = S::EARLY_FRAGMENT_TESTS | S::LATE_FRAGMENT_TESTS;
        let build = S::ACCELERATION_STRUCTURE_BUILD_KHR;
        let walk = A::ACCELERATION_STRUCTURE_READ_KHR;
        let (stages, access, layout) = match self {
            Access::ComputeUniform => (compute, A::UNIFORM_READ, L::UNDEFINED),
            Access::ComputeStorageRead => (compute, A::SHADER_STORAGE_READ, L::GENERAL),
            Access::ComputeStorageWrite => (compute, A::SHADER_STORAGE_WRITE, L::GENERAL),
            Access::ComputeSampled => (compute, A::SHADER_SAMPLED_READ, L::SHADER_READ_ONLY_OPTIMAL),
            Access::GraphicsUniform => (graphics, A::UNIFORM_READ, L::UNDEFINED),
            Access::GraphicsStorageRead => (graphics, A::SHADER_STORAGE_READ, L::GENERAL),
            Access::GraphicsStorageWrite => (graphics, A::SHADER_STORAGE_WRITE, L::GENERAL),
            Access::GraphicsSampled => (graphics, A::SHADER_SAMPLED_READ, L::SHADER_READ_ONLY_OPTIMAL),
            Access::ColorTarget => (S::COLOR_ATTACHMENT_OUTPUT, color, L::COLOR_ATTACHMENT_OPTIMAL),
            Access::DepthTarget => (depth_tests, depth, L::DEPTH_ATTACHMENT_OPTIMAL),
            Access::CopyRead => (S::ALL_TRANSFER, A::TRANSFER_READ, L::TRANSFER_SRC_OPTIMAL),
            Access::CopyWrite => (S::ALL_TRANSFER, A::TRANSFER_WRITE, L::TRANSFER_DST_OPTIMAL),
            Access::HostRead => (S::HOST, A::HOST_READ, L::UNDEFINED),
            Access::Indirect => (S::DRAW_INDIRECT, A::INDIRECT_COMMAND_READ, L::UNDEFINED),
            Access::StructureInput => (build, A::SHADER_READ, L::UNDEFINED),
            Access::StructureRead => (build, walk, L::UNDEFINED),
            Access::StructureWrite => (build, walk | A::ACCELERATION_STRUCTURE_WRITE_KHR, L::UNDEFINED),
            Access::ComputeStructure => (compute, walk, L::UNDEFINED),
            Access::GraphicsStructure => (graphics, walk, L::UNDEFINED),
            // Semaphores stand before and behind it, and reach all stages.
            Access::Shown => (S::NONE, A::NONE, L::PRESENT_SRC_KHR),
            // Whoever hands it over waits for its semaphore, or for the device, before anyone is told.
            Access::External => (S::NONE, A::NONE, L::UNDEFINED),
        };
        Scope { stages, access, layout }
    }

    /// Whether the access changes what it touches.
    pub(crate) fn writes(self) -> bool {
        !self.scope().written().is_empty()
    }
}

impl Scope {
    /// The part of the mask that writes: all that a barrier has to make available.
    pub(crate) fn written(self) -> A {
        self.access
            & (A::SHADER_STORAGE_WRITE
                | A::COLOR_ATTACHMENT_WRITE
                | A::DEPTH_STENCIL_ATTACHMENT_WRITE
                | A::TRANSFER_WRITE
                | A::ACCELERATION_STRUCTURE_WRITE_KHR)
    }
}

/// Several accesses of one resource by one operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct AccessSet(u32);

impl AccessSet {
    pub(crate) const fn of(access: Access) -> AccessSet {
        AccessSet(1 << access as u32)
    }

    pub(crate) fn insert(&mut self, other: AccessSet) {
        self.0 |= other.0;
    }

    /// Whether all of `other` is in it.
    pub(crate) fn contains(self, other: AccessSet) -> bool {
        self.0 & other.0 == other.0
    }

    pub(crate) fn is_empty(self) -> bool {
        self.0 == 0
    }

    pub(crate) fn iter(self) -> impl Iterator<Item = Access> {
        Access::ALL.into_iter().filter(move |&access| self.0 & (1 << access as u32) != 0)
    }

    pub(crate) fn writes(self) -> bool {
        self.iter().any(Access::writes)
    }

    /// Whether something is read that was there before. Attachments say so themselves (they may be cleared).
    pub(crate) fn only_reads(self) -> bool {
        !self.is_empty() && !self.writes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_of_all_is_complete_and_in_the_order_of_the_bits() {
        for (bit, access) in (0u32..).zip(Access::ALL) {
            assert_eq!(access as u32, bit);
        }
        assert_eq!(Access::External as usize + 1, Access::COUNT);
    }

    #[test]
    fn exactly_these_accesses_write() {
        let writers: Vec<Access> = Access::ALL.into_iter().filter(|access| access.writes()).collect();
        use Access::*;
        assert_eq!(
            writers,
            [ComputeStorageWrite, GraphicsStorageWrite, ColorTarget, DepthTarget, CopyWrite, StructureWrite]
        );
    }

    /// An access mask is only valid with a stage that can perform it (Vulkan 1.3, table "Supported access types").
    #[test]
    fn every_mask_belongs_to_its_stages() {
        let shaders = S::COMPUTE_SHADER | S::VERTEX_SHADER | S::FRAGMENT_SHADER;
        let supported = [
            (A::UNIFORM_READ, shaders),
            (A::SHADER_STORAGE_READ, shaders),
            (A::SHADER_STORAGE_WRITE, shaders),
            (A::SHADER_SAMPLED_READ, shaders),
            (A::COLOR_ATTACHMENT_READ, S::COLOR_ATTACHMENT_OUTPUT),
            (A::COLOR_ATTACHMENT_WRITE, S::COLOR_ATTACHMENT_OUTPUT),
            (A::DEPTH_STENCIL_ATTACHMENT_READ, S::EARLY_FRAGMENT_TESTS | S::LATE_FRAGMENT_TESTS),
            (A::DEPTH_STENCIL_ATTACHMENT_WRITE, S::EARLY_FRAGMENT_TESTS | S::LATE_FRAGMENT_TESTS),
            (A::TRANSFER_READ, S::ALL_TRANSFER),
            (A::TRANSFER_WRITE, S::ALL_TRANSFER),
            (A::HOST_READ, S::HOST),
            (A::INDIRECT_COMMAND_READ, S::DRAW_INDIRECT),
            (A::SHADER_READ, S::ACCELERATION_STRUCTURE_BUILD_KHR),
            (A::ACCELERATION_STRUCTURE_READ_KHR, shaders | S::ACCELERATION_STRUCTURE_BUILD_KHR),
            (A::ACCELERATION_STRUCTURE_WRITE_KHR, S::ACCELERATION_STRUCTURE_BUILD_KHR),
        ];
        for access in Access::ALL {
            let scope = access.scope();
            let mut left = scope.access;
            for (mask, stages) in supported {
                if left.contains(mask) {
                    assert!(stages.contains(scope.stages), "{access:?}: {mask:?} at {:?}", scope.stages);
                    left &= !mask;
                }
            }
            assert!(left.is_empty(), "{access:?}: {left:?} is in no row");
            // What screens and other processes do is ordered by semaphores, or by the host.
            let beyond = matches!(access, Access::Shown | Access::External);
            assert_eq!((scope.stages.is_empty(), scope.access.is_empty()), (beyond, beyond));
        }
    }

    #[test]
    fn what_reads_and_writes_one_image_together_agrees_on_its_layout() {
        assert_eq!(Access::ComputeStorageRead.scope().layout, Access::ComputeStorageWrite.scope().layout);
        assert_eq!(Access::GraphicsStorageRead.scope().layout, Access::GraphicsStorageWrite.scope().layout);
        assert_eq!(Access::ComputeSampled.scope().layout, Access::GraphicsSampled.scope().layout);
    }

    #[test]
    fn a_set_reads_alone_only_without_a_write() {
        let mut set = AccessSet::default();
        assert!(!set.only_reads());
        set.insert(AccessSet::of(Access::ComputeStorageRead));
        assert!(set.only_reads());
        set.insert(AccessSet::of(Access::ComputeStorageWrite));
        assert!(set.writes() && !set.only_reads());
        assert_eq!(set.iter().count(), 2);
    }
}
