//! What is below the layer: for each instance and device, the functions to call on.

use std::collections::HashMap;
use std::ffi::{CStr, CString};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ash::vk::{self, Handle};

use crate::plan::Plan;

/// A function below, of whatever type.
pub(crate) type Function = unsafe extern "system" fn();

static PLAN: Mutex<Plan> = Mutex::new(Plan::new());
static BELOW: Mutex<Option<HashMap<usize, Arc<Below>>>> = Mutex::new(None);

/// What is to fail, and what was called.
pub(crate) fn plan() -> MutexGuard<'static, Plan> {
    PLAN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A handle that the loader dispatches by: it points to an object that begins with the loader's table, which all handles of one
/// instance have in common, and all of one device.
pub(crate) trait Dispatched: Copy {
    /// The handle as a number.
    fn raw(self) -> u64;

    /// Says which instance or device it belongs to.
    ///
    /// # Safety
    /// A live handle that came from the loader.
    unsafe fn key(self) -> usize {
        // SAFETY: dispatchable handles are pointers to objects whose first word is the loader's (its layer interface).
        unsafe { *(self.raw() as usize as *const usize) }
    }
}

macro_rules! dispatched {
    ($($handle:ty),+) => { $(impl Dispatched for $handle {
        fn raw(self) -> u64 {
            self.as_raw()
        }
    })+ };
}
dispatched!(vk::Instance, vk::PhysicalDevice, vk::Device, vk::Queue, vk::CommandBuffer);

/// An instance's or a device's functions below the layer.
pub(crate) struct Below {
    /// By the call's place in the table.
    functions: Vec<Option<Function>>,
    /// The instance or the device itself.
    pub(crate) handle: u64,
    /// How the rest is found; the handle goes before the name.
    pub(crate) find: vk::PFN_vkGetInstanceProcAddr,
    /// Of a device.
    rest: Option<(vk::Device, vk::PFN_vkDeviceWaitIdle)>,
    lost: AtomicBool,
    hung: AtomicBool,
}

impl Below {
    /// Those that `find` finds for a handle, of these names.
    ///
    /// # Safety
    /// `find` is the next layer's `vkGetInstanceProcAddr` for an instance or `vkGetDeviceProcAddr` for a device (the two differ
    /// in the type of their first argument alone), and `handle` a live handle of that kind.
    pub(crate) unsafe fn new(
        handle: u64,
        find: vk::PFN_vkGetInstanceProcAddr,
        device: Option<vk::Device>,
        names: impl Iterator<Item = CString>,
    ) -> Self {
        let named = |name: &CStr| {
            // SAFETY: by this function's contract, and the name is a C string.
            unsafe { find(vk::Instance::from_raw(handle), name.as_ptr()) }
        };
        let functions = names.map(|name| named(&name)).collect();
        let idle = device.and_then(|device| Some((device, named(c"vkDeviceWaitIdle")?)));
        let rest = idle.map(|(device, idle)| {
            // SAFETY: the function of this name has this type.
            (device, unsafe { std::mem::transmute::<Function, vk::PFN_vkDeviceWaitIdle>(idle) })
        });
        Below { functions, handle, find, rest, lost: AtomicBool::new(false), hung: AtomicBool::new(false) }
    }

    /// The function of a call, where there is one below.
    pub(crate) fn function(&self, call: usize) -> Option<Function> {
        self.functions.get(call).copied().flatten()
    }

    /// Loses the device: it does no more work from now on, and says so.
    pub(crate) fn lose(&self) {
        if let Some((device, wait_idle)) = self.rest.filter(|_| !self.lost.swap(true, Ordering::AcqRel)) {
            // SAFETY: the device lives, since it was just called with; the daemon talks to it from one thread alone. What it
            // answers does not matter: either way it rests.
            let _ = unsafe { wait_idle(device) };
        }
    }

    pub(crate) fn is_lost(&self) -> bool {
        self.lost.load(Ordering::Acquire)
    }

    /// Hangs the device: no wait for it ends from now on.
    pub(crate) fn hang(&self) {
        self.hung.store(true, Ordering::Release);
    }

    pub(crate) fn is_hung(&self) -> bool {
        self.hung.load(Ordering::Acquire)
    }
}

/// Remembers what is below an instance or a device. Those that are gone are replaced when their place is used again.
pub(crate) fn remember(key: usize, below: Below) {
    let mut all = BELOW.lock().unwrap_or_else(PoisonError::into_inner);
    all.get_or_insert_default().insert(key, Arc::new(below));
}

/// What is below.
pub(crate) fn below(key: usize) -> Option<Arc<Below>> {
    BELOW.lock().unwrap_or_else(PoisonError::into_inner).as_ref()?.get(&key).cloned()
}
