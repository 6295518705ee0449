//! The only unsafe code: Vulkan objects as safe, named, reference-counted values.
//!
//! A caller cannot break memory safety through this crate: sizes, alignments, bindings, push constants, extents and
//! lifetimes are checked here and answered with [`GpuError`]. Three ideas carry that:
//!
//! - **Ownership.** Each object is `{ raw, device, name }` behind an [`Arc`](std::sync::Arc) with a `Drop`. What a
//!   command buffer uses, it owns until the device has completed it ([`Submission`]); dropping everything else early
//!   is always allowed.
//! - **Hazards.** A recorded operation declares what it accesses; each buffer and image remembers its last uses, and
//!   the [`Recorder`] emits the barriers, whose masks come from one table (`access.rs`). Uses on other queues become
//!   semaphore waits when the commands are submitted.
//! - **Order.** Resources are tracked in the order of recording, and commands that depend on others must be submitted
//!   after them; [`Device::submit`] refuses any other order.
//!
//! What stays trusted is the SPIR-V itself: a [`Shader`] is a static table that a build script reflects from it.
//! Robust buffer access is on wherever the device has it, so an index out of bounds in a shader stays harmless.
#![allow(unsafe_code, reason = "this is the one crate that talks to Vulkan; everything above it denies unsafe code")]

mod access;
mod barrier;
mod binding;
mod budget;
mod buffer;
mod cache;
mod card;
mod chain;
mod command;
mod connectors;
mod device;
mod display;
mod encoder;
mod error;
mod export;
mod external;
mod families;
mod features;
mod format;
mod handle;
mod history;
mod image;
mod info;
mod instance;
mod layout;
mod lease;
mod memory;
mod naming;
mod optional;
mod patience;
mod pipeline;
mod queue;
mod ray_query;
mod release;
mod sampler;
mod select;
mod shader;
mod shared_timeline;
mod structure;
mod submission;
mod submit;
mod surface;
mod swapchain;
mod ticket;
mod timestamp;
mod validation;
mod window;

pub use binding::{Bindings, Resource};
pub use budget::MemoryBudget;
pub use buffer::{Buffer, BufferKind, TexelFormat};
pub use command::{Commands, CopyRegion, Draws, Load, Recorder};
pub use connectors::{Connector, Identity};
pub use device::{Device, Work};
pub use display::{DisplayDesc, DisplayError, OpenedDisplay};
pub use error::GpuError;
pub use export::{Exported, HandleKind};
pub use format::ImageFormat;
pub use handle::Limits;
pub use image::{Image, ImageUsage};
pub use info::{DeviceInfo, Display, DisplayMode, MemoryHeap, QueueFamily};
pub use instance::{Instance, Validation};
pub use layout::HasLayout;
pub use pipeline::{ComputePipeline, DepthTest, GraphicsDesc, GraphicsPipeline};
pub use queue::Queue;
pub use ray_query::RayTracing;
pub use shader::{Binding, BindingKind, Shader, Stage};
pub use shared_timeline::SharedTimeline;
pub use structure::{BottomLevel, Placed, TopLevel};
pub use submission::Submission;
pub use surface::{Pixels, Surface};
pub use swapchain::{Shown, Swapchain, SwapchainDesc};
pub use window::{Placement, Window, WindowDesc, WindowError};
