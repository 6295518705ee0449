//! Resources by the name that shaders give them.

use std::collections::BTreeMap;
use std::sync::Arc;

use lantern_gpu::{Bindings, Buffer, GpuError, HasLayout, Image, Resource, TopLevel};

/// What a pass may bind; a pipeline takes from it what its shaders name.
#[derive(Clone, Default)]
pub(crate) struct Catalogue {
    buffers: BTreeMap<&'static str, Arc<Buffer>>,
    images: BTreeMap<&'static str, Arc<Image>>,
    structures: BTreeMap<&'static str, Arc<TopLevel>>,
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

    pub(crate) fn with_structure(mut self, name: &'static str, structure: &Arc<TopLevel>) -> Self {
        self.structures.insert(name, structure.clone());
        self
    }

    /// Binds what the shaders of `pipeline` name. A name that the catalogue lacks is refused by [`Bindings::new`], which says which.
    pub(crate) fn bind(&self, pipeline: &impl HasLayout) -> Result<Arc<Bindings>, GpuError> {
        let resource = |name| {
            let buffer = self.buffers.get(name).map(Resource::Buffer);
            let image = || self.images.get(name).map(Resource::Image);
            buffer.or_else(image).or_else(|| self.structures.get(name).map(Resource::Structure))
        };
        let named: Vec<_> = pipeline.binding_names().filter_map(|name| Some((name, resource(name)?))).collect();
        Bindings::new(pipeline, &named)
    }
}
