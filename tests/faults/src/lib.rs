//! A Vulkan layer that fails the calls that a test names, with the result that it names.
//!
//! It stands above the validation layer, between the daemon and all that it calls, and hooks every function of Vulkan 1.3's core
//! and of the extensions in [`CALLS`] that returns a result: a call that nobody wants failed goes on unchanged, and is counted. An
//! extension that is enabled and not in the table is told as a stranger, so that a test can see that no call is missed.
//!
//! What the loader answers itself cannot be failed here: `vkEnumerateInstanceVersion`, `vkEnumerateInstanceExtensionProperties`,
//! `vkEnumerateInstanceLayerProperties` and `vkEnumerateDeviceLayerProperties`.
//!
//! Two results last. After `VK_ERROR_DEVICE_LOST` the device does no more work, and every later call that waits for it or gives it
//! work says the same; after `VK_TIMEOUT` of `vkWaitSemaphores` no wait on that device ends any more, as on one that has hung.
//!
//! A test speaks to it over a socket ([`SOCKET_VARIABLE`]) while the daemon runs, and arms it for the start by [`ARM_VARIABLE`];
//! `wire.rs` has the words.
#![allow(
    unsafe_code,
    reason = "a Vulkan layer is called with raw pointers and calls with them; no other crate depends on it but tests"
)]

mod dispatch;
mod hook;
mod loader;
mod plan;
mod table;
mod wire;

pub use table::{CALLS, Call, SILENT_EXTENSIONS};
pub use wire::{ARM_VARIABLE, SOCKET_VARIABLE};

/// The layer's name, for its manifest and `VK_INSTANCE_LAYERS`.
pub const LAYER: &str = "VK_LAYER_LANTERN_faults";
