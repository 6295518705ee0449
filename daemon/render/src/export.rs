//! A projector's picture and its depth into a buffer that another process reads.
//!
//! Reads `Color` and `DepthAndNode`; writes `Exported`.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use lantern_gpu::{Buffer, ComputePipeline, Device, GpuError, Recorder};

use crate::catalogue::Catalogue;
use crate::shaders;
use crate::targets::Targets;

/// Rows begin at multiples of this, bytes: what GPUs and video hardware ask of linear images.
const ROW_ALIGN_BYTES: u64 = 256;

/// Where the two planes begin, at multiples of this, bytes: a page.
const PLANE_ALIGN_BYTES: u64 = 4096;

/// Where the pixels lie: rows of colour (four bytes a pixel: red, green, blue, 255) from 0, and then rows of depth (an f32 a pixel:
/// window z in the projector's own convention, 1 = miss).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExportLayout {
    /// From one row to the next, of either plane, bytes.
    pub row_pitch: u64,
    /// Where depth begins, bytes.
    pub depth_offset: u64,
    /// All of it, bytes.
    pub bytes: u64,
}

impl ExportLayout {
    /// Of a picture of so many columns and rows.
    pub fn of([width, height]: [u32; 2]) -> Self {
        let row_pitch = (u64::from(width) * 4).next_multiple_of(ROW_ALIGN_BYTES);
        let plane = row_pitch * u64::from(height);
        let depth_offset = plane.next_multiple_of(PLANE_ALIGN_BYTES);
        Self { row_pitch, depth_offset, bytes: depth_offset + plane }
    }
}

/// Twin of `Push` in `export.comp`; 20 bytes.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Push {
    columns: u32,
    rows: u32,
    row_words: u32,
    depth_first_word: u32,
    reversed: u32,
}

/// The pass.
pub(crate) struct Export {
    pipeline: Arc<ComputePipeline>,
}

impl Export {
    pub(crate) fn new(device: &Arc<Device>) -> Result<Self, GpuError> {
        Ok(Self { pipeline: ComputePipeline::new(device, &shaders::EXPORT_COMP, &[])? })
    }

    pub(crate) fn record(
        &self,
        recorder: &mut Recorder,
        targets: &Targets,
        reversed: bool,
        to: &Arc<Buffer>,
    ) -> Result<(), GpuError> {
        let [columns, rows] = targets.size_px;
        let layout = ExportLayout::of(targets.size_px);
        if to.bytes() < layout.bytes {
            let object = to.name().to_owned();
            return Err(GpuError::Range { object, offset: 0, bytes: layout.bytes, size: to.bytes() });
        }
        // Words fit: a buffer that a shader binds has fewer than 2^32 bytes.
        let words = |bytes: u64| (bytes / 4) as u32;
        let push = Push {
            columns,
            rows,
            row_words: words(layout.row_pitch),
            depth_first_word: words(layout.depth_offset),
            reversed: reversed.into(),
        };
        // Bindings keep what they name, so that they must go with the reader whose buffer this is.
        let bindings = targets.list(Catalogue::default()).with_buffer("Exported", to).bind(&*self.pipeline)?;
        recorder.span("export", |recorder| {
            recorder.dispatch(&self.pipeline, &bindings, bytemuck::bytes_of(&push), targets.groups())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::ExportLayout;

    #[test]
    fn rows_and_planes_lie_apart_and_aligned() {
        let small = ExportLayout::of([65, 3]);
        assert_eq!(small, ExportLayout { row_pitch: 512, depth_offset: 4096, bytes: 4096 + 3 * 512 });
        let wide = ExportLayout::of([1280, 800]);
        assert_eq!((wide.row_pitch, wide.depth_offset, wide.bytes), (5120, 4_096_000, 8_192_000));
    }
}
