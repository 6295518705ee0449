//! Pictures on a surface: a swapchain, made anew whenever the surface changes.

use std::sync::Arc;
use std::time::{Duration, Instant};

use lantern_gpu::{Device, GpuError, Pixels, Shown, Surface, Swapchain, SwapchainDesc};
use lantern_render::{Renderer, Target};

use super::{PATIENCE, Showing};

/// A surface with what is shown on it.
pub(super) struct Screen {
    device: Arc<Device>,
    surface: Arc<Surface>,
    desc: SwapchainDesc,
    /// None before the first picture, and while the surface has no pixels.
    chain: Option<Swapchain>,
    /// The surface's own size when the swapchain was made, px.
    made_for_px: [u32; 2],
    /// The last picture whose time can be waited for.
    last_id: Option<u64>,
}

impl Screen {
    pub(super) fn new(device: &Arc<Device>, surface: Arc<Surface>, desc: SwapchainDesc) -> Self {
        Self { device: device.clone(), surface, desc, chain: None, made_for_px: [0; 2], last_id: None }
    }

    /// Shows what the renderer made last of a projector.
    pub(super) fn show(&mut self, renderer: &mut Renderer, projector: usize) -> Result<Showing, GpuError> {
        self.present(|target, recorder| renderer.present(recorder, projector, target))
    }

    /// Shows nothing.
    pub(super) fn black(&mut self) -> Result<Showing, GpuError> {
        self.present(|target, recorder| target.record_black(recorder).map(|()| false))
    }

    /// Shows what `record` records, which says whether it is a picture.
    fn present(
        &mut self,
        mut record: impl FnMut(&Target<'_>, &mut lantern_gpu::Recorder) -> Result<bool, GpuError>,
    ) -> Result<Showing, GpuError> {
        // A surface that changed wants another swapchain, and one that goes on changing another turn.
        for _ in 0..2 {
            if self.made_for_px != self.surface.size_px() {
                self.chain = None;
            }
            let chain = match &mut self.chain {
                Some(chain) => chain,
                none => {
                    self.made_for_px = self.surface.size_px();
                    match Swapchain::new(&self.device, &self.surface, self.desc)? {
                        Some(made) => none.insert(made),
                        None => return Ok(Showing::Hidden),
                    }
                }
            };
            let (pixels, white_nits) = (chain.pixels(), self.desc.white_nits);
            let mut is_picture = false;
            let shown = chain.show(PATIENCE, |recorder, image| {
                is_picture = record(&Target { image, pixels, white_nits }, recorder)?;
                Ok(())
            })?;
            match shown {
                Shown::Yes(id) => {
                    self.last_id = Some(id).filter(|_| chain.can_wait_shown());
                    return Ok(if is_picture { Showing::Shown } else { Showing::Black });
                }
                Shown::NotYet => return Ok(Showing::NotYet),
                Shown::Outdated => self.chain = None,
            }
        }
        Ok(Showing::NotYet)
    }

    /// Waits for the last picture to be there, until `until` at most; when it was. None also where it was there already: nobody knows since
    /// when.
    pub(super) fn wait_shown(&mut self, until: Instant) -> Option<Instant> {
        let (id, chain) = (self.last_id.take()?, self.chain.as_ref()?);
        if chain.wait_shown(id, Duration::ZERO) {
            return None;
        }
        chain.wait_shown(id, until.saturating_duration_since(Instant::now())).then(Instant::now)
    }

    /// Columns and rows of what is shown.
    pub(super) fn size_px(&self) -> Option<[u32; 2]> {
        self.chain.as_ref().map(Swapchain::size_px)
    }

    /// What its pixels are made of, in the configuration's words.
    pub(super) fn pixels(&self) -> &'static str {
        match self.chain.as_ref().map(Swapchain::pixels) {
            Some(Pixels::Bits8) => "8-bit",
            Some(Pixels::Bits10) => "10-bit",
            Some(Pixels::Hdr10) => "hdr10",
            None => "",
        }
    }
}
