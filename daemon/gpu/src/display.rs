//! Displays without a desktop (`VK_KHR_display`): found by connector or by who is plugged in there, and taken over for good where
//! the driver lets that be done (`VK_EXT_acquire_drm_display`).

use std::sync::Arc;

use ash::{ext, khr, vk};

use crate::card::Card;
use crate::connectors::Connector;
use crate::device::Device;
use crate::error::GpuError;
use crate::handle::DeviceHandle;
use crate::lease::Lease;
use crate::surface::Surface;

/// How far the rate of a mode may be from the one asked for, Hz: 60 is also 59.94, and 240 is 239.76.
const RATE_TOLERANCE_HZ: f64 = 0.5;

/// What goes wrong with displays.
#[derive(Debug, thiserror::Error)]
pub enum DisplayError {
    /// The driver cannot show anything without a desktop.
    #[error(
        "display {display:?}: the driver of {device:?} has no VK_KHR_display; hint: use another device, or a window \
         (kind = \"window\")"
    )]
    NoDisplays {
        /// The output.
        display: String,
        /// The device.
        device: String,
    },
    /// Nothing is there by that name.
    #[error("display {display:?}: nothing is plugged in at {wanted}; hint: there are {have}")]
    NotThere {
        /// The output.
        display: String,
        /// What was asked for.
        wanted: String,
        /// What there is.
        have: String,
    },
    /// Somebody else has it, or may not give it.
    #[error(
        "display {display:?}: {connector} cannot be taken: {detail}; hint: no desktop may run on it, and the daemon's user must \
             be in group video"
    )]
    Taken {
        /// The output.
        display: String,
        /// The connector.
        connector: String,
        /// What the system says.
        detail: String,
    },
    /// It cannot show so many pixels.
    #[error("display {display:?}: {connector} has no mode of {width_px}x{height_px} px; hint: it has {have}")]
    NoMode {
        /// The output.
        display: String,
        /// The connector.
        connector: String,
        /// The columns asked for.
        width_px: u32,
        /// The rows.
        height_px: u32,
        /// Its modes.
        have: String,
    },
    /// It cannot show so many pixels so often.
    #[error(
        "display {display:?}: {connector} does not show {width_px}x{height_px} px at {refresh_hz} Hz; hint: it has {have}; set \
         refresh_hz to one of these rates, or leave it out"
    )]
    NoRate {
        /// The output.
        display: String,
        /// The connector.
        connector: String,
        /// The columns asked for.
        width_px: u32,
        /// The rows.
        height_px: u32,
        /// The rate asked for.
        refresh_hz: f64,
        /// Its modes of so many pixels.
        have: String,
    },
    /// The driver refuses.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// Which display, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct DisplayDesc {
    /// Its name in messages.
    pub name: String,
    /// The connector that it is plugged in at, such as `DP-1`.
    pub connector: Option<String>,
    /// Who it is, wherever it is plugged in ([`Identity`](crate::Identity)).
    pub edid: Option<String>,
    /// Columns and rows of its mode.
    pub size_px: [u32; 2],
    /// How often it is to show another image, Hz, to half a hertz; None: as often as it can.
    pub refresh_hz: Option<f64>,
}

impl DisplayDesc {
    fn wanted(&self) -> String {
        match (&self.connector, &self.edid) {
            (Some(connector), Some(edid)) => format!("{connector} that is {edid}"),
            (Some(connector), None) => connector.clone(),
            (None, Some(edid)) => format!("any connector that is {edid}"),
            (None, None) => "any connector".into(),
        }
    }

    /// Whether a connector is meant, with what is plugged in there.
    fn means(&self, connector: &Connector) -> bool {
        let name = self.connector.as_ref().is_none_or(|name| *name == connector.name);
        let is = |edid: &String| connector.identity.as_ref().is_some_and(|identity| identity.is(edid));
        name && self.edid.as_ref().is_none_or(is)
    }
}

