//! Descriptor set layout and pipeline layout, derived from the binding tables of a pipeline's shaders.

use std::sync::Arc;

use ash::vk;

use crate::access::{Access, AccessSet};
use crate::error::GpuError;
use crate::handle::DeviceHandle;
use crate::sampler::Sampler;
use crate::shader::{Binding, BindingKind, Shader, Stage};

/// What a pipeline binds, as Vulkan layouts.
pub struct Layout {
    pub(crate) set_layout: vk::DescriptorSetLayout,
    pub(crate) raw: vk::PipelineLayout,
    pub(crate) device: Arc<DeviceHandle>,
    pub(crate) name: String,
    /// The union of the shaders' tables, by binding number.
    pub(crate) slots: Vec<Binding>,
    pub(crate) stages: vk::ShaderStageFlags,
    pub(crate) push_bytes: u32,
    /// Baked into the set layout where images are sampled.
    sampler: Option<Sampler>,
}

impl std::fmt::Debug for Layout {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Layout").field("name", &self.name).field("slots", &self.slots).finish_non_exhaustive()
    }
}

pub(crate) mod sealed {
    /// Something whose layout bindings are made for.
    pub trait Sealed {
        /// The layout.
        fn layout(&self) -> &std::sync::Arc<super::Layout>;
    }

    impl<T: Sealed> Sealed for std::sync::Arc<T> {
        fn layout(&self) -> &std::sync::Arc<super::Layout> {
            (**self).layout()
        }
    }
}

/// A pipeline, as far as [`Bindings`](crate::Bindings) are concerned.
pub trait HasLayout: sealed::Sealed {
    /// The names of what its shaders bind, by number.
    fn binding_names(&self) -> impl Iterator<Item = &'static str> {
        self.layout().slots.iter().map(|slot| slot.name)
    }
}
impl<T: sealed::Sealed> HasLayout for T {}

impl Layout {
    /// Derives the layouts of a pipeline made of `shaders`. Their tables must agree where they share a binding.
    pub(crate) fn new(device: &Arc<DeviceHandle>, name: &str, shaders: &[&Shader]) -> Result<Arc<Layout>, GpuError> {
        let slots = union(name, shaders)?;
        check_counts(device, name, &slots)?;
        let push_bytes = shaders.iter().map(|shader| shader.push_bytes).max().unwrap_or(0).next_multiple_of(4);
        if push_bytes > device.limits.max_push_bytes {
            return Err(GpuError::TooLarge {
                object: name.into(),
                asked: push_bytes.into(),
                limit: device.limits.max_push_bytes.into(),
                unit: "bytes of push constants",
            });
        }

        // Graphics layouts name both stages always, so that bindings fit every pipeline with the same table.
        let compute = shaders.iter().any(|shader| shader.stage == Stage::Compute);
        let stages = if compute {
            vk::ShaderStageFlags::COMPUTE
        } else {
            vk::ShaderStageFlags::VERTEX | vk::ShaderStageFlags::FRAGMENT
        };
        let samples = slots.iter().any(|slot| slot.kind == BindingKind::SampledImage);
        let sampler = if samples { Some(Sampler::nearest_clamp(device)?) } else { None };
        let mut layout = Layout {
            set_layout: vk::DescriptorSetLayout::null(),
            raw: vk::PipelineLayout::null(),
            device: Arc::clone(device),
            name: name.into(),
            slots,
            stages,
            push_bytes,
            sampler,
        };
        layout.create()?;
        Ok(Arc::new(layout))
    }

    /// How a shader of this layout uses what a slot binds.
    pub(crate) fn accesses(&self, slot: &Binding) -> AccessSet {
        let compute = self.stages == vk::ShaderStageFlags::COMPUTE;
        let pick = |in_compute, in_graphics| AccessSet::of(if compute { in_compute } else { in_graphics });
        match slot.kind {
            BindingKind::UniformBuffer => pick(Access::ComputeUniform, Access::GraphicsUniform),
            BindingKind::UniformTexelBuffer | BindingKind::SampledImage => {
                pick(Access::ComputeSampled, Access::GraphicsSampled)
            }
            BindingKind::AccelerationStructure => pick(Access::ComputeStructure, Access::GraphicsStructure),
            BindingKind::StorageBuffer | BindingKind::StorageImage => {
                let mut accesses = AccessSet::default();
                // A binding that is declared and never used is still bound: it counts as read.
                if slot.reads || !slot.writes {
                    accesses.insert(pick(Access::ComputeStorageRead, Access::GraphicsStorageRead));
                }
                if slot.writes {
                    accesses.insert(pick(Access::ComputeStorageWrite, Access::GraphicsStorageWrite));
                }
                accesses
            }
        }
    }

