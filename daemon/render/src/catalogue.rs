//! Resources by the name that shaders give them.

use std::collections::BTreeMap;
use std::sync::Arc;

use lantern_gpu::{Bindings, Buffer, GpuError, HasLayout, Image, Resource, Shader};

/// What a pass may bind; a pipeline takes from it what its shaders name.
#[derive(Clone, Default)]
pub(crate) struct Catalogue {
    buffers: BTreeMap<&'static str, Arc<Buffer>>,
    images: BTreeMap<&'static str, Arc<Image>>,
}

impl Catalogue {
    pub(crate) fn with_buffer(mut self, name: &'static str, buffer: &Arc<Buffer>) -> Self {
        self.buffers.insert(name, buffer.clone());
        self
    }

    pub(crate) fn with_image(mut self, name: &'static str, image: &Arc<Image>) -> Self {
        self.images.insert(name, image.clone());
        self
    }

    /// Binds what `shaders` name. A name that the catalogue lacks is refused by [`Bindings::new`], which says which.
    pub(crate) fn bind(&self, layout: &impl HasLayout, shaders: &[&Shader]) -> Result<Arc<Bindings>, GpuError> {
        let mut named: BTreeMap<&str, Resource<'_>> = BTreeMap::new();
        for binding in shaders.iter().flat_map(|s| s.bindings) {
            if let Some(buffer) = self.buffers.get(binding.name) {
                named.insert(binding.name, Resource::Buffer(buffer));
            } else if let Some(image) = self.images.get(binding.name) {
                named.insert(binding.name, Resource::Image(image));
            }
        }
        Bindings::new(layout, &named.into_iter().collect::<Vec<_>>())
    }
}
