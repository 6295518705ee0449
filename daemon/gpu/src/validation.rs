//! Listening to the validation layer: every warning and error it has is logged and kept.

use std::borrow::Cow;
use std::ffi::{CStr, c_void};
use std::sync::{Mutex, PoisonError};

use ash::vk;

/// Messages beyond this many are logged, but no longer kept: memory stays bounded whatever a driver does.
const KEPT_MESSAGES: usize = 1024;

/// The warnings and errors said so far. Boxed, because the layer holds a pointer to it.
#[derive(Default)]
pub(crate) struct Messages(Mutex<Vec<String>>);

impl Messages {
    /// All that was said, oldest first.
    pub(crate) fn all(&self) -> Vec<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn push(&self, message: String) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if all.len() < KEPT_MESSAGES {
            all.push(message);
        }
    }
}

/// How to create a messenger that speaks to `messages`, which must outlive it.
pub(crate) fn messenger_info(messages: &Messages) -> vk::DebugUtilsMessengerCreateInfoEXT<'static> {
    vk::DebugUtilsMessengerCreateInfoEXT::default()
        .message_severity(vk::DebugUtilsMessageSeverityFlagsEXT::WARNING | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR)
        .message_type(
            vk::DebugUtilsMessageTypeFlagsEXT::GENERAL
                | vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION
                | vk::DebugUtilsMessageTypeFlagsEXT::PERFORMANCE,
        )
        .pfn_user_callback(Some(on_message))
        .user_data(std::ptr::from_ref(messages).cast_mut().cast())
}

/// What the layer calls. It must not panic and must not call Vulkan.
unsafe extern "system" fn on_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the layer passes a valid callback structure for the time of this call, and `user` is the pointer that
    // `messenger_info` was given, to a boxed `Messages` that the instance frees after the messenger.
    let (data, messages) = unsafe { (data.as_ref(), user.cast::<Messages>().as_ref()) };
    let (Some(data), Some(messages)) = (data, messages) else { return vk::FALSE };

    // SAFETY: both pointers are null or C strings that live for the time of this call (VkDebugUtilsMessenger-
    // CallbackDataEXT).
    let (id, text) = unsafe { (text_or_empty(data.p_message_id_name), text_or_empty(data.p_message)) };

    // What the loader says about drivers that it skips is no defect of ours.
    if kind == vk::DebugUtilsMessageTypeFlagsEXT::GENERAL {
        tracing::debug!(target: "vulkan::loader", "{text}");
    } else {
        tracing::error!(target: "vulkan::validation", "{id}: {text}");
        messages.push(format!("{id}: {text}"));
    }
    vk::FALSE
}

/// The text at a pointer that may be null.
///
/// # Safety
/// The pointer is null, or a C string that outlives `'a`.
unsafe fn text_or_empty<'a>(text: *const std::ffi::c_char) -> Cow<'a, str> {
    if text.is_null() {
        return Cow::Borrowed("");
    }
    // SAFETY: not null, and then a C string that outlives 'a, by this function's contract.
    unsafe { CStr::from_ptr(text) }.to_string_lossy()
}
