//! The images of a surface, shown one after the other.

use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use ash::{ext, khr, vk};

use crate::chain::RawSwapchain;
use crate::command::Recorder;
use crate::device::Device;
use crate::error::GpuError;
use crate::format::ImageFormat;
use crate::handle::DeviceHandle;
use crate::image::Image;
use crate::submission::Submission;
use crate::surface::{Pixels, Surface};

/// How long whatever is shown may hold up the end of a swapchain.
const PATIENCE: Duration = Duration::from_secs(2);

/// How often a surface that calls its swapchain less than the best gets another one, where nothing else has changed: making one waits
/// for the queue, and does not always help.
const BETTER_AFTER: Duration = Duration::from_secs(1);

/// What a swapchain is to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SwapchainDesc {
    /// What its images are made of; less, where the surface does not offer it.
    pub pixels: Pixels,
    /// For HDR: how bright white is, cd/m².
    pub white_nits: f32,
    /// The projector whose queue shows them.
    pub queue: usize,
}

/// What became of an image that was to be shown.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Shown {
    /// It is with the screen; where its time can be waited for ([`Swapchain::wait_shown`]), by this number.
    Yes(u64),
    /// The screen has no image to give yet.
    NotYet,
    /// The surface has changed: only another swapchain can show anything on it.
    Outdated,
}

/// The images of a surface.
pub struct Swapchain {
    device: Arc<Device>,
    /// None only while it is being dropped.
    chain: Option<Arc<RawSwapchain>>,
    images: Vec<Arc<Image>>,
    /// By semaphore of `acquired`: the submission that waited for it last.
    waited: Vec<Option<Submission>>,
    turn: usize,
    queue: usize,
    size_px: [u32; 2],
    format: ImageFormat,
    pixels: Pixels,
    /// What the surface wanted when it was made, and when that was.
    made_for: Wanted,
    made: Instant,
    /// Where presentation can be waited for.
    wait: Option<khr::present_wait::Device>,
    last_id: u64,
    /// Whether nothing more can be shown by it: an image was taken and never shown, or the surface is better served by another.
    broken: bool,
    name: String,
}

impl std::fmt::Debug for Swapchain {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Swapchain({:?}, {:?} px, {:?})", self.name, self.size_px, self.format)
    }
}

impl Swapchain {
    /// Makes one for a surface as it is now; None while the surface has no pixels at all. A surface has one at most at a time.
    ///
    /// # Errors
    /// [`GpuError::SurfaceLost`], [`GpuError::Unsupported`] for a device or formats that do not serve, or the driver's refusal.
    pub fn new(
        device: &Arc<Device>,
        surface: &Arc<Surface>,
        desc: SwapchainDesc,
    ) -> Result<Option<Swapchain>, GpuError> {
        let handle = device.handle();
        let queue = desc.queue % device.queue_count();
        if !handle.optional.swapchain {
            let missing = "VK_KHR_swapchain".into();
            return Err(GpuError::Unsupported { device: format!("device {:?}", handle.info.name), missing });
        }
        surface.check_family(handle, device.queues[queue].family)?;
        let capabilities = surface.capabilities(handle)?;
        let made_for = Wanted::of(&capabilities, surface.size_px());
        let extent = made_for.extent;
        if extent.width == 0 || extent.height == 0 {
            return Ok(None);
        }
        let (format, color_space, pixels) = surface.format(handle, desc.pixels)?;
        let count = (capabilities.min_image_count + 1).max(3).min(match capabilities.max_image_count {
            0 => u32::MAX,
            most => most,
        });
        let alpha = [vk::CompositeAlphaFlagsKHR::OPAQUE, vk::CompositeAlphaFlagsKHR::INHERIT]
            .into_iter()
            .find(|alpha| capabilities.supported_composite_alpha.contains(*alpha))
            .unwrap_or(vk::CompositeAlphaFlagsKHR::OPAQUE);
        let mut barrier = vk::SwapchainPresentBarrierCreateInfoNV::default().present_barrier_enable(true);
        let mut info = vk::SwapchainCreateInfoKHR::default()
            .surface(surface.raw)
            .min_image_count(count)
            .image_format(format.raw())
            .image_color_space(color_space)
            .image_extent(extent)
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::COLOR_ATTACHMENT)
            .image_sharing_mode(vk::SharingMode::EXCLUSIVE)
            .pre_transform(capabilities.current_transform)
            .composite_alpha(alpha)
            .present_mode(surface.present_mode(handle)?)
            .clipped(false);
        if handle.optional.present_barrier && surface.has_present_barrier(handle) {
            info = info.push_next(&mut barrier);
        }
        let loader = khr::swapchain::Device::new(handle.instance.raw(), &handle.raw);
        // SAFETY: the extension is enabled; format, size, count, mode and alpha are among what the surface has just said it
        // takes, and the surface lives as long as the swapchain.
        let raw = unsafe {
            let raw = loader
                .create_swapchain(&info, None)
                .map_err(|result| surface.refusal("creating the swapchain of", result))?;
            handle.naming.name(raw, surface.name());
            raw
        };