    /// Whether bindings made for `self` may be bound with `pipeline`: the same bindings for the same stages, and no
    /// use of them that the barriers before do not know of.
    pub(crate) fn serves(&self, pipeline: &Layout) -> bool {
        let fits = |mine: &Binding, its: &Binding| {
            mine.binding == its.binding && mine.kind == its.kind && self.accesses(mine).contains(pipeline.accesses(its))
        };
        Arc::ptr_eq(&self.device, &pipeline.device)
            && self.stages == pipeline.stages
            && self.slots.len() == pipeline.slots.len()
            && self.slots.iter().zip(&pipeline.slots).all(|(mine, its)| fits(mine, its))
    }

    fn create(&mut self) -> Result<(), GpuError> {
        let samplers: Vec<vk::Sampler> = self.sampler.iter().map(|sampler| sampler.raw).collect();
        let bindings: Vec<_> = self
            .slots
            .iter()
            .map(|slot| {
                let binding = vk::DescriptorSetLayoutBinding::default()
                    .binding(slot.binding)
                    .descriptor_type(slot.kind.raw())
                    .descriptor_count(1)
                    .stage_flags(self.stages);
                match slot.kind {
                    BindingKind::SampledImage => binding.immutable_samplers(&samplers),
                    _ => binding,
                }
            })
            .collect();
        let set_info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        let ranges = [vk::PushConstantRange::default().stage_flags(self.stages).size(self.push_bytes)];
        let raw = &self.device.raw;
        let refused = |result| GpuError::vulkan(format!("creating the layout of {:?}", self.name), result);
        // SAFETY: binding numbers differ, counts and push constants are within the limits, samplers live as long as
        // the layout; both objects are named before anyone else has them.
        unsafe {
            self.set_layout = raw.create_descriptor_set_layout(&set_info, None).map_err(refused)?;
            let set_layouts = [self.set_layout];
            let mut info = vk::PipelineLayoutCreateInfo::default().set_layouts(&set_layouts);
            if self.push_bytes > 0 {
                info = info.push_constant_ranges(&ranges);
            }
            self.raw = raw.create_pipeline_layout(&info, None).map_err(refused)?;
            self.device.naming.name(self.set_layout, &self.name);
            self.device.naming.name(self.raw, &self.name);
        }
        Ok(())
    }
}

impl Drop for Layout {
    fn drop(&mut self) {
        // SAFETY: pipelines and bindings hold their layout by Arc, and are held in turn by whatever uses them on the
        // device until it has completed. Either handle may be null when its creation failed.
        unsafe {
            self.device.raw.destroy_pipeline_layout(self.raw, None);
            self.device.raw.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

/// The union of the tables by binding number.
fn union(pipeline: &str, shaders: &[&Shader]) -> Result<Vec<Binding>, GpuError> {
    let mut slots: Vec<Binding> = Vec::new();
    for (shader, binding) in shaders.iter().flat_map(|shader| shader.bindings.iter().map(move |b| (shader, b))) {
        let refused = |problem: String| {
            Err(GpuError::Binding { pipeline: pipeline.into(), binding: binding.name.into(), problem })
        };
        if binding.set != 0 {
            return refused(format!("it is in set {}, and only set 0 is used", binding.set));
        }
        match slots.iter_mut().find(|slot| slot.binding == binding.binding || slot.name == binding.name) {
            Some(slot) if (slot.binding, slot.name, slot.kind) == (binding.binding, binding.name, binding.kind) => {
                slot.reads |= binding.reads;
                slot.writes |= binding.writes;
            }
            Some(slot) => {
                return refused(format!(
                    "{:?} has it as {:?} number {}, and there is {:?} {:?} number {}",
                    shader.name, binding.kind, binding.binding, slot.kind, slot.name, slot.binding
                ));
            }
            None => slots.push(*binding),
        }
    }
    slots.sort_by_key(|slot| slot.binding);
    Ok(slots)
}

/// Refuses more bindings of a kind than a stage may have on this device.
fn check_counts(device: &DeviceHandle, name: &str, slots: &[Binding]) -> Result<(), GpuError> {
    let count = |kinds: &[BindingKind]| slots.iter().filter(|slot| kinds.contains(&slot.kind)).count() as u32;
    let limits = &device.limits;
    let rows = [
        (count(&[BindingKind::UniformBuffer]), limits.max_stage_uniform_buffers, "uniform buffers"),
        (count(&[BindingKind::StorageBuffer]), limits.max_stage_storage_buffers, "storage buffers"),
        (
            count(&[BindingKind::UniformTexelBuffer, BindingKind::SampledImage]),
            limits.max_stage_sampled,
            "texel buffers and sampled images",
        ),
        (count(&[BindingKind::StorageImage]), limits.max_stage_storage_images, "storage images"),
        (count(&[BindingKind::AccelerationStructure]), device.max_stage_structures(), "acceleration structures"),
        (slots.len() as u32, limits.max_stage_resources, "resources"),
    ];
    match rows.into_iter().find(|(asked, limit, _)| asked > limit) {
        Some((asked, limit, unit)) => {
            Err(GpuError::TooLarge { object: name.into(), asked: asked.into(), limit: limit.into(), unit })
        }
        None => Ok(()),
    }
}
