//! The formats of images.

use ash::vk;

/// The format of an image's pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageFormat {
    /// Four bytes that a shader sees as 0 to 1.
    Rgba8Unorm,
    /// The same with blue first: what screens often want.
    Bgra8Unorm,
    /// Ten bits for each of three channels, red in the lowest, and two.
    Rgb10a2Unorm,
    /// The same with blue in the lowest.
    Bgr10a2Unorm,
    /// Four 16-bit floats.
    Rgba16Float,
    /// Four 32-bit floats.
    Rgba32Float,
    /// One 32-bit float.
    R32Float,
    /// One 32-bit unsigned integer.
    R32Uint,
    /// Depth as a 32-bit float.
    Depth32,
}

impl ImageFormat {
    /// Bytes of one pixel, in a buffer that the image is copied to.
    pub fn bytes(self) -> u64 {
        match self {
            ImageFormat::Rgba8Unorm | ImageFormat::Bgra8Unorm => 4,
            ImageFormat::Rgb10a2Unorm | ImageFormat::Bgr10a2Unorm => 4,
            ImageFormat::R32Float | ImageFormat::R32Uint | ImageFormat::Depth32 => 4,
            ImageFormat::Rgba16Float => 8,
            ImageFormat::Rgba32Float => 16,
        }
    }

    pub(crate) fn raw(self) -> vk::Format {
        match self {
            ImageFormat::Rgba8Unorm => vk::Format::R8G8B8A8_UNORM,
            ImageFormat::Bgra8Unorm => vk::Format::B8G8R8A8_UNORM,
            ImageFormat::Rgb10a2Unorm => vk::Format::A2B10G10R10_UNORM_PACK32,
            ImageFormat::Bgr10a2Unorm => vk::Format::A2R10G10B10_UNORM_PACK32,
            ImageFormat::Rgba16Float => vk::Format::R16G16B16A16_SFLOAT,
            ImageFormat::Rgba32Float => vk::Format::R32G32B32A32_SFLOAT,
            ImageFormat::R32Float => vk::Format::R32_SFLOAT,
            ImageFormat::R32Uint => vk::Format::R32_UINT,
            ImageFormat::Depth32 => vk::Format::D32_SFLOAT,
        }
    }

    pub(crate) fn aspect(self) -> vk::ImageAspectFlags {
        match self {
            ImageFormat::Depth32 => vk::ImageAspectFlags::DEPTH,
            _ => vk::ImageAspectFlags::COLOR,
        }
    }
}
