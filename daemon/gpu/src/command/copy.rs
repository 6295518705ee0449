//! Copies, fills and uploads.

use std::sync::Arc;

use ash::vk;

use super::{Recorder, Uses};
use crate::access::{Access, AccessSet};
use crate::buffer::{Buffer, BufferKind};
use crate::error::GpuError;
use crate::image::{Image, ImageUsage};

/// A range to copy, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CopyRegion {
    /// Where it begins in the source.
    pub src_offset: u64,
    /// Where it begins in the destination.
    pub dst_offset: u64,
    /// How long it is.
    pub bytes: u64,
}

impl Recorder {
    /// Copies `bytes` bytes between buffers, or within one between ranges that do not overlap.
    ///
    /// # Errors
    /// [`GpuError::Range`], [`GpuError::Misuse`] for ranges that overlap.
    pub fn copy_buffer(
        &mut self,
        src: &Arc<Buffer>,
        src_offset: u64,
        dst: &Arc<Buffer>,
        dst_offset: u64,
        bytes: u64,
    ) -> Result<(), GpuError> {
        self.check_outside()?;
        src.check_range(src_offset, bytes)?;
        dst.check_range(dst_offset, bytes)?;
        if Arc::ptr_eq(src, dst) && src_offset < dst_offset + bytes && dst_offset < src_offset + bytes {
            return Err(GpuError::misuse(src.name(), "a copy onto itself whose ranges overlap"));
        }
        if bytes == 0 {
            return Ok(());
        }
        let mut uses = Uses::default();
        uses.add_buffer(src, AccessSet::of(Access::CopyRead));
        uses.add_buffer(dst, AccessSet::of(Access::CopyWrite));
        self.apply(&uses)?;
        let region = vk::BufferCopy { src_offset, dst_offset, size: bytes };
        // SAFETY: recording outside of a rendering; both ranges are inside buffers of this device that may be copied,
        // do not overlap, and are kept below.
        unsafe { self.raw().cmd_copy_buffer(self.recording.commands(), src.raw, dst.raw, &[region]) };
        self.keep(src);
        self.keep(dst);
        Ok(())
    }

    /// Copies several ranges from one buffer to another, in no order; no two may overlap where they are written.
    ///
    /// # Errors
    /// [`GpuError::Range`], [`GpuError::Misuse`] for a copy within one buffer or ranges that overlap.
    pub fn copy_regions(
        &mut self,
        src: &Arc<Buffer>,
        dst: &Arc<Buffer>,
        regions: &[CopyRegion],
    ) -> Result<(), GpuError> {
        self.check_outside()?;
        if Arc::ptr_eq(src, dst) {
            return Err(GpuError::misuse(src.name(), "ranges copied within one buffer"));
        }
        let mut raw: Vec<vk::BufferCopy> = Vec::with_capacity(regions.len());
        for region in regions.iter().filter(|region| region.bytes > 0) {
            src.check_range(region.src_offset, region.bytes)?;
            dst.check_range(region.dst_offset, region.bytes)?;
            let CopyRegion { src_offset, dst_offset, bytes: size } = *region;
            raw.push(vk::BufferCopy { src_offset, dst_offset, size });
        }
        raw.sort_unstable_by_key(|region| region.dst_offset);
        if raw.windows(2).any(|pair| pair[0].dst_offset + pair[0].size > pair[1].dst_offset) {
            return Err(GpuError::misuse(dst.name(), "copies to ranges that overlap"));
        }
        if raw.is_empty() {
            return Ok(());
        }
        let mut uses = Uses::default();
        uses.add_buffer(src, AccessSet::of(Access::CopyRead));
        uses.add_buffer(dst, AccessSet::of(Access::CopyWrite));
        self.apply(&uses)?;
        // SAFETY: recording outside of a rendering; all ranges are inside two buffers of this device that may be copied, do not
        // overlap where they are written, and both are kept below.
        unsafe { self.raw().cmd_copy_buffer(self.recording.commands(), src.raw, dst.raw, &raw) };
        self.keep(src);
        self.keep(dst);
        Ok(())
    }

    /// Copies `data` to `offset` bytes into a buffer, through a staging buffer that lives until it was done.
    ///
    /// # Errors
    /// [`GpuError::Range`], or no memory.
    pub fn upload(&mut self, dst: &Arc<Buffer>, offset: u64, data: &[u8]) -> Result<(), GpuError> {
        dst.check_range(offset, data.len() as u64)?;
        if data.is_empty() {
            return Ok(());
        }
        let name = format!("staging for {}", dst.name());
        let staging = Buffer::new(self.device(), &name, BufferKind::Staging, data.len() as u64)?;
        staging.write(0, data)?;
        self.copy_buffer(&staging, 0, dst, offset, data.len() as u64)
    }

    /// Fills a buffer with one 32-bit word.
    ///
    /// # Errors
    /// [`GpuError::OtherDevice`].
    pub fn fill(&mut self, dst: &Arc<Buffer>, value: u32) -> Result<(), GpuError> {
        self.check_outside()?;
        let mut uses = Uses::default();
        uses.add_buffer(dst, AccessSet::of(Access::CopyWrite));
        self.apply(&uses)?;
        // SAFETY: recording outside of a rendering; the buffer may be copied to and is kept below.
        unsafe { self.raw().cmd_fill_buffer(self.recording.commands(), dst.raw, 0, vk::WHOLE_SIZE, value) };
        self.keep(dst);
        Ok(())
    }

    /// Copies all pixels of an image to the beginning of a buffer, row by row without gaps, the top row first.
    ///
    /// # Errors
    /// [`GpuError::Range`] for a buffer that is too short, [`GpuError::Misuse`] for an image not created for copies,
    /// [`GpuError::Unwritten`].
    pub fn copy_image_to_buffer(&mut self, src: &Arc<Image>, dst: &Arc<Buffer>) -> Result<(), GpuError> {
        self.check_outside()?;
        self.check_draws_and_computes()?;
        src.require(ImageUsage::TRANSFER, "the source of a copy")?;
        dst.check_range(0, src.bytes())?;
        let mut uses = Uses::default();
        uses.add_image(src, AccessSet::of(Access::CopyRead), true)?;
        uses.add_buffer(dst, AccessSet::of(Access::CopyWrite));
        self.apply(&uses)?;
        let region = vk::BufferImageCopy::default().image_subresource(layers(src)).image_extent(vk::Extent3D {
            width: src.width_px(),
            height: src.height_px(),
            depth: 1,
        });
        // SAFETY: recording outside of a rendering; the image is in this layout by the barrier before, and the buffer
        // has room for it; both are of this device and kept below.
        unsafe {
            self.raw().cmd_copy_image_to_buffer(
                self.recording.commands(),
                src.raw,
                vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
                dst.raw,
                &[region],
            );
        }
        self.keep(src);
        self.keep(dst);
        Ok(())
    }
}

fn layers(image: &Image) -> vk::ImageSubresourceLayers {
    vk::ImageSubresourceLayers::default().aspect_mask(image.format().aspect()).layer_count(1)
}
