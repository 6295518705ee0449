//! The loader's side: how it finds the layer's functions, and how instances and devices are made through the layer (`vk_layer.h`).

use std::ffi::{CStr, CString, c_char, c_void};

use ash::vk::{self, Handle};

use crate::dispatch::{Below, Dispatched, Function, below, plan, remember};
use crate::table::{CALLS, SILENT_EXTENSIONS};
use crate::wire;

/// `VkNegotiateLayerInterface`.
#[repr(C)]
pub(crate) struct Negotiation {
    kind: i32,
    next: *mut c_void,
    version: u32,
    instance_proc_addr: vk::PFN_vkGetInstanceProcAddr,
    device_proc_addr: vk::PFN_vkGetDeviceProcAddr,
    physical_device_proc_addr: Option<Function>,
}

/// `VkLayerInstanceCreateInfo` and `VkLayerDeviceCreateInfo`, where `function` says that a link is in it.
#[repr(C)]
struct LayerCreateInfo {
    kind: vk::StructureType,
    next: *const c_void,
    function: i32,
    link: *mut Link,
}

/// `VkLayerInstanceLink` and `VkLayerDeviceLink`, which begin alike: of the next layer down.
#[repr(C)]
struct Link {
    next: *mut Link,
    instance_proc_addr: vk::PFN_vkGetInstanceProcAddr,
    /// An instance's is another function, and not for us.
    device_proc_addr: Option<vk::PFN_vkGetDeviceProcAddr>,
}

/// `VK_LAYER_LINK_INFO`.
const LINK_INFO: i32 = 0;

/// The first call of the loader: which version of the layers' interface is spoken, and where the rest is found.
///
/// # Safety
/// Called by the loader, with a structure to fill in.
#[unsafe(export_name = "vkNegotiateLoaderLayerInterfaceVersion")]
pub(crate) unsafe extern "system" fn negotiate(negotiation: *mut Negotiation) -> vk::Result {
    // SAFETY: by this function's contract.
    let Some(negotiation) = (unsafe { negotiation.as_mut() }) else { return vk::Result::ERROR_INITIALIZATION_FAILED };
    negotiation.version = negotiation.version.min(2);
    negotiation.instance_proc_addr = instance_proc_addr;
    negotiation.device_proc_addr = device_proc_addr;
    negotiation.physical_device_proc_addr = None;
    wire::start();
    vk::Result::SUCCESS
}

/// The calls that are hooked.
fn names() -> impl Iterator<Item = CString> {
    CALLS.iter().map(|call| call.c_name())
}

/// What of the layer stands for a name.
fn own(name: &CStr) -> Option<Function> {
    let name = name.to_str().ok()?;
    // SAFETY: whoever asks for a function by its name casts it back to its own type before it calls it.
    unsafe {
        match name {
            "vkGetInstanceProcAddr" => {
                Some(std::mem::transmute::<vk::PFN_vkGetInstanceProcAddr, Function>(instance_proc_addr))
            }
            "vkGetDeviceProcAddr" => {
                Some(std::mem::transmute::<vk::PFN_vkGetDeviceProcAddr, Function>(device_proc_addr))
            }
            "vkCreateInstance" => Some(std::mem::transmute::<vk::PFN_vkCreateInstance, Function>(create_instance)),
            "vkCreateDevice" => Some(std::mem::transmute::<vk::PFN_vkCreateDevice, Function>(create_device)),
            name => CALLS.iter().find(|call| call.name() == name).map(|call| call.hook()),
        }
    }
}

unsafe extern "system" fn instance_proc_addr(instance: vk::Instance, name: *const c_char) -> vk::PFN_vkVoidFunction {
    // SAFETY: the loader asks with a C string, and with a live instance or none.
    unsafe {
        let name = CStr::from_ptr(name);
        // The loader asks the topmost layer with an instance that is still in the making.
        if instance == vk::Instance::null() || name == c"vkCreateInstance" {
            return own(name);
        }
        let there = (below(instance.key())?.find)(instance, name.as_ptr())?;
        Some(own(name).unwrap_or(there))
    }
}

