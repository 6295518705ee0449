//! Two-dimensional images with one level, one layer and one sample.

use std::ops::BitOr;
use std::sync::{Arc, Mutex};

use ash::vk;
use gpu_allocator::MemoryLocation;

use crate::chain::RawSwapchain;
use crate::device::Device;
use crate::error::GpuError;
use crate::format::ImageFormat;
use crate::handle::DeviceHandle;
use crate::history::History;
use crate::memory::Memory;

/// What an image may be used for; combined by `|`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageUsage(u32);

impl ImageUsage {
    /// A colour attachment.
    pub const COLOR: ImageUsage = ImageUsage(1);
    /// A depth attachment.
    pub const DEPTH: ImageUsage = ImageUsage(2);
    /// A storage image.
    pub const STORAGE: ImageUsage = ImageUsage(4);
    /// A sampled image.
    pub const SAMPLED: ImageUsage = ImageUsage(8);
    /// Source and destination of copies.
    pub const TRANSFER: ImageUsage = ImageUsage(16);

    /// Whether all of `other` is in it.
    pub fn contains(self, other: ImageUsage) -> bool {
        self.0 & other.0 == other.0
    }

    fn raw(self) -> vk::ImageUsageFlags {
        let pairs = [
            (ImageUsage::COLOR, vk::ImageUsageFlags::COLOR_ATTACHMENT),
            (ImageUsage::DEPTH, vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT),
            (ImageUsage::STORAGE, vk::ImageUsageFlags::STORAGE),
            (ImageUsage::SAMPLED, vk::ImageUsageFlags::SAMPLED),
            (ImageUsage::TRANSFER, vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST),
        ];
        pairs
            .iter()
            .filter(|(usage, _)| self.contains(*usage))
            .fold(vk::ImageUsageFlags::empty(), |all, (_, raw)| all | *raw)
    }
}

impl BitOr for ImageUsage {
    type Output = ImageUsage;

    fn bitor(self, other: ImageUsage) -> ImageUsage {
        ImageUsage(self.0 | other.0)
    }
}

/// An image on a device. Its contents are undetermined until something writes them.
pub struct Image {
    pub(crate) raw: vk::Image,
    pub(crate) view: vk::ImageView,
    pub(crate) device: Arc<DeviceHandle>,
    pub(crate) history: Mutex<History>,
    memory: Option<Memory>,
    /// Where the image is a surface's: what owns it.
    swapchain: Option<Arc<RawSwapchain>>,
    name: String,
    width_px: u32,
    height_px: u32,
    format: ImageFormat,
    usage: ImageUsage,
}

impl std::fmt::Debug for Image {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Image({:?}, {}x{} px, {:?})", self.name, self.width_px, self.height_px, self.format)
    }
}

impl Image {
    /// Creates an image of `width_px` × `height_px` pixels.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], [`GpuError::Misuse`] for no pixels or no usage, [`GpuError::Unsupported`] where the
    /// device has no such use of this format, [`GpuError::OutOfDeviceMemory`].
    pub fn new(
        device: &Arc<Device>,
        name: &str,
        width_px: u32,
        height_px: u32,
        format: ImageFormat,
        usage: ImageUsage,
    ) -> Result<Arc<Image>, GpuError> {
        let device = device.handle();
        check(device, name, [width_px, height_px], format, usage)?;
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format.raw())
            .extent(vk::Extent3D { width: width_px, height: height_px, depth: 1 })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(usage.raw())
            .initial_layout(vk::ImageLayout::UNDEFINED);
        // SAFETY: the device supports this format, usage and size, as just checked; the new object is named before
        // anyone else has it.
        let raw = unsafe {
            let raw = device
                .raw
                .create_image(&info, None)
                .map_err(|result| GpuError::vulkan(format!("creating image {name:?}"), result))?;
            device.naming.name(raw, name);
            raw
        };

        // From here on the image is owned, so that it is destroyed when a later step fails.
        let mut image = Image {
            raw,
            view: vk::ImageView::null(),
            device: Arc::clone(device),
            history: Mutex::default(),
            memory: None,
            swapchain: None,
            name: name.into(),
            width_px,
            height_px,
            format,
            usage,
        };
        image.bind_memory()?;

