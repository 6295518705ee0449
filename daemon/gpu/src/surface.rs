//! What images are shown on: a window, or a display without a desktop.

use std::sync::Arc;

use ash::{khr, vk};

use crate::error::GpuError;
use crate::format::ImageFormat;
use crate::handle::DeviceHandle;
use crate::instance::Instance;
use crate::lease::Lease;
use crate::window::{System, Window};

/// Numbers of a surface's pixels, and how they are to be read.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Pixels {
    /// Eight bits a channel, sRGB.
    #[default]
    Bits8,
    /// Ten bits a channel, sRGB.
    Bits10,
    /// Ten bits a channel, BT.2020 primaries and the perceptual quantiser of SMPTE ST 2084: HDR10.
    Hdr10,
}

/// What keeps a surface's ground alive.
enum Ground {
    Window(Arc<Window>),
    Display(Lease),
}

/// Something to show images on.
pub struct Surface {
    pub(crate) raw: vk::SurfaceKHR,
    loader: khr::surface::Instance,
    /// Under the surface, and so dropped after it.
    ground: Ground,
    instance: Arc<Instance>,
    name: String,
}

impl std::fmt::Debug for Surface {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Surface({:?})", self.name)
    }
}

impl Surface {
    /// The surface of a window. A window has one at most at a time.
    ///
    /// # Errors
    /// [`GpuError::Unsupported`] where the driver knows no windows of that system; or the driver's refusal.
    pub fn of_window(instance: &Arc<Instance>, window: &Arc<Window>) -> Result<Arc<Surface>, GpuError> {
        let name = window.name().to_owned();
        let refused = |result| GpuError::vulkan(format!("creating the surface of window {name:?}"), result);
        let need = |extension: &std::ffi::CStr| require(instance, extension, &name);
        let raw = match &window.system {
            System::X11(of) => {
                need(khr::xcb_surface::NAME)?;
                let loader = khr::xcb_surface::Instance::new(instance.entry(), instance.raw());
                let info = vk::XcbSurfaceCreateInfoKHR::default()
                    .connection(of.connection.get_raw_xcb_connection())
                    .window(of.raw);
                // SAFETY: the extension is enabled; connection and window live as long as the surface, which owns them.
                unsafe { loader.create_xcb_surface(&info, None) }.map_err(refused)?
            }
            System::Wayland(of) => {
                need(khr::wayland_surface::NAME)?;
                let loader = khr::wayland_surface::Instance::new(instance.entry(), instance.raw());
                let surface = of.surface().as_ptr();
                let info = vk::WaylandSurfaceCreateInfoKHR::default()
                    .display(of.connection.backend().display_ptr().cast())
                    .surface(surface.cast());
                if surface.is_null() {
                    return Err(GpuError::SurfaceLost { object: name });
                }
                // SAFETY: the extension is enabled; connection and window live as long as the surface, which owns them, and
                // nobody else can destroy them.
                unsafe { loader.create_wayland_surface(&info, None) }.map_err(refused)?
            }
        };
        Ok(Surface::own(instance, raw, Ground::Window(Arc::clone(window)), name))
    }

    /// The surface of a display, which is the caller's alone.
    pub(crate) fn of_display(
        instance: &Arc<Instance>,
        raw: vk::SurfaceKHR,
        lease: Lease,
        name: String,
    ) -> Arc<Surface> {
        Surface::own(instance, raw, Ground::Display(lease), name)
    }

    fn own(instance: &Arc<Instance>, raw: vk::SurfaceKHR, ground: Ground, name: String) -> Arc<Surface> {
        let loader = khr::surface::Instance::new(instance.entry(), instance.raw());
        Arc::new(Surface { raw, loader, ground, instance: Arc::clone(instance), name })
    }

    /// Its name, as the validation layer says it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Columns and rows that it has now.
    pub fn size_px(&self) -> [u32; 2] {
        match &self.ground {
            Ground::Window(window) => window.size_px(),
            Ground::Display(lease) => lease.size_px(),
        }
    }

    /// Whether it is the only thing on its screen, so that its images are best shown at the screen's own pace.
    pub(crate) fn is_display(&self) -> bool {
        matches!(self.ground, Ground::Display(_))
    }

    /// Refuses a queue family that cannot show images on it.
    pub(crate) fn check_family(&self, device: &DeviceHandle, family: u32) -> Result<(), GpuError> {
        // SAFETY: the physical device is of this instance, and has that family.
        let serves = unsafe { self.loader.get_physical_device_surface_support(device.physical, family, self.raw) }
            .map_err(|result| self.refusal("asking who can show on", result))?;
        if serves {
            return Ok(());
        }
        let missing = format!("a way to show images on {:?} from its queues of family {family}", self.name);
        Err(GpuError::Unsupported { device: format!("device {:?}", device.info.name), missing })
    }

    pub(crate) fn capabilities(&self, device: &DeviceHandle) -> Result<vk::SurfaceCapabilitiesKHR, GpuError> {
        // SAFETY: the physical device is of this instance, and can show on the surface, as was asked before.
        unsafe { self.loader.get_physical_device_surface_capabilities(device.physical, self.raw) }
            .map_err(|result| self.refusal("asking what can be shown on", result))
    }