/// A display that was opened.
#[derive(Debug)]
pub struct OpenedDisplay {
    /// To show images on.
    pub surface: Arc<Surface>,
    /// Its connector, where that is known.
    pub connector: Option<Connector>,
    /// How often it shows another image, Hz.
    pub refresh_hz: f64,
}

impl Device {
    /// Takes a display, in the mode asked for.
    ///
    /// # Errors
    /// [`DisplayError`], each with the output's name.
    pub fn open_display(&self, desc: &DisplayDesc) -> Result<OpenedDisplay, DisplayError> {
        let handle = self.handle();
        let instance = &handle.instance;
        if !instance.has(khr::display::NAME) {
            return Err(DisplayError::NoDisplays { display: desc.name.clone(), device: handle.info.name.clone() });
        }
        let loader = khr::display::Instance::new(instance.entry(), instance.raw());
        let mut lease = find(handle, &loader, desc)?;
        let connector = lease.connector.as_ref().map_or_else(|| desc.wanted(), |connector| connector.name.clone());
        let (mode, refresh_hz) = mode(handle, &loader, &lease, &connector, desc)?;
        lease.size_px = desc.size_px;

        let refused = |result| GpuError::vulkan(format!("showing on display {:?}", desc.name), result);
        let plane = plane(handle, &loader, lease.display).map_err(refused)?.ok_or_else(|| DisplayError::Taken {
            display: desc.name.clone(),
            connector,
            detail: "no plane is free for it".into(),
        })?;
        let info = vk::DisplaySurfaceCreateInfoKHR::default()
            .display_mode(mode)
            .plane_index(plane.0)
            .plane_stack_index(plane.1)
            .transform(vk::SurfaceTransformFlagsKHR::IDENTITY)
            .alpha_mode(vk::DisplayPlaneAlphaFlagsKHR::OPAQUE)
            .image_extent(vk::Extent2D { width: desc.size_px[0], height: desc.size_px[1] });
        // SAFETY: the mode is the display's, the plane can show it and no other display has it; the lease lives as long as the
        // surface, which owns it.
        let raw = unsafe { loader.create_display_plane_surface(&info, None) }.map_err(refused)?;
        let connector = lease.connector.clone();
        Ok(OpenedDisplay {
            surface: Surface::of_display(instance, raw, lease, desc.name.clone()),
            connector,
            refresh_hz,
        })
    }
}

/// Finds the display, and acquires it where the driver can.
fn find(handle: &DeviceHandle, loader: &khr::display::Instance, desc: &DisplayDesc) -> Result<Lease, DisplayError> {
    let instance = &handle.instance;
    let connectors = Connector::all();
    let lease = |display, card, connector| Lease { display, card, connector, size_px: desc.size_px };
    let not_there = |have: Vec<String>| DisplayError::NotThere {
        display: desc.name.clone(),
        wanted: desc.wanted(),
        have: if have.is_empty() { "none".into() } else { have.join(", ") },
    };

    // By the kernel's names: these and what is plugged in there stay the same, whatever the order in which things came up.
    if instance.has(ext::acquire_drm_display::NAME) && instance.has(ext::direct_mode_display::NAME) {
        let connected: Vec<_> = connectors.iter().filter(|connector| connector.connected).collect();
        let connector = connected
            .iter()
            .find(|connector| desc.means(connector))
            .ok_or_else(|| not_there(connected.iter().map(|connector| words(connector)).collect()))?;
        let taken = |detail: String| DisplayError::Taken {
            display: desc.name.clone(),
            connector: connector.name.clone(),
            detail,
        };
        let path = connector.device_file();
        let card = Card::of(instance, handle.physical, &path)
            .map_err(|error| taken(format!("{}: {error}", path.display())))?;
        let id = card.connector_id(&connector.name).map_err(|error| taken(error.to_string()))?;
        let id = id.ok_or_else(|| taken(format!("{} does not know it", connector.card)))?;
        let display =
            card.display(id).map_err(|result| taken(format!("{} does not drive it: {result}", handle.info.name)))?;
        card.acquire(display).map_err(|error| taken(error.to_string()))?;
        return Ok(lease(display, Some(card), Some((*connector).clone())));
    }

    // By the driver's own names, which hold the connector's or the screen's.
    // SAFETY: the extension is enabled, and the device is one that this instance listed.
    let listed = unsafe { loader.get_physical_device_display_properties(handle.physical) }
        .map_err(|result| GpuError::vulkan("listing the displays", result))?;
    let mut have = Vec::new();
    for display in &listed {
        // SAFETY: the display was just listed, and its name is null or a C string.
        let name = unsafe { crate::info::name_at(display.display_name) };
        let known = connectors.iter().filter(|connector| connector.connected).find(|connector| {
            let screen = connector.identity.as_ref().and_then(|identity| identity.name.as_deref());
            names(&name, &connector.name) || screen.is_some_and(|screen| names(&name, screen))
        });
        let by_name = || {
            let holds = |part: &Option<String>| part.as_ref().is_none_or(|part| names(&name, part));
            holds(&desc.connector) && holds(&desc.edid)
        };
        if known.map_or_else(by_name, |connector| desc.means(connector)) {
            return Ok(lease(display.display, None, known.cloned()));
        }
        have.push(name);
    }
    Err(not_there(have))
}

