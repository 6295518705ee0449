//! Vulkan as the programs open it.

use std::sync::Arc;

use anyhow::Context;
use lantern_config::OutputKind;
use lantern_gpu::{Device, Instance, RayTracing, Validation};

use super::setup;

/// Switches the validation layer on, for tests and for whoever hunts a driver's or our own fault.
const VALIDATION_VARIABLE: &str = "LANTERN_VALIDATION";

/// Opens Vulkan; with the validation layer where `LANTERN_VALIDATION=1`.
///
/// # Errors
/// No loader or no driver, with the package to install.
pub fn open_vulkan() -> anyhow::Result<Arc<Instance>> {
    Instance::new(validation()).context("cannot start Vulkan")
}

/// The same for a configuration, whose outputs may name a Wayland compositor where the environment names none.
///
/// # Errors
/// As [`open_vulkan`].
pub fn open_vulkan_for(config: &lantern_config::Config) -> anyhow::Result<Arc<Instance>> {
    let names_one = |projector: &lantern_config::Projector| match &projector.output.kind {
        OutputKind::Window { server, .. } => server.as_ref().is_some_and(|server| !server.contains(':')),
        OutputKind::Headless | OutputKind::Display { .. } | OutputKind::Export => false,
    };
    if config.projectors.iter().any(names_one) {
        return Instance::with(validation(), true).context("cannot start Vulkan");
    }
    open_vulkan()
}

fn validation() -> Validation {
    match std::env::var(VALIDATION_VARIABLE).as_deref() {
        Ok("1") => Validation::On,
        _ => Validation::Off,
    }
}

/// Queues that are opened where the device has them, though fewer projectors be there: a reload may bring more.
const MANY_QUEUES: usize = 16;

/// Opens the device that the configuration asks for, with a queue for each projector where it has so many.
///
/// # Errors
/// What Vulkan says.
pub fn open_device(instance: &Arc<Instance>, config: &lantern_config::Config) -> anyhow::Result<Arc<Device>> {
    let cache = setup::cache_dir();
    let select = config.device.select.as_deref();
    let queues = config.projectors.len().max(MANY_QUEUES) as u32;
    let (ray_tracing, what) = match config.device.ray_tracing {
        lantern_config::RayTracing::Auto => (RayTracing::Auto, "cannot open a Vulkan device"),
        lantern_config::RayTracing::Bvh => (RayTracing::Bvh, "cannot open a Vulkan device"),
        lantern_config::RayTracing::RayQuery => {
            (RayTracing::RayQuery, "cannot open a Vulkan device for `device.ray_tracing = \"ray-query\"`")
        }
    };
    Device::open_for(instance, select, queues, cache.as_deref(), ray_tracing).context(what)
}
