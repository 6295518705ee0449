//! `[daemon]`, `[device]`, `[render]` and `[limits]`.

use super::path;
use crate::reader::{Table, Value};
use crate::types::{Daemon, Device, Limits, RasterOrder, RayTracing, Render};
use std::path::Path;

pub(crate) fn daemon(table: Table<'_>, base_dir: &Path) -> Daemon {
    table.note_places("daemon");
    let one = |key| table.get(key).and_then(|value| path(&value, base_dir));
    let daemon = Daemon {
        socket: one("socket"),
        group: table.get("group").and_then(|value| group(&value)),
        state_dir: one("state_dir"),
        asset_roots: table
            .get("asset_roots")
            .and_then(|value| value.array("folders"))
            .map(|items| items.iter().filter_map(|item| path(item, base_dir)).collect())
            .unwrap_or_default(),
    };
    table.finish();
    daemon
}

/// A group's name or number.
fn group(value: &Value<'_>) -> Option<String> {
    let group = value.string_or_index()?;
    if group.is_empty() || group.contains(['\0', ':', '\n']) || group.starts_with('-') {
        value.problem(format!("`{}` is no group", value.path), "name a group of this machine, or give its number");
        return None;
    }
    Some(group)
}

pub(crate) fn device(table: Table<'_>) -> Device {
    let ways = [("auto", RayTracing::Auto), ("bvh", RayTracing::Bvh), ("ray-query", RayTracing::RayQuery)];
    let device = Device {
        select: table.get("select").and_then(|value| value.string_or_index()),
        ray_tracing: table.get("ray_tracing").and_then(|value| value.choice(&ways)).unwrap_or_default(),
    };
    table.finish();
    device
}

pub(crate) fn render(table: Table<'_>) -> Render {
    let mut render = Render::default();
    if let Some(value) = table.get("samples")
        && let Some(samples) = value.integer_u32(1..=256)
    {
        render.samples = samples;
        if samples.isqrt().pow(2) != samples {
            let side = samples.isqrt();
            let hint = format!("samples form a square grid: take {} or {}", side * side, (side + 1) * (side + 1));
            value.problem(format!("`{}` is {samples}, which is no square number", value.path), hint);
        }
    }
    if let Some(depth) = table.get("max_depth").and_then(|value| value.integer_u32(0..=64)) {
        render.max_depth = depth;
    }
    let orders = [("after", RasterOrder::After), ("before", RasterOrder::Before)];
    if let Some(order) = table.get("raster").and_then(|value| value.choice(&orders)) {
        render.raster = order;
    }
    if let Some(blend) = table.get("blend").and_then(|value| value.boolean()) {
        render.blend = blend;
    }
    render.degrade = table.get("degrade").and_then(|value| value.boolean());
    if let Some(always_full) = table.get("always_full").and_then(|value| value.boolean()) {
        render.always_full = always_full;
    }
    table.finish();
    render
}

pub(crate) fn limits(table: Table<'_>) -> Limits {
    let mut limits = Limits::default();
    let small = |key, most: u32, limit: &mut u32| {
        if let Some(number) = table.get(key).and_then(|value| value.integer_u32(1..=most)) {
            *limit = number;
        }
    };
    small("max_clients", 4096, &mut limits.max_clients);
    small("max_requests_per_s", 1_000_000, &mut limits.max_requests_per_s);
    small("max_nodes", 1 << 24, &mut limits.max_nodes);
    small("max_lights", 32, &mut limits.max_lights);
    small("max_file_mib", 1 << 20, &mut limits.max_file_mib);
    let large = |key, limit: &mut u64| {
        if let Some(number) = table.get(key).and_then(|value| value.integer(1..=u64::from(u32::MAX))) {
            *limit = number;
        }
    };
    large("max_triangles", &mut limits.max_triangles);
    large("max_texels", &mut limits.max_texels);
    table.finish();
    limits
}
