//! What can go wrong on the GPU, said with the object, the operation and the remedy.

use std::time::Duration;

use ash::vk;

/// Any failure of this crate. Messages name the object and the operation, and end with a hint where one helps.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// The machine has no Vulkan loader (`libvulkan.so.1`).
    #[error("no vulkan loader: {source}; hint: install libvulkan1 (apt install libvulkan1 mesa-vulkan-drivers)")]
    NoLoader {
        /// Why the library could not be loaded.
        source: ash::LoadingError,
    },
    /// There is a loader, but no driver that it can use.
    #[error(
        "no vulkan driver: {detail}; hint: install mesa-vulkan-drivers (apt install mesa-vulkan-drivers), \
         or the driver of your graphics card"
    )]
    NoDriver {
        /// What the loader said.
        detail: String,
    },
    /// The loader is older than Vulkan 1.3.
    #[error("the vulkan loader speaks {found}, and 1.3 is needed; hint: upgrade libvulkan1")]
    OldLoader {
        /// The version that the loader offers.
        found: String,
    },
    /// Validation was asked for, and its layer is not installed.
    #[error("no layer VK_LAYER_KHRONOS_validation; hint: install vulkan-validationlayers")]
    NoValidationLayer,
    /// No device fits the configuration's `device.select`.
    #[error("no vulkan device fits {select:?}; hint: there are {have}; see `lanternd devices`")]
    NoSuchDevice {
        /// What was asked for.
        select: String,
        /// The devices there are, by index and name.
        have: String,
    },
    /// The device lacks something without which nothing works.
    #[error("{device} lacks {missing}; hint: upgrade its driver, or choose another device")]
    Unsupported {
        /// The device, or the object on it.
        device: String,
        /// What is missing.
        missing: String,
    },
    /// The device was lost; everything on it must be built anew.
    #[error("{operation}: the device is lost")]
    DeviceLost {
        /// What was being done.
        operation: String,
    },
    /// What images were shown on has gone: a window was closed, a display unplugged.
    #[error("{object} has gone: nothing can be shown on it any more")]
    SurfaceLost {
        /// The window or display.
        object: String,
    },
    /// The device has no memory left for this object.
    #[error("{operation}: out of device memory; hint: a smaller scene or resolution, or fewer samples")]
    OutOfDeviceMemory {
        /// What was being done.
        operation: String,
    },
    /// The host has no memory left for this object.
    #[error("{operation}: out of host memory")]
    OutOfHostMemory {
        /// What was being done.
        operation: String,
    },
    /// The allocator failed in another way than by lack of memory.
    #[error("memory of {object}: {detail}")]
    Memory {
        /// The object that needs the memory.
        object: String,
        /// What the allocator said.
        detail: String,
    },
    /// Work on the device did not end in time; it goes on, and may be waited for again.
    #[error("{object} has not finished within {waited:?}")]
    Timeout {
        /// The name of the submission.
        object: String,
        /// How long it was waited for.
        waited: Duration,
    },
    /// An object would be larger than the device allows.
    #[error("{object}: {asked} {unit} asked, the device allows {limit}")]
    TooLarge {
        /// The object or the operation.
        object: String,
        /// How much was asked for.
        asked: u64,
        /// The device's limit.
        limit: u64,
        /// The unit of both: `bytes`, `elements`, `px`, …
        unit: &'static str,
    },
    /// A range does not lie inside an object.
    #[error("{object}: bytes {offset}..{offset}+{bytes} asked, it has {size}")]
    Range {
        /// The object.
        object: String,
        /// Where the range starts, in bytes.
        offset: u64,
        /// How long it is, in bytes.
        bytes: u64,
        /// The size of the object, in bytes.
        size: u64,
    },
    /// A call that does not fit the object: a wrong kind, size, usage, or alignment.
    #[error("{object}: {problem}")]
    Misuse {
        /// The object.
        object: String,
        /// What does not fit.
        problem: String,
    },
    /// Bindings do not fit the table of a pipeline.
    #[error("{pipeline}: binding {binding:?}: {problem}")]
    Binding {
        /// The pipeline, or its shader.
        pipeline: String,
        /// The name of the binding.
        binding: String,
        /// What does not fit.
        problem: String,
    },
    /// Push constants of another size than the shader declares.
    #[error("{pipeline}: {given} bytes of push constants given, its shaders declare {declared}")]
    PushConstants {
        /// The pipeline.
        pipeline: String,
        /// Bytes given.
        given: usize,
        /// Bytes declared.
        declared: u32,
    },
    /// Memory that the host maps is in use by submitted work.
    #[error("{object}: {operation} while the device uses it; hint: wait for the submission, or use a buffer per frame")]
    InFlight {
        /// The buffer.
        object: String,
        /// What the host wanted.
        operation: &'static str,
    },
    /// Commands were submitted before those that they build upon.
    #[error("{object} depends on commands that were not submitted; hint: submit in the order of recording")]
    Order {
        /// The commands.
        object: String,
    },
    /// Two objects of different devices met in one call.
    #[error("{object} belongs to another device")]
    OtherDevice {
        /// The object that is foreign here.
        object: String,
    },
    /// Something was read that nothing has ever written.
    #[error("{object} is read, and nothing has written it yet")]
    Unwritten {
        /// The image, or the acceleration structure.
        object: String,
    },
    /// Any other answer of the driver.
    #[error("{operation}: vulkan answers {result:?}")]
    Vulkan {
        /// What was being done, with the name of the object.
        operation: String,
        /// The driver's answer.
        result: vk::Result,
    },
}

impl GpuError {
    /// Sorts a driver's answer to `operation` into the variants that a caller can act upon.
    pub(crate) fn vulkan(operation: impl Into<String>, result: vk::Result) -> GpuError {
        let operation = operation.into();
        match result {
            vk::Result::ERROR_DEVICE_LOST => GpuError::DeviceLost { operation },
            vk::Result::ERROR_OUT_OF_DEVICE_MEMORY => GpuError::OutOfDeviceMemory { operation },
            vk::Result::ERROR_OUT_OF_HOST_MEMORY => GpuError::OutOfHostMemory { operation },
            result => GpuError::Vulkan { operation, result },
        }
    }

    /// A [`GpuError::Misuse`] of `object`.
    pub(crate) fn misuse(object: impl Into<String>, problem: impl Into<String>) -> GpuError {
        GpuError::Misuse { object: object.into(), problem: problem.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_loader_names_the_package_to_install() {
        // SAFETY: nothing is loaded: the path does not exist.
        let source = unsafe { ash::Entry::load_from("/nonexistent/libvulkan.so.1") }.err().unwrap();
        let message = GpuError::NoLoader { source }.to_string();
        assert!(message.contains("hint: install libvulkan1"), "{message}");
    }

    #[test]
    fn a_missing_driver_names_the_package_to_install() {
        let message = GpuError::NoDriver { detail: "no device".into() }.to_string();
        assert!(message.contains("hint: install mesa-vulkan-drivers"), "{message}");
    }

    #[test]
    fn what_a_caller_can_act_upon_is_told_apart() {
        let of = |result| GpuError::vulkan("x", result);
        assert!(matches!(of(vk::Result::ERROR_DEVICE_LOST), GpuError::DeviceLost { .. }));
        assert!(matches!(of(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY), GpuError::OutOfDeviceMemory { .. }));
        assert!(matches!(of(vk::Result::ERROR_OUT_OF_HOST_MEMORY), GpuError::OutOfHostMemory { .. }));
        assert!(matches!(of(vk::Result::ERROR_UNKNOWN), GpuError::Vulkan { .. }));
    }
}
