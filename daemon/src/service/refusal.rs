//! The frame thread's no.

use lantern_gpu::{Device, GpuError};
use lantern_proto::ErrorBody;
use lantern_render::{RenderError, bytes_beyond};
use lantern_scene::Scene;

/// What a client can do about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Why {
    /// There is too little memory.
    Memory,
    /// The device was lost meanwhile; it is opened again.
    Lost,
    /// Nothing, without looking at the log.
    Other,
}

/// Why the frame thread did not do what was asked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct Refusal {
    why: Why,
    message: String,
}

impl Refusal {
    /// For a reason of its own.
    pub fn new(message: impl Into<String>) -> Self {
        Self { why: Why::Other, message: message.into() }
    }

    /// Of a scene that is not shown, with what it would cost beyond the one that is.
    pub fn of_scene(error: &RenderError, shown: &Scene, refused: &Scene, device: &Device) -> Self {
        let Self { why, message } = Self::from(error);
        if why != Why::Memory {
            return Self { why, message };
        }
        let mib = |bytes: u64| format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20));
        let (needs, there) = (bytes_beyond(shown, refused), device.memory_budget());
        let [needs, free, all] = [needs, there.free_bytes, there.bytes].map(mib);
        let message = format!(
            "this adds {needs} of meshes and images, and the device has {free} free of {all}, some of which moving what is there \
             takes: {message}"
        );
        Self { why, message }
    }
}

impl From<&RenderError> for Refusal {
    fn from(error: &RenderError) -> Self {
        let message = error.to_string();
        match error {
            RenderError::Gpu(GpuError::OutOfDeviceMemory { .. } | GpuError::OutOfHostMemory { .. }) => {
                Self { why: Why::Memory, message }
            }
            error if is_loss(error) => {
                let hint = "hint: it is opened again, and what was shown is; then ask again";
                Self { why: Why::Lost, message: format!("{message}; {hint}") }
            }
            _ => Self { why: Why::Other, message },
        }
    }
}

impl From<Refusal> for ErrorBody {
    fn from(Refusal { why, message }: Refusal) -> Self {
        match why {
            Why::Memory => ErrorBody::new("out-of-memory", message),
            Why::Lost => ErrorBody::new("device-lost", message),
            Why::Other => ErrorBody::new("render-failed", message),
        }
    }
}

/// Whether nothing can be shown any more, whatever the scene, before the device is opened anew. One that has hung is as good as lost.
pub fn is_loss(error: &RenderError) -> bool {
    matches!(error, RenderError::Gpu(GpuError::DeviceLost { .. } | GpuError::Timeout { .. }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn codes_say_what_a_client_can_do() {
        let code = |error: GpuError| ErrorBody::from(Refusal::from(&RenderError::Gpu(error))).code;
        let operation = || "submitting \"left\"".to_owned();
        assert_eq!(code(GpuError::OutOfDeviceMemory { operation: operation() }), "out-of-memory");
        assert_eq!(code(GpuError::OutOfHostMemory { operation: operation() }), "out-of-memory");
        assert_eq!(code(GpuError::DeviceLost { operation: operation() }), "device-lost");
        assert_eq!(code(GpuError::Timeout { object: operation(), waited: Duration::from_secs(1) }), "device-lost");
        assert_eq!(code(GpuError::Order { object: operation() }), "render-failed");
        assert_eq!(ErrorBody::from(Refusal::new("no")).code, "render-failed");
    }
}