        // From here on it is owned, so that it is destroyed when a later step fails.
        let mut chain = RawSwapchain {
            raw,
            loader,
            acquired: Vec::new(),
            drawn: Vec::new(),
            device: Arc::clone(handle),
            surface: Arc::clone(surface),
        };
        // SAFETY: the swapchain lives.
        let raw_images = unsafe { chain.loader.get_swapchain_images(raw) }
            .map_err(|result| surface.refusal("asking for the images of", result))?;
        for _ in 0..=raw_images.len() {
            chain.acquired.push(semaphore(handle, surface.name())?);
        }
        for _ in &raw_images {
            chain.drawn.push(semaphore(handle, surface.name())?);
        }
        if pixels == Pixels::Hdr10 && handle.optional.hdr_metadata {
            tell_white(handle, raw, desc.white_nits);
        }
        let chain = Arc::new(chain);
        let size_px = [extent.width, extent.height];
        let images = raw_images
            .into_iter()
            .map(|raw| {
                // SAFETY: the image is the swapchain's, of this size and format, and holds it.
                unsafe { Image::of_swapchain(handle, surface.name(), raw, size_px, format, Arc::clone(&chain)) }
            })
            .collect::<Result<Vec<_>, _>>()?;
        let wait = handle.optional.present_wait;
        Ok(Some(Swapchain {
            waited: vec![None; images.len() + 1],
            chain: Some(chain),
            images,
            turn: 0,
            queue,
            size_px,
            format,
            pixels,
            made_for,
            made: Instant::now(),
            wait: wait.then(|| khr::present_wait::Device::new(handle.instance.raw(), &handle.raw)),
            last_id: 0,
            broken: false,
            name: surface.name().to_owned(),
            device: Arc::clone(device),
        }))
    }

    /// Columns and rows of its images.
    pub fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// The format of its images.
    pub fn format(&self) -> ImageFormat {
        self.format
    }

    /// How their numbers are to be read.
    pub fn pixels(&self) -> Pixels {
        self.pixels
    }

    /// Draws the next image by what `record` records, and shows it. Waits for an image for `patience` at most, and for nothing
    /// else.
    ///
    /// # Errors
    /// [`GpuError::SurfaceLost`], those of `record`, and what the driver says.
    pub fn show(
        &mut self,
        patience: Duration,
        record: impl FnOnce(&mut Recorder, &Arc<Image>) -> Result<(), GpuError>,
    ) -> Result<Shown, GpuError> {
        let Some(chain) = self.chain.clone().filter(|_| !self.broken) else { return Ok(Shown::Outdated) };
        // A semaphore serves again once the submission that waited for it is through.
        let acquired = chain.acquired[self.turn];
        if let Some(before) = self.waited[self.turn].take() {
            before.wait(PATIENCE)?;
        }
        let patience_ns = u64::try_from(patience.as_nanos()).unwrap_or(u64::MAX - 1);
        // SAFETY: the swapchain lives and is used by this thread alone; nothing is pending on the semaphore.
        let next = unsafe { chain.loader.acquire_next_image(chain.raw, patience_ns, acquired, vk::Fence::null()) };
        let (index, suboptimal) = match next {
            Ok((index, suboptimal)) => (index as usize, suboptimal),
            Err(vk::Result::TIMEOUT | vk::Result::NOT_READY) => return Ok(Shown::NotYet),
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => return Ok(Shown::Outdated),
            Err(result) => return Err(chain.surface.refusal("taking an image of", result)),
        };

        // What fails from here on leaves an image taken for ever, and a semaphore that nobody waits for.
        self.broken = true;
        let image = self.images.get(index).ok_or_else(|| GpuError::SurfaceLost { object: self.name.clone() })?;
        let mut recorder = Recorder::new(&self.device, self.queue, &self.name)?;
        record(&mut recorder, image)?;
        recorder.hand_over(image, [acquired, chain.drawn[index]])?;
        let submission = self.device.submit(recorder.finish()?, &[])?;
        self.waited[self.turn] = Some(submission);
        self.turn = (self.turn + 1) % self.waited.len();
        self.broken = false;

        let id = self.last_id + 1;
        let shown = self.present(&chain, index, id);
        match shown {
            Ok(suboptimal_now) => {
                self.last_id = id;
                // It was shown, if not in the best way.
                self.broken = (suboptimal || suboptimal_now) && self.could_be_better(&chain.surface)?;
                Ok(Shown::Yes(id))
            }
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => Ok(Shown::Outdated),
            Err(result) => Err(chain.surface.refusal("showing an image of", result)),
        }
    }

    /// Whether another swapchain may serve a surface better that has just said so of this one.
    fn could_be_better(&self, surface: &Surface) -> Result<bool, GpuError> {
        let wanted = Wanted::of(&surface.capabilities(self.device.handle())?, surface.size_px());
        Ok(wanted != self.made_for || self.made.elapsed() >= BETTER_AFTER)
    }

    fn present(&self, chain: &RawSwapchain, index: usize, id: u64) -> Result<bool, vk::Result> {
        let queue = &self.device.queues[self.queue];
        let (waits, chains, indices) = ([chain.drawn[index]], [chain.raw], [index as u32]);
        let ids = [id];
        let mut id_info = vk::PresentIdKHR::default().present_ids(&ids);
        let mut info =
            vk::PresentInfoKHR::default().wait_semaphores(&waits).swapchains(&chains).image_indices(&indices);
        if self.wait.is_some() {
            info = info.push_next(&mut id_info);
        }
        let _last = queue.last.lock().unwrap_or_else(PoisonError::into_inner);
        // SAFETY: the queue's lock is held. The image was acquired, and what was just submitted leaves it in the layout for
        // showing and signals the semaphore; the number grows.
        unsafe { chain.loader.queue_present(queue.raw, &info) }
    }

    /// Waits until an image was shown, by its number; false where that cannot be known, or not within `patience`.
    pub fn wait_shown(&self, id: u64, patience: Duration) -> bool {
        let (Some(wait), Some(chain)) = (&self.wait, &self.chain) else { return false };
        let patience_ns = u64::try_from(patience.as_nanos()).unwrap_or(u64::MAX - 1);
        // SAFETY: the extension is enabled and the swapchain lives.
        unsafe { wait.wait_for_present(chain.raw, id, patience_ns) }.is_ok()
    }

    /// Whether it can be known when an image was shown.
    pub fn can_wait_shown(&self) -> bool {
        self.wait.is_some()
    }
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        let queue = &self.device.queues[self.queue];
        let last = queue.last.lock().unwrap_or_else(PoisonError::into_inner);
        // A queue that does not come to rest must not keep its caller for ever: then everything stays as it is.
        if matches!(queue.timeline.wait(*last, PATIENCE), Ok(false)) {
            tracing::error!(swapchain = self.name, "a queue does not come to rest, and keeps what it shows");
            std::mem::forget(self.chain.take());
            std::mem::forget(std::mem::take(&mut self.images));
            return;
        }
        // SAFETY: the queue's lock is held. What it shows waits for semaphores, which no timeline tells of. A lost device is at
        // rest.
        let _ = unsafe { self.device.handle().raw.queue_wait_idle(queue.raw) };
        drop(last);
        self.images.clear();
        self.waited.clear();
        if let Err(error) = self.device.release().collect() {
            tracing::debug!(%error, "what was shown last is kept until the device is closed");
        }
    }
}