unsafe extern "system" fn device_proc_addr(device: vk::Device, name: *const c_char) -> vk::PFN_vkVoidFunction {
    // SAFETY: the loader asks with a C string and a live device; what is kept of a device is its own function of this type.
    unsafe {
        let name = CStr::from_ptr(name);
        let there = (below(device.key())?.find)(vk::Instance::from_raw(device.as_raw()), name.as_ptr())?;
        Some(own(name).unwrap_or(there))
    }
}

/// Takes this layer's link off a chain of creation.
///
/// # Safety
/// `next` is the loader's chain of a creation; `kind` is the type of its own structures in it.
unsafe fn take_link(mut next: *const c_void, kind: vk::StructureType) -> Option<Link> {
    // SAFETY: a chain is of structures that begin with a type and a pointer to the next one; those of the loader's type are the
    // loader's, and a layer moves the link on (its layer interface).
    unsafe {
        while !next.is_null() {
            let found = next.cast_mut().cast::<LayerCreateInfo>();
            if (*found).kind == kind && (*found).function == LINK_INFO {
                let link = (*found).link.read();
                (*found).link = link.next;
                return Some(link);
            }
            next = (*found).next;
        }
    }
    None
}

/// Notes the extensions that are enabled and have calls which nobody hooks.
///
/// # Safety
/// `names` are `count` C strings.
unsafe fn look_at_extensions(names: *const *const c_char, count: u32) {
    for i in 0..count as usize {
        // SAFETY: by this function's contract.
        let name = unsafe { CStr::from_ptr(*names.add(i)) }.to_string_lossy();
        let known = CALLS.iter().any(|call| call.extension == name) || SILENT_EXTENSIONS.contains(&name.as_ref());
        if !known {
            plan().stranger(&name);
        }
    }
}

unsafe extern "system" fn create_instance(
    info: *const vk::InstanceCreateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    instance: *mut vk::Instance,
) -> vk::Result {
    if let Some(result) = plan().call("vkCreateInstance") {
        return result;
    }
    // SAFETY: the loader calls with valid structures, to whose chain it has added its own.
    unsafe {
        look_at_extensions((*info).pp_enabled_extension_names, (*info).enabled_extension_count);
        let Some(link) = take_link((*info).p_next, vk::StructureType::LOADER_INSTANCE_CREATE_INFO) else {
            return vk::Result::ERROR_INITIALIZATION_FAILED;
        };
        let Some(create) = (link.instance_proc_addr)(vk::Instance::null(), c"vkCreateInstance".as_ptr()) else {
            return vk::Result::ERROR_INITIALIZATION_FAILED;
        };
        let create: vk::PFN_vkCreateInstance = std::mem::transmute(create);
        let result = create(info, allocator, instance);
        if result == vk::Result::SUCCESS {
            let made = *instance;
            remember(made.key(), Below::new(made.as_raw(), link.instance_proc_addr, None, names()));
        }
        result
    }
}

unsafe extern "system" fn create_device(
    physical: vk::PhysicalDevice,
    info: *const vk::DeviceCreateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    device: *mut vk::Device,
) -> vk::Result {
    if let Some(result) = plan().call("vkCreateDevice") {
        return result;
    }
    // SAFETY: the loader calls with valid structures, to whose chain it has added its own; `vkGetDeviceProcAddr` differs from
    // `vkGetInstanceProcAddr` only in which kind of handle its first argument is, and is given a device's.
    unsafe {
        look_at_extensions((*info).pp_enabled_extension_names, (*info).enabled_extension_count);
        let Some(link) = take_link((*info).p_next, vk::StructureType::LOADER_DEVICE_CREATE_INFO) else {
            return vk::Result::ERROR_INITIALIZATION_FAILED;
        };
        let instance = below(physical.key()).map(|below| vk::Instance::from_raw(below.handle)).unwrap_or_default();
        let create = (link.instance_proc_addr)(instance, c"vkCreateDevice".as_ptr());
        let (Some(create), Some(find)) = (create, link.device_proc_addr) else {
            return vk::Result::ERROR_INITIALIZATION_FAILED;
        };
        let create: vk::PFN_vkCreateDevice = std::mem::transmute(create);
        let result = create(physical, info, allocator, device);
        if result == vk::Result::SUCCESS {
            let made = *device;
            let find: vk::PFN_vkGetInstanceProcAddr = std::mem::transmute(find);
            remember(made.key(), Below::new(made.as_raw(), find, Some(made), names()));
        }
        result
    }
}