        // A view is for shaders and attachments; an image for copies alone may have none.
        if usage != ImageUsage::TRANSFER {
            image.make_view()?;
        }
        Ok(Arc::new(image))
    }

    /// An image of a swapchain, to be drawn to.
    ///
    /// # Safety
    /// `raw` is an image of `swapchain`, of this device, size and format.
    pub(crate) unsafe fn of_swapchain(
        device: &Arc<DeviceHandle>,
        name: &str,
        raw: vk::Image,
        [width_px, height_px]: [u32; 2],
        format: ImageFormat,
        swapchain: Arc<RawSwapchain>,
    ) -> Result<Arc<Image>, GpuError> {
        let mut image = Image {
            raw,
            view: vk::ImageView::null(),
            device: Arc::clone(device),
            history: Mutex::default(),
            memory: None,
            swapchain: Some(swapchain),
            name: name.into(),
            width_px,
            height_px,
            format,
            usage: ImageUsage::COLOR,
        };
        image.make_view()?;
        Ok(Arc::new(image))
    }

    /// Whether it is a surface's, and so taken and handed over by semaphores.
    pub(crate) fn is_of_swapchain(&self) -> bool {
        self.swapchain.is_some()
    }

    /// Its width in pixels.
    pub fn width_px(&self) -> u32 {
        self.width_px
    }

    /// Its height in pixels.
    pub fn height_px(&self) -> u32 {
        self.height_px
    }

    /// The format of its pixels.
    pub fn format(&self) -> ImageFormat {
        self.format
    }

    /// What it may be used for.
    pub fn usage(&self) -> ImageUsage {
        self.usage
    }

    /// Its name, as the validation layer says it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Bytes of all its pixels, row by row without gaps.
    pub fn bytes(&self) -> u64 {
        u64::from(self.width_px) * u64::from(self.height_px) * self.format.bytes()
    }

    /// All of it: one level, one layer.
    pub(crate) fn range(&self) -> vk::ImageSubresourceRange {
        vk::ImageSubresourceRange::default().aspect_mask(self.format.aspect()).level_count(1).layer_count(1)
    }

    pub(crate) fn extent(&self) -> vk::Extent2D {
        vk::Extent2D { width: self.width_px, height: self.height_px }
    }

    /// Refuses a use that the image was not created for.
    pub(crate) fn require(&self, usage: ImageUsage, what: &str) -> Result<(), GpuError> {
        if self.usage.contains(usage) {
            Ok(())
        } else {
            Err(GpuError::misuse(&self.name, format!("it was not created to be used as {what}")))
        }
    }

    fn make_view(&mut self) -> Result<(), GpuError> {
        let info = vk::ImageViewCreateInfo::default()
            .image(self.raw)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(self.format.raw())
            .subresource_range(self.range());
        // SAFETY: the image has memory and a usage that a view may have.
        self.view = unsafe { self.device.raw.create_image_view(&info, None) }
            .map_err(|result| GpuError::vulkan(format!("creating the view of image {:?}", self.name), result))?;
        Ok(())
    }

    fn bind_memory(&mut self) -> Result<(), GpuError> {
        // SAFETY: the image was just created and has no memory yet; the memory suits its requirements, and `self`
        // drops the image before the memory.
        unsafe {
            let requirements = self.device.raw.get_image_memory_requirements(self.raw);
            let memory = Memory::new(&self.device, &self.name, requirements, MemoryLocation::GpuOnly, false)?;
            let (object, offset) = memory.place();
            self.memory = Some(memory);
            self.device
                .raw
                .bind_image_memory(self.raw, object, offset)
                .map_err(|result| GpuError::vulkan(format!("binding memory to image {:?}", self.name), result))
        }
    }
}

impl Drop for Image {
    fn drop(&mut self) {
        // SAFETY: whatever uses the image on the device holds it by Arc until it has completed, so nothing does; the
        // view is null or this image's, and the memory is dropped after this. A swapchain destroys its images itself.
        unsafe {
            self.device.raw.destroy_image_view(self.view, None);
            if self.swapchain.is_none() {
                self.device.raw.destroy_image(self.raw, None);
            }
        }
    }
}

/// Refuses an image that the device cannot have.
fn check(
    device: &DeviceHandle,
    name: &str,
    [width_px, height_px]: [u32; 2],
    format: ImageFormat,
    usage: ImageUsage,
) -> Result<(), GpuError> {
    let is_depth = format == ImageFormat::Depth32;
    if width_px == 0 || height_px == 0 {
        return Err(GpuError::misuse(name, format!("an image of {width_px}x{height_px} px")));
    }
    if usage.0 == 0 || usage.contains(if is_depth { ImageUsage::COLOR } else { ImageUsage::DEPTH }) {
        return Err(GpuError::misuse(name, format!("usage {:#x} does not fit format {format:?}", usage.0)));
    }

    // Attachments have limits of their own beside those of images.
    let limits = &device.limits;
    let target = usage.contains(ImageUsage::COLOR) || usage.contains(ImageUsage::DEPTH);
    for (asked, max_target_px) in [width_px, height_px].into_iter().zip(limits.max_target_px) {
        let limit = if target { limits.max_image_px.min(max_target_px) } else { limits.max_image_px };
        if asked > limit {
            return Err(GpuError::TooLarge {
                object: name.into(),
                asked: asked.into(),
                limit: limit.into(),
                unit: "px",
            });
        }
    }

    // SAFETY: the physical device is one that the instance listed.
    let supported = unsafe {
        device.instance.raw().get_physical_device_image_format_properties(
            device.physical,
            format.raw(),
            vk::ImageType::TYPE_2D,
            vk::ImageTiling::OPTIMAL,
            usage.raw(),
            vk::ImageCreateFlags::empty(),
        )
    };
    match supported {
        Ok(there) if there.max_extent.width >= width_px && there.max_extent.height >= height_px => Ok(()),
        Ok(there) => {
            let (asked, limit) = if there.max_extent.width < width_px {
                (width_px, there.max_extent.width)
            } else {
                (height_px, there.max_extent.height)
            };
            Err(GpuError::TooLarge { object: name.into(), asked: asked.into(), limit: limit.into(), unit: "px" })
        }
        Err(vk::Result::ERROR_FORMAT_NOT_SUPPORTED) => Err(GpuError::Unsupported {
            device: format!("image {name:?} on device {:?}", device.info.name),
            missing: format!("format {format:?} for {:?}", usage.raw()),
        }),
        Err(result) => Err(GpuError::vulkan(format!("asking for the format of image {name:?}"), result)),
    }
}
