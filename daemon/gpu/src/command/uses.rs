//! What one operation uses.

use std::sync::Arc;

use crate::access::AccessSet;
use crate::binding::{Bindings, Held, layout_of};
use crate::buffer::Buffer;
use crate::error::GpuError;
use crate::image::Image;

/// The resources that one operation uses, each once with all its accesses.
#[derive(Default)]
pub(super) struct Uses {
    pub(super) buffers: Vec<(Arc<Buffer>, AccessSet)>,
    pub(super) images: Vec<UsedImage>,
}

/// An image that an operation uses.
pub(super) struct UsedImage {
    pub(super) image: Arc<Image>,
    pub(super) accesses: AccessSet,
    /// Whether the operation makes no sense on an image that nothing has written.
    pub(super) needs_contents: bool,
}

impl Uses {
    pub(super) fn add_buffer(&mut self, buffer: &Arc<Buffer>, accesses: AccessSet) {
        match self.buffers.iter_mut().find(|(known, _)| Arc::ptr_eq(known, buffer)) {
            Some((_, all)) => all.insert(accesses),
            None => self.buffers.push((Arc::clone(buffer), accesses)),
        }
    }

    pub(super) fn add_image(
        &mut self,
        image: &Arc<Image>,
        accesses: AccessSet,
        needs_contents: bool,
    ) -> Result<(), GpuError> {
        match self.images.iter_mut().find(|used| Arc::ptr_eq(&used.image, image)) {
            Some(used) if layout_of(used.accesses) == layout_of(accesses) => {
                used.accesses.insert(accesses);
                used.needs_contents |= needs_contents;
                Ok(())
            }
            Some(_) => Err(GpuError::misuse(image.name(), "one operation uses it in two ways that exclude each other")),
            None => {
                self.images.push(UsedImage { image: Arc::clone(image), accesses, needs_contents });
                Ok(())
            }
        }
    }

    pub(super) fn add_bindings(&mut self, bindings: &Bindings) -> Result<(), GpuError> {
        for (held, accesses) in &bindings.held {
            match held {
                Held::Buffer(buffer) => self.add_buffer(buffer, *accesses),
                Held::Image(image) => self.add_image(image, *accesses, accesses.only_reads())?,
                // Its bottom levels need no barrier of their own: the building of the top level waited for them.
                Held::Structure(top) => {
                    top.structure.check_built()?;
                    self.add_buffer(&top.structure.storage, *accesses);
                }
            }
        }
        Ok(())
    }
}
