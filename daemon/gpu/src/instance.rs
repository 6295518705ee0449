//! The Vulkan instance: loader, layers, and the list of devices.

use std::ffi::CStr;
use std::sync::Arc;

use ash::{ext, khr, vk};

use crate::error::GpuError;
use crate::validation::{Messages, messenger_info};

/// The layer that checks every call.
const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Whether the validation layer watches all calls.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Validation {
    /// No layer: the daemon at work.
    Off,
    /// The Khronos validation layer with its synchronisation checks: every test.
    On,
}

/// The loaded Vulkan library and an instance of it.
pub struct Instance {
    raw: ash::Instance,
    entry: ash::Entry,
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    /// Boxed for its address: the messenger points to it until it is destroyed.
    messages: Box<Messages>,
    extensions: Vec<&'static CStr>,
    /// Of those that are of use: all that there are.
    offered: Vec<&'static CStr>,
}

impl std::fmt::Debug for Instance {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Instance").field("extensions", &self.extensions).finish_non_exhaustive()
    }
}

impl Instance {
    /// Loads Vulkan at run time and creates an instance.
    ///
    /// # Errors
    /// [`GpuError::NoLoader`], [`GpuError::OldLoader`], [`GpuError::NoDriver`] (a loader without a usable device) and
    /// [`GpuError::NoValidationLayer`] name what to install.
    pub fn new(validation: Validation) -> Result<Arc<Instance>, GpuError> {
        // A layer of Mesa's connects to the compositor wherever its windows are switched on, and complains on the standard error
        // where the environment has none.
        Instance::with(validation, std::env::var_os("XDG_RUNTIME_DIR").is_some())
    }

    /// The same, able to show windows of a Wayland compositor or not.
    ///
    /// # Errors
    /// As [`Instance::new`].
    pub fn with(validation: Validation, wayland: bool) -> Result<Arc<Instance>, GpuError> {
        // SAFETY: the library found by its usual name is the system's Vulkan loader, whose initialisers are sound.
        let entry = unsafe { ash::Entry::load() }.map_err(|source| GpuError::NoLoader { source })?;
        require_vulkan_1_3(&entry)?;

        // Take the optional extensions that are there: names and messages, and what images are shown on.
        let validate = validation == Validation::On;
        let layer = if validate { Some(validation_layer(&entry)?) } else { None };
        let mut extensions = wanted_extensions(&entry, layer)?;
        let offered = extensions.clone();
        extensions.retain(|name| wayland || *name != khr::wayland_surface::NAME);
        let has_messages = extensions.contains(&ext::debug_utils::NAME);

        let messages = Box::new(Messages::default());
        let raw = create_raw(&entry, layer, &extensions, has_messages.then_some(&*messages))?;
        let mut instance = Instance { raw, entry, messenger: None, messages, extensions, offered };
        if validate && has_messages {
            let loader = ext::debug_utils::Instance::new(&instance.entry, &instance.raw);
            let info = messenger_info(&instance.messages);
            // SAFETY: the extension is enabled; the messages are boxed and freed after the messenger (see Drop).
            let messenger = unsafe { loader.create_debug_utils_messenger(&info, None) }
                .map_err(|result| GpuError::vulkan("creating the debug messenger", result))?;
            instance.messenger = Some((loader, messenger));
        }

        if instance.physical_devices()?.is_empty() {
            return Err(GpuError::NoDriver { detail: "the loader lists no device".into() });
        }
        Ok(Arc::new(instance))
    }

    /// Whether the validation layer listens.
    pub fn is_validating(&self) -> bool {
        self.messenger.is_some()
    }

    /// Every warning and error that the validation layer has said, each with its id; also logged as an error, with
    /// target `vulkan::validation`. A test ends by asserting that this is empty.
    pub fn validation_messages(&self) -> Vec<String> {
        self.messages.all()
    }

    pub(crate) fn physical_devices(&self) -> Result<Vec<vk::PhysicalDevice>, GpuError> {
        // SAFETY: the instance lives.
        match unsafe { self.raw.enumerate_physical_devices() } {
            Ok(devices) => Ok(devices),
            Err(vk::Result::ERROR_INITIALIZATION_FAILED | vk::Result::ERROR_INCOMPATIBLE_DRIVER) => {
                Err(GpuError::NoDriver { detail: "no driver could be initialised".into() })
            }
            Err(result) => Err(GpuError::vulkan("listing the devices", result)),
        }
    }

    pub(crate) fn raw(&self) -> &ash::Instance {
        &self.raw
    }

    pub(crate) fn entry(&self) -> &ash::Entry {
        &self.entry
    }