/// What a surface wants of its images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Wanted {
    extent: vk::Extent2D,
    transform: vk::SurfaceTransformFlagsKHR,
}

impl Wanted {
    fn of(capabilities: &vk::SurfaceCapabilitiesKHR, size_px: [u32; 2]) -> Wanted {
        Wanted { extent: extent(capabilities, size_px), transform: capabilities.current_transform }
    }
}

/// How large its images are: as the surface says, or, where it leaves that to us, as its window is.
fn extent(capabilities: &vk::SurfaceCapabilitiesKHR, size_px: [u32; 2]) -> vk::Extent2D {
    let vk::SurfaceCapabilitiesKHR { current_extent, min_image_extent: least, max_image_extent: most, .. } =
        *capabilities;
    if current_extent.width != u32::MAX {
        return current_extent;
    }
    let side = |asked: u32, least: u32, most: u32| asked.max(least).min(most.max(least));
    vk::Extent2D {
        width: side(size_px[0], least.width, most.width),
        height: side(size_px[1], least.height, most.height),
    }
}

fn semaphore(device: &DeviceHandle, name: &str) -> Result<vk::Semaphore, GpuError> {
    // SAFETY: a plain semaphore without preconditions, named before anyone else has it.
    unsafe {
        let raw = device
            .raw
            .create_semaphore(&vk::SemaphoreCreateInfo::default(), None)
            .map_err(|result| GpuError::vulkan(format!("creating a semaphore of {name:?}"), result))?;
        device.naming.name(raw, name);
        Ok(raw)
    }
}