    /// How its images are shown: at a display's own pace, without tearing; in a window the newest one, so that no compositor that
    /// does not show it keeps the caller waiting, where there is such a mode.
    pub(crate) fn present_mode(&self, device: &DeviceHandle) -> Result<vk::PresentModeKHR, GpuError> {
        // SAFETY: as above.
        let modes = unsafe { self.loader.get_physical_device_surface_present_modes(device.physical, self.raw) }
            .map_err(|result| self.refusal("asking for the present modes of", result))?;
        let newest = !self.is_display() && modes.contains(&vk::PresentModeKHR::MAILBOX);
        Ok(if newest { vk::PresentModeKHR::MAILBOX } else { vk::PresentModeKHR::FIFO })
    }

    /// The format for such pixels, or the next best that is offered.
    pub(crate) fn format(
        &self,
        device: &DeviceHandle,
        wanted: Pixels,
    ) -> Result<(ImageFormat, vk::ColorSpaceKHR, Pixels), GpuError> {
        // SAFETY: as above.
        let offered = unsafe { self.loader.get_physical_device_surface_formats(device.physical, self.raw) }
            .map_err(|result| self.refusal("asking for the formats of", result))?;
        choose(&offered, wanted).ok_or_else(|| GpuError::Unsupported {
            device: format!("surface {:?}", self.name),
            missing: "pixels of eight or ten bits a channel in sRGB".into(),
        })
    }

    /// Whether its swapchains may flip together with others (`VK_NV_present_barrier`), on a device that has the extension.
    pub(crate) fn has_present_barrier(&self, device: &DeviceHandle) -> bool {
        let loader = khr::get_surface_capabilities2::Instance::new(self.instance.entry(), self.instance.raw());
        let of = vk::PhysicalDeviceSurfaceInfo2KHR::default().surface(self.raw);
        let mut barrier = vk::SurfaceCapabilitiesPresentBarrierNV::default();
        let mut all = vk::SurfaceCapabilities2KHR::default().push_next(&mut barrier);
        // SAFETY: the extensions of the call and of the structure are there, as the device's own switch says.
        let asked = unsafe { loader.get_physical_device_surface_capabilities2(device.physical, &of, &mut all) };
        asked.is_ok() && barrier.present_barrier_supported == vk::TRUE
    }

    pub(crate) fn refusal(&self, operation: &str, result: vk::Result) -> GpuError {
        match result {
            vk::Result::ERROR_SURFACE_LOST_KHR => GpuError::SurfaceLost { object: self.name.clone() },
            result => GpuError::vulkan(format!("{operation} {:?}", self.name), result),
        }
    }
}

impl Drop for Surface {
    fn drop(&mut self) {
        // SAFETY: swapchains hold the surface by Arc, so none is left; what it stands on is dropped after this.
        unsafe { self.loader.destroy_surface(self.raw, None) };
    }
}

/// Refuses a surface whose extension the loader or every driver lacks.
fn require(instance: &Instance, extension: &std::ffi::CStr, name: &str) -> Result<(), GpuError> {
    if instance.has(extension) {
        return Ok(());
    }
    let missing = format!("{}, by which {name:?} would be shown", extension.to_string_lossy());
    Err(GpuError::Unsupported { device: "the vulkan driver".into(), missing })
}

/// Of what is offered the best that is no better than wanted.
fn choose(offered: &[vk::SurfaceFormatKHR], wanted: Pixels) -> Option<(ImageFormat, vk::ColorSpaceKHR, Pixels)> {
    let srgb = vk::ColorSpaceKHR::SRGB_NONLINEAR;
    let ten = [ImageFormat::Rgb10a2Unorm, ImageFormat::Bgr10a2Unorm];
    let eight = [ImageFormat::Rgba8Unorm, ImageFormat::Bgra8Unorm];
    let rows = [
        (Pixels::Hdr10, ten, vk::ColorSpaceKHR::HDR10_ST2084_EXT),
        (Pixels::Bits10, ten, srgb),
        (Pixels::Bits8, eight, srgb),
    ];
    let mut candidates = rows.into_iter().filter(|(pixels, ..)| *pixels <= wanted);
    candidates.find_map(|(pixels, formats, space)| {
        let there = |format: &ImageFormat| {
            offered.iter().any(|offer| offer.format == format.raw() && offer.color_space == space)
        };
        Some((formats.into_iter().find(there)?, space, pixels))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_format_that_is_offered_and_no_better_than_wanted_is_taken() {
        let srgb = vk::ColorSpaceKHR::SRGB_NONLINEAR;
        let offer = |format, color_space| vk::SurfaceFormatKHR { format, color_space };
        let eight = [offer(vk::Format::B8G8R8A8_SRGB, srgb), offer(vk::Format::B8G8R8A8_UNORM, srgb)];
        let bgra = Some((ImageFormat::Bgra8Unorm, srgb, Pixels::Bits8));
        assert_eq!([Pixels::Bits8, Pixels::Bits10, Pixels::Hdr10].map(|p| choose(&eight, p)), [bgra; 3]);
        let hdr = vk::ColorSpaceKHR::HDR10_ST2084_EXT;
        let ten = vk::Format::A2B10G10R10_UNORM_PACK32;
        let all = [eight[1], offer(ten, srgb), offer(ten, hdr)];
        let rgb10 = |space, pixels| Some((ImageFormat::Rgb10a2Unorm, space, pixels));
        assert_eq!(choose(&all, Pixels::Bits8), bgra);
        assert_eq!(choose(&all, Pixels::Bits10), rgb10(srgb, Pixels::Bits10));
        assert_eq!(choose(&all, Pixels::Hdr10), rgb10(hdr, Pixels::Hdr10));
        // A format that encodes by itself would encode a second time.
        assert_eq!(choose(&eight[..1], Pixels::Hdr10), None);
    }
}