/// Whether a driver's name of a display has a part as a word or words of its own: `eDP-1` has no `DP-1`, and `Screen (DP-1)` has.
fn names(name: &str, part: &str) -> bool {
    let ends = |beyond: Option<char>| beyond.is_none_or(|c| !c.is_alphanumeric() && !['-', '_'].contains(&c));
    !part.is_empty()
        && name.match_indices(part).any(|(start, _)| {
            ends(name[..start].chars().next_back()) && ends(name[start + part.len()..].chars().next())
        })
}

fn words(connector: &Connector) -> String {
    match &connector.identity {
        Some(identity) => {
            format!("{} ({}, {})", connector.name, identity.id, identity.name.as_deref().unwrap_or("nameless"))
        }
        None => connector.name.clone(),
    }
}

/// The mode for what was asked for, and how often it shows another image, Hz.
fn mode(
    handle: &DeviceHandle,
    loader: &khr::display::Instance,
    lease: &Lease,
    connector: &str,
    desc: &DisplayDesc,
) -> Result<(vk::DisplayModeKHR, f64), DisplayError> {
    // SAFETY: the extension is enabled, and the display is the device's.
    let modes = unsafe { loader.get_display_mode_properties(handle.physical, lease.display) }
        .map_err(|result| GpuError::vulkan(format!("listing the modes of display {:?}", desc.name), result))?;
    choose(&modes, connector, desc).map(|mode| (mode.display_mode, hz(&mode)))
}

fn hz(mode: &vk::DisplayModePropertiesKHR) -> f64 {
    f64::from(mode.parameters.refresh_rate) / 1000.0
}

/// Of the modes of just so many pixels the one of the rate asked for, or the fastest where none was.
fn choose(
    modes: &[vk::DisplayModePropertiesKHR],
    connector: &str,
    desc: &DisplayDesc,
) -> Result<vk::DisplayModePropertiesKHR, DisplayError> {
    let size = |mode: &vk::DisplayModePropertiesKHR| {
        [mode.parameters.visible_region.width, mode.parameters.visible_region.height]
    };
    let [width_px, height_px] = desc.size_px;
    let (display, connector) = (desc.name.clone(), connector.to_owned());
    let fitting: Vec<_> = modes.iter().filter(|mode| size(mode) == desc.size_px).copied().collect();
    let far =
        |mode: &vk::DisplayModePropertiesKHR| desc.refresh_hz.map_or(-hz(mode), |wanted| (hz(mode) - wanted).abs());
    let Some(best) = fitting.iter().min_by(|a, b| far(a).total_cmp(&far(b))) else {
        let in_words = |mode| format!("{}x{} at {:.2} Hz", size(mode)[0], size(mode)[1], hz(mode));
        let have = modes.iter().map(in_words).collect::<Vec<_>>().join(", ");
        return Err(DisplayError::NoMode { display, connector, width_px, height_px, have });
    };
    match desc.refresh_hz {
        Some(refresh_hz) if far(best) > RATE_TOLERANCE_HZ => {
            let have = fitting.iter().map(|mode| format!("{:.2} Hz", hz(mode))).collect::<Vec<_>>().join(", ");
            Err(DisplayError::NoRate { display, connector, width_px, height_px, refresh_hz, have })
        }
        _ => Ok(*best),
    }
}

