//! The projectors' lenses on the device, which every pass reads that sends rays through one.

use std::sync::Arc;

use lantern_calibration::{Calibration, GpuLens, LENS_NONE, Maps, Optics};
use lantern_gpu::{Buffer, BufferKind, Device, GpuError, Recorder, TexelFormat};

use crate::catalogue::Catalogue;

/// What of a calibration makes up its lens.
#[derive(Clone, PartialEq)]
struct Made {
    optics: Optics,
    maps: Arc<Maps>,
}

/// Every projector's lens, in order.
pub(crate) struct Lenses {
    made: Vec<Made>,
    of: Vec<GpuLens>,
    texels: Vec<[f32; 4]>,
    headers: Arc<Buffer>,
    grids: Arc<Buffer>,
    written: bool,
}

impl Lenses {
    /// Packs the lenses of these calibrations.
    ///
    /// # Errors
    /// A buffer that the device cannot make.
    pub(crate) fn new<'a>(
        device: &Arc<Device>,
        calibrations: impl Iterator<Item = &'a Calibration>,
    ) -> Result<Self, GpuError> {
        let (mut made, mut of, mut texels) = (Vec::new(), Vec::new(), Vec::new());
        for calibration in calibrations {
            of.push(GpuLens::new(calibration, &mut texels));
            made.push(made_of(calibration));
        }
        let header_bytes = (of.len().max(1) * size_of::<GpuLens>()) as u64;
        let grid_bytes = (texels.len().max(1) * size_of::<[f32; 4]>()) as u64;
        Ok(Self {
            headers: Buffer::new(device, "lenses", BufferKind::Storage, header_bytes)?,
            grids: Buffer::new(device, "lens grids", BufferKind::Texel(TexelFormat::Rgba32Float), grid_bytes)?,
            made,
            of,
            texels,
            written: false,
        })
    }

    /// Whether these are the lenses of those calibrations, in this order.
    pub(crate) fn are_of<'a>(&self, calibrations: impl Iterator<Item = &'a Calibration>) -> bool {
        self.made.iter().cloned().eq(calibrations.map(made_of))
    }

    /// Whether any projector has one.
    pub(crate) fn any(&self) -> bool {
        self.of.iter().any(|lens| lens.kind != LENS_NONE)
    }

    /// Whether they have yet to be written.
    pub(crate) fn differs(&self) -> bool {
        !self.written
    }

    /// Writes them, where they have yet to be.
    ///
    /// # Errors
    /// What Vulkan says.
    pub(crate) fn write(&self, recorder: &mut Recorder) -> Result<(), GpuError> {
        if !self.written {
            recorder.upload(&self.headers, 0, bytemuck::cast_slice(&self.of))?;
            recorder.upload(&self.grids, 0, bytemuck::cast_slice(&self.texels))?;
        }
        Ok(())
    }

    /// What was recorded was submitted: it is kept here no longer.
    pub(crate) fn written(&mut self) {
        self.texels = Vec::new();
        self.written = true;
    }

    pub(crate) fn list(&self, catalogue: Catalogue) -> Catalogue {
        catalogue.with_buffer("Lenses", &self.headers).with_buffer("lens_texels", &self.grids)
    }
}

fn made_of(calibration: &Calibration) -> Made {
    Made { optics: calibration.optics().clone(), maps: calibration.maps().clone() }
}