/// Tells a screen how bright white is, and that nothing is brighter: a projector's image has no highlights beyond it.
fn tell_white(device: &DeviceHandle, swapchain: vk::SwapchainKHR, white_nits: f32) {
    let at = |x, y| vk::XYColorEXT { x, y };
    let metadata = [vk::HdrMetadataEXT::default()
        .display_primary_red(at(0.708, 0.292))
        .display_primary_green(at(0.170, 0.797))
        .display_primary_blue(at(0.131, 0.046))
        .white_point(at(0.3127, 0.3290))
        .max_luminance(white_nits)
        .max_content_light_level(white_nits)
        .max_frame_average_light_level(white_nits)];
    let loader = ext::hdr_metadata::Device::new(device.instance.raw(), &device.raw);
    // SAFETY: the extension is enabled, and the swapchain was just made.
    unsafe { loader.set_hdr_metadata(&[swapchain], &metadata) };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surface_that_leaves_its_size_to_us_gets_that_of_its_window_within_its_bounds() {
        let mut of = vk::SurfaceCapabilitiesKHR {
            current_extent: vk::Extent2D { width: 640, height: 400 },
            min_image_extent: vk::Extent2D { width: 1, height: 1 },
            max_image_extent: vk::Extent2D { width: 1000, height: 1000 },
            ..Default::default()
        };
        let size = |of: &vk::SurfaceCapabilitiesKHR, wanted| {
            let extent = extent(of, wanted);
            [extent.width, extent.height]
        };
        assert_eq!(size(&of, [1280, 800]), [640, 400]);
        of.current_extent = vk::Extent2D { width: u32::MAX, height: u32::MAX };
        assert_eq!(size(&of, [1280, 800]), [1000, 800]);
        assert_eq!(size(&of, [0, 800]), [1, 800]);
        // A minimised window.
        (of.current_extent.width, of.current_extent.height) = (0, 0);
        assert_eq!(size(&of, [1280, 800]), [0, 0]);
    }
}