/// A plane that can show the display and shows no other: its index, and its place in the stack.
fn plane(
    handle: &DeviceHandle,
    loader: &khr::display::Instance,
    display: vk::DisplayKHR,
) -> Result<Option<(u32, u32)>, vk::Result> {
    // SAFETY: the extension is enabled, and the device is one that this instance listed; so below for each plane listed.
    let planes = unsafe { loader.get_physical_device_display_plane_properties(handle.physical) }?;
    for (index, plane) in (0u32..).zip(planes) {
        let free = plane.current_display == vk::DisplayKHR::null() || plane.current_display == display;
        // SAFETY: as above.
        let can_show = unsafe { loader.get_display_plane_supported_displays(handle.physical, index) }?;
        if free && can_show.contains(&display) {
            return Ok(Some((index, plane.current_stack_index)));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_driver_names_a_connector_by_a_word_of_its_own() {
        for (name, part, is) in [
            ("DP-1", "DP-1", true),
            ("Seiko Epson EB-L200F (DP-1)", "DP-1", true),
            ("Seiko Epson EB-L200F (DP-1)", "EB-L200F", true),
            ("Seiko Epson EB-L200F (DP-1)", "Epson EB-L200F", true),
            ("eDP-1", "DP-1", false),
            ("DP-11", "DP-1", false),
            ("DP-1-2", "DP-1", false),
            ("eDP-1, DP-1", "DP-1", true),
            ("monitor", "DP-1", false),
            ("monitor", "", false),
            ("Écran-1 (DP-1)", "1", false),
        ] {
            assert_eq!(names(name, part), is, "{part:?} in {name:?}");
        }
    }

    #[test]
    fn a_mode_has_the_very_pixels_and_the_rate_asked_for() {
        let mode = |[width, height]: [u32; 2], refresh_rate| vk::DisplayModePropertiesKHR {
            parameters: vk::DisplayModeParametersKHR { visible_region: vk::Extent2D { width, height }, refresh_rate },
            ..Default::default()
        };
        let full = [1920, 1080];
        let modes = [mode([1280, 800], 120_000), mode(full, 59_940), mode(full, 120_000), mode(full, 50_000)];
        let chosen = |size_px, refresh_hz| {
            let desc = DisplayDesc { name: "left".into(), connector: None, edid: None, size_px, refresh_hz };
            choose(&modes, "DP-1", &desc).map(|mode| mode.parameters.refresh_rate)
        };
        for (refresh_hz, millihertz) in
            [(None, 120_000), (Some(60.0), 59_940), (Some(59.94), 59_940), (Some(50.4), 50_000), (Some(119.6), 120_000)]
        {
            assert_eq!(chosen(full, refresh_hz).unwrap(), millihertz, "{refresh_hz:?}");
        }
        let slower = chosen(full, Some(75.0)).unwrap_err().to_string();
        assert!(slower.contains("1920x1080 px at 75 Hz; hint: it has 59.94 Hz, 120.00 Hz, 50.00 Hz;"), "{slower}");
        let smaller = chosen([1920, 1200], None).unwrap_err().to_string();
        assert!(smaller.contains("1280x800 at 120.00 Hz") && smaller.contains("1920x1200"), "{smaller}");
    }
}