    /// Whether an instance extension is enabled.
    pub(crate) fn has(&self, extension: &CStr) -> bool {
        self.extensions.contains(&extension)
    }

    /// Whether an extension is there, enabled or not.
    pub(crate) fn offers(&self, extension: &CStr) -> bool {
        self.offered.contains(&extension)
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: devices hold the instance by Arc, so none is left; the messenger goes first, its messages last.
        unsafe {
            if let Some((loader, messenger)) = self.messenger.take() {
                loader.destroy_debug_utils_messenger(messenger, None);
            }
            self.raw.destroy_instance(None);
        }
    }
}

fn require_vulkan_1_3(entry: &ash::Entry) -> Result<(), GpuError> {
    // SAFETY: a global command without preconditions.
    let version = unsafe { entry.try_enumerate_instance_version() }
        .map_err(|result| GpuError::vulkan("asking for the loader's version", result))?
        .unwrap_or(vk::API_VERSION_1_0);
    if version < vk::API_VERSION_1_3 {
        return Err(GpuError::OldLoader { found: version_text(version) });
    }
    Ok(())
}

fn validation_layer(entry: &ash::Entry) -> Result<&'static CStr, GpuError> {
    // SAFETY: a global command without preconditions.
    let layers = unsafe { entry.enumerate_instance_layer_properties() }
        .map_err(|result| GpuError::vulkan("listing the layers", result))?;
    let there = layers.iter().any(|layer| layer.layer_name_as_c_str() == Ok(VALIDATION_LAYER));
    if there { Ok(VALIDATION_LAYER) } else { Err(GpuError::NoValidationLayer) }
}

fn wanted_extensions(entry: &ash::Entry, layer: Option<&CStr>) -> Result<Vec<&'static CStr>, GpuError> {
    // A layer's own extensions are listed apart from the loader's and drivers'.
    let mut there = Vec::new();
    for from in [None, layer] {
        // SAFETY: a global command; the layer, where named, exists.
        let listed = unsafe { entry.enumerate_instance_extension_properties(from) }
            .map_err(|result| GpuError::vulkan("listing the instance extensions", result))?;
        there.extend(listed);
    }

    let mut wanted = vec![
        ext::debug_utils::NAME,
        khr::surface::NAME,
        khr::get_surface_capabilities2::NAME,
        khr::xcb_surface::NAME,
        khr::wayland_surface::NAME,
        khr::display::NAME,
        ext::headless_surface::NAME,
        ext::direct_mode_display::NAME,
        ext::acquire_drm_display::NAME,
        ext::swapchain_colorspace::NAME,
    ];
    if layer.is_some() {
        wanted.push(ext::validation_features::NAME);
    }
    wanted.retain(|name| there.iter().any(|extension| extension.extension_name_as_c_str() == Ok(*name)));
    Ok(wanted)
}

fn create_raw(
    entry: &ash::Entry,
    layer: Option<&CStr>,
    extensions: &[&'static CStr],
    messages: Option<&Messages>,
) -> Result<ash::Instance, GpuError> {
    let application = vk::ApplicationInfo::default().application_name(c"lantern").api_version(vk::API_VERSION_1_3);
    let layer_names: Vec<_> = layer.iter().map(|name| name.as_ptr()).collect();
    let extension_names: Vec<_> = extensions.iter().map(|name| name.as_ptr()).collect();
    let mut info = vk::InstanceCreateInfo::default()
        .application_info(&application)
        .enabled_layer_names(&layer_names)
        .enabled_extension_names(&extension_names);

    // With the layer, its synchronisation checks, and ears for the creation itself.
    let checks = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
    let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&checks);
    let mut messenger = messages.map(messenger_info);
    if layer.is_some() {
        info = info.push_next(&mut features);
        if let Some(messenger) = &mut messenger {
            info = info.push_next(messenger);
        }
    }

    // SAFETY: layer and extensions were listed above, and all that `info` points to lives until the call returns.
    unsafe { entry.create_instance(&info, None) }.map_err(|result| match result {
        vk::Result::ERROR_INCOMPATIBLE_DRIVER => {
            GpuError::NoDriver { detail: "the loader finds no compatible driver".into() }
        }
        vk::Result::ERROR_LAYER_NOT_PRESENT => GpuError::NoValidationLayer,
        result => GpuError::vulkan("creating the vulkan instance", result),
    })
}

/// A packed Vulkan version, as people write it.
pub(crate) fn version_text(version: u32) -> String {
    let (major, minor, patch) =
        (vk::api_version_major(version), vk::api_version_minor(version), vk::api_version_patch(version));
    format!("{major}.{minor}.{patch}")
}
