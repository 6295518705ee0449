//! Descriptor sets: resources bound by name, written once.

use std::sync::Arc;

use ash::vk;

use crate::access::{Access, AccessSet};
use crate::buffer::{Buffer, BufferKind};
use crate::error::GpuError;
use crate::image::{Image, ImageUsage};
use crate::layout::{HasLayout, Layout};
use crate::shader::{Binding, BindingKind};
use crate::structure::TopLevel;

/// Something to bind.
#[derive(Debug, Clone, Copy)]
pub enum Resource<'a> {
    /// A buffer, whole.
    Buffer(&'a Arc<Buffer>),
    /// An image, whole.
    Image(&'a Arc<Image>),
    /// A top level, whose bottom levels come with it.
    Structure(&'a Arc<TopLevel>),
}

/// A resource that is held.
pub(crate) enum Held {
    Buffer(Arc<Buffer>),
    Image(Arc<Image>),
    Structure(Arc<TopLevel>),
}

/// The resources of a pipeline's bindings, all given. They live as long as this does.
pub struct Bindings {
    pub(crate) set: vk::DescriptorSet,
    pub(crate) layout: Arc<Layout>,
    /// By slot of the layout: what is bound there, and how shaders of the layout use it.
    pub(crate) held: Vec<(Held, AccessSet)>,
    pool: vk::DescriptorPool,
}

impl std::fmt::Debug for Bindings {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Bindings").field("layout", &self.layout).finish_non_exhaustive()
    }
}

impl Bindings {
    /// Binds `resources` by the names in the table of `pipeline`.
    ///
    /// # Errors
    /// [`GpuError::Binding`] for a name that the table lacks, one given twice or not at all, or a resource that does
    /// not fit; [`GpuError::OtherDevice`]; or no memory.
    pub fn new(pipeline: &impl HasLayout, resources: &[(&str, Resource<'_>)]) -> Result<Arc<Bindings>, GpuError> {
        let layout = pipeline.layout();
        for (at, (name, _)) in resources.iter().enumerate() {
            if !layout.slots.iter().any(|slot| slot.name == *name) {
                let names: Vec<_> = layout.slots.iter().map(|slot| slot.name).collect();
                return Err(refusal(layout, name, format!("no such binding; there are {}", names.join(", "))));
            }
            if resources[..at].iter().any(|(other, _)| other == name) {
                return Err(refusal(layout, name, "given twice".into()));
            }
        }
        let mut held = Vec::new();
        for slot in &layout.slots {
            let Some((_, resource)) = resources.iter().find(|(name, _)| *name == slot.name) else {
                return Err(refusal(layout, slot.name, "not given".into()));
            };
            held.push((fit(layout, slot, *resource)?, layout.accesses(slot)));
        }

        let mut bindings = Bindings {
            set: vk::DescriptorSet::null(),
            layout: Arc::clone(layout),
            held,
            pool: vk::DescriptorPool::null(),
        };
        bindings.allocate()?;
        bindings.write();
        Ok(Arc::new(bindings))
    }

    /// Makes a pool that holds just this set.
    fn allocate(&mut self) -> Result<(), GpuError> {
        // A pool must have a size, even for a set of nothing.
        let mut sizes: Vec<vk::DescriptorPoolSize> = Vec::new();
        for slot in &self.layout.slots {
            match sizes.iter_mut().find(|size| size.ty == slot.kind.raw()) {
                Some(size) => size.descriptor_count += 1,
                None => sizes.push(vk::DescriptorPoolSize { ty: slot.kind.raw(), descriptor_count: 1 }),
            }
        }
        if sizes.is_empty() {
            sizes.push(vk::DescriptorPoolSize { ty: vk::DescriptorType::STORAGE_BUFFER, descriptor_count: 1 });
        }
        let device = &self.layout.device;
        let refused = |result| GpuError::vulkan(format!("making bindings for {:?}", self.layout.name), result);
        let pool_info = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
        let set_layouts = [self.layout.set_layout];
        // SAFETY: the pool holds exactly the set that is taken from it, of a layout that lives; both are named before
        // anyone else has them.
        unsafe {
            self.pool = device.raw.create_descriptor_pool(&pool_info, None).map_err(refused)?;
            let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(self.pool).set_layouts(&set_layouts);
            let sets = device.raw.allocate_descriptor_sets(&info).map_err(refused)?;
            self.set = sets.first().copied().unwrap_or_default();
            device.naming.name(self.pool, &self.layout.name);
            device.naming.name(self.set, &self.layout.name);
        }
        Ok(())
    }

    fn write(&self) {
        // The structures that the writes point to, one for each slot, whichever kind it is.
        let buffers: Vec<_> = self.held.iter().map(|(held, _)| [buffer_info(held)]).collect();
        let views: Vec<_> = self.held.iter().map(|(held, _)| [texel_view(held)]).collect();
        let images: Vec<_> = self.held.iter().map(|(held, accesses)| [image_info(held, *accesses)]).collect();
        let structures: Vec<_> = self.held.iter().map(|(held, _)| [raw_structure(held)]).collect();
        let of_structure = vk::WriteDescriptorSetAccelerationStructureKHR::default;
        let mut extensions: Vec<_> = structures.iter().map(|raw| of_structure().acceleration_structures(raw)).collect();
        let writes: Vec<_> = self
            .layout
            .slots
            .iter()
            .zip(&mut extensions)
            .enumerate()
            .map(|(at, (slot, extension))| {
                let write = vk::WriteDescriptorSet::default()
                    .dst_set(self.set)
                    .dst_binding(slot.binding)
                    .descriptor_type(slot.kind.raw());
                match slot.kind {
                    BindingKind::UniformBuffer | BindingKind::StorageBuffer => write.buffer_info(&buffers[at]),
                    BindingKind::UniformTexelBuffer => write.texel_buffer_view(&views[at]),
                    BindingKind::StorageImage | BindingKind::SampledImage => write.image_info(&images[at]),
                    BindingKind::AccelerationStructure => write.descriptor_count(1).push_next(extension),
                }
            })
            .collect();
        // SAFETY: the set is new and used by nobody; every resource fits its slot, as `fit` found, and is held as long
        // as the set.
        unsafe { self.layout.device.raw.update_descriptor_sets(&writes, &[]) };
    }
}

impl Drop for Bindings {
    fn drop(&mut self) {
        // SAFETY: whatever uses the set on the device holds it by Arc until it has completed. The set goes with its
        // pool, which may be null when its creation failed.
        unsafe { self.layout.device.raw.destroy_descriptor_pool(self.pool, None) };
    }
}

fn refusal(layout: &Layout, binding: &str, problem: String) -> GpuError {
    GpuError::Binding { pipeline: layout.name.clone(), binding: binding.into(), problem }
}

/// Holds a resource, if it may be bound in a slot.
fn fit(layout: &Layout, slot: &Binding, resource: Resource<'_>) -> Result<Held, GpuError> {
    let limits = &layout.device.limits;
    let (device, object) = match resource {
        Resource::Buffer(buffer) => (&buffer.device, buffer.name()),
        Resource::Image(image) => (&image.device, image.name()),
        Resource::Structure(top) => (&top.structure.storage.device, top.name()),
    };
    if !Arc::ptr_eq(device, &layout.device) {
        return Err(GpuError::OtherDevice { object: object.into() });
    }
    let fits = match (slot.kind, resource) {
        (BindingKind::UniformBuffer, Resource::Buffer(buffer)) => buffer.kind() == BufferKind::Uniform,
        (BindingKind::StorageBuffer, Resource::Buffer(buffer)) => {
            if buffer.bytes() > limits.max_storage_buffer_bytes {
                return Err(GpuError::TooLarge {
                    object: object.into(),
                    asked: buffer.bytes(),
                    limit: limits.max_storage_buffer_bytes,
                    unit: "bytes of a storage buffer",
                });
            }
            matches!(buffer.kind(), BufferKind::Storage | BufferKind::HostStorage | BufferKind::Texel(_))
        }
        (BindingKind::UniformTexelBuffer, Resource::Buffer(buffer)) => match buffer.kind() {
            BufferKind::Texel(format) if buffer.view == vk::BufferView::null() => {
                return Err(GpuError::TooLarge {
                    object: object.into(),
                    asked: buffer.bytes() / format.bytes(),
                    limit: limits.max_texel_buffer_elements,
                    unit: "elements of a texel buffer",
                });
            }
            kind => matches!(kind, BufferKind::Texel(_)),
        },
        (BindingKind::StorageImage, Resource::Image(image)) => image.usage().contains(ImageUsage::STORAGE),
        (BindingKind::SampledImage, Resource::Image(image)) => image.usage().contains(ImageUsage::SAMPLED),
        (BindingKind::AccelerationStructure, Resource::Structure(_)) => true,
        _ => false,
    };
    match (fits, resource) {
        (false, Resource::Buffer(buffer)) => {
            Err(refusal(layout, slot.name, format!("it is a {:?}, and {buffer:?} is none", slot.kind)))
        }
        (false, Resource::Image(image)) => {
            let problem = format!("it is a {:?}, and {image:?} with {:?} is none", slot.kind, image.usage());
            Err(refusal(layout, slot.name, problem))
        }
        (false, Resource::Structure(top)) => {
            Err(refusal(layout, slot.name, format!("it is a {:?}, and {top:?} is none", slot.kind)))
        }
        (true, Resource::Buffer(buffer)) => Ok(Held::Buffer(Arc::clone(buffer))),
        (true, Resource::Image(image)) => Ok(Held::Image(Arc::clone(image))),
        (true, Resource::Structure(top)) => Ok(Held::Structure(Arc::clone(top))),
    }
}

fn buffer_info(held: &Held) -> vk::DescriptorBufferInfo {
    match held {
        Held::Buffer(buffer) => vk::DescriptorBufferInfo::default().buffer(buffer.raw).range(buffer.bytes()),
        Held::Image(_) | Held::Structure(_) => vk::DescriptorBufferInfo::default(),
    }
}

fn texel_view(held: &Held) -> vk::BufferView {
    match held {
        Held::Buffer(buffer) => buffer.view,
        Held::Image(_) | Held::Structure(_) => vk::BufferView::null(),
    }
}

fn raw_structure(held: &Held) -> vk::AccelerationStructureKHR {
    match held {
        Held::Structure(top) => top.structure.raw,
        Held::Buffer(_) | Held::Image(_) => vk::AccelerationStructureKHR::null(),
    }
}

fn image_info(held: &Held, accesses: AccessSet) -> vk::DescriptorImageInfo {
    match held {
        Held::Buffer(_) | Held::Structure(_) => vk::DescriptorImageInfo::default(),
        Held::Image(image) => {
            vk::DescriptorImageInfo::default().image_view(image.view).image_layout(layout_of(accesses))
        }
    }
}

/// The layout that an image must be in for accesses that agree on it.
pub(crate) fn layout_of(accesses: AccessSet) -> vk::ImageLayout {
    accesses.iter().next().map(Access::scope).map_or(vk::ImageLayout::UNDEFINED, |scope| scope.layout)
}
