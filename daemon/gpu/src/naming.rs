//! Names for the validation layer, debuggers and profilers (`VK_EXT_debug_utils`).

use std::ffi::CString;

use ash::{ext, vk};

/// The debug functions of a device, where the extension is there; else naming does nothing.
pub(crate) struct Naming(pub(crate) Option<ext::debug_utils::Device>);

impl Naming {
    /// Gives an object its name.
    ///
    /// # Safety
    /// `handle` is a live object of this device that no other thread has yet.
    pub(crate) unsafe fn name<H: vk::Handle>(&self, handle: H, name: &str) {
        let Some(debug) = &self.0 else { return };
        let name = c_name(name);
        let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(handle).object_name(&name);
        // SAFETY: by this function's contract. A name that could not be set is no reason to fail.
        let _ = unsafe { debug.set_debug_utils_object_name(&info) };
    }

    /// Opens a labelled region in a command buffer.
    ///
    /// # Safety
    /// The command buffer belongs to this device and is being recorded by this thread.
    pub(crate) unsafe fn begin(&self, commands: vk::CommandBuffer, label: &str) {
        let Some(debug) = &self.0 else { return };
        let label = c_name(label);
        // SAFETY: by this function's contract; the label outlives the call.
        unsafe {
            debug.cmd_begin_debug_utils_label(commands, &vk::DebugUtilsLabelEXT::default().label_name(&label));
        }
    }

    /// Closes the region that was opened last.
    ///
    /// # Safety
    /// As [`Naming::begin`], and a region is open in this command buffer.
    pub(crate) unsafe fn end(&self, commands: vk::CommandBuffer) {
        let Some(debug) = &self.0 else { return };
        // SAFETY: by this function's contract.
        unsafe { debug.cmd_end_debug_utils_label(commands) };
    }
}

/// A name as C wants it; a zero byte inside would end it, so it goes.
fn c_name(name: &str) -> CString {
    let bytes: Vec<u8> = name.bytes().filter(|&byte| byte != 0).collect();
    CString::new(bytes).unwrap_or_default()
}

/// A fixed entry point, as the pipelines want it.
pub(crate) const ENTRY_POINT: &std::ffi::CStr = c"main";

#[cfg(test)]
mod tests {
    #[test]
    fn a_name_with_a_zero_byte_loses_it_alone() {
        assert_eq!(super::c_name("a\0b").as_c_str(), c"ab");
    }
}
