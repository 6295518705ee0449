//! `lanternd devices`: Vulkan devices, drivers, queues, displays, and what each can do.

use comfy_table::{ContentArrangement, Table, presets};
use lantern_gpu::{Connector, DeviceInfo};
use lantern_render::Loads;
use serde_json::{Value, json};

use crate::service::vulkan::open_vulkan;

/// Columns of the table.
const WIDTH: u16 = 110;

/// Prints them.
///
/// # Errors
/// No loader or no driver, with the package to install.
pub fn devices(as_json: bool) -> anyhow::Result<()> {
    let devices = open_vulkan()?.devices()?;
    let connectors = Connector::all();
    if as_json {
        let all: Vec<Value> = devices.iter().map(to_json).collect();
        let connectors: Vec<Value> = connectors.iter().map(connector_to_json).collect();
        say!("{}", serde_json::to_string_pretty(&json!({ "devices": all, "connectors": connectors }))?);
    } else {
        for device in &devices {
            say!("{}", to_text(device));
        }
        for connector in &connectors {
            say!("{}", connector_to_text(connector));
        }
    }
    Ok(())
}

fn connector_to_json(of: &Connector) -> Value {
    let identity = of.identity.as_ref();
    json!({
        "card": of.card, "name": of.name, "connected": of.connected,
        "edid": identity.map(|identity| &identity.id), "screen": identity.and_then(|identity| identity.name.as_ref()),
    })
}

fn connector_to_text(of: &Connector) -> String {
    let what = match (&of.identity, of.connected) {
        (Some(identity), true) => {
            format!("{}, {}", identity.id, identity.name.as_deref().unwrap_or("which has no name"))
        }
        (None, true) => "something that does not say who it is".to_owned(),
        (_, false) => "nothing".to_owned(),
    };
    format!("connector {} of {}: {what}", of.name, of.card)
}

fn to_json(device: &DeviceInfo) -> Value {
    let families: Vec<Value> =
        device.queue_families.iter().map(|f| json!({ "index": f.index, "flags": f.flags, "count": f.count })).collect();
    let displays: Vec<Value> = device
        .displays
        .iter()
        .map(|d| {
            let modes: Vec<Value> = d
                .modes
                .iter()
                .map(|m| json!({ "width_px": m.width_px, "height_px": m.height_px, "refresh_hz": m.refresh_hz() }))
                .collect();
            json!({ "connector": d.connector, "modes": modes })
        })
        .collect();
    let heaps: Vec<Value> =
        device.memory_heaps.iter().map(|h| json!({ "bytes": h.bytes, "device_local": h.device_local })).collect();
    json!({
        "index": device.index, "name": device.name, "kind": device.kind, "uuid": device.uuid,
        "driver": { "name": device.driver_name, "info": device.driver_info }, "api_version": device.api_version,
        "usable": device.lacks.is_empty(), "lacks": device.lacks, "queue_families": families, "displays": displays,
        "projector_family": device.projector_family, "upload_family": device.upload_family,
        "abilities": device.abilities, "max_storage_buffer_bytes": device.max_storage_buffer_bytes,
        "max_texel_buffer_elements": device.max_texel_buffer_elements, "scene_through": Loads::of_device(device).name(),
        "subgroup_size": device.subgroup_size,
        "memory_heaps": heaps,
    })
}

fn to_text(device: &DeviceInfo) -> String {
    let mut table = Table::new();
    table.load_style(presets::UTF8_BORDERS_ONLY);
    table.set_content_arrangement(ContentArrangement::Dynamic);
    table.set_width(WIDTH);
    table.set_header([format!("{}: {}", device.index, device.name), device.kind.to_owned()]);
    let mut row = |name: &str, value: String| {
        table.add_row([name.to_owned(), value]);
    };
    row("driver", format!("{} {}", device.driver_name, device.driver_info));
    row("Vulkan", device.api_version.clone());
    row("UUID", device.uuid.clone());
    let usable =
        if device.lacks.is_empty() { "yes".to_owned() } else { format!("no: lacks {}", device.lacks.join(", ")) };
    row("usable", usable);
    for family in &device.queue_families {
        row(&format!("queue family {}", family.index), format!("{} queues: {}", family.count, family.flags.join(", ")));
    }
    let uploads = match device.upload_family {
        Some(family) => format!("beside the frames, on a queue of family {family}"),
        None => "between the frames, on the projectors' first queue: no family is for copies alone".to_owned(),
    };
    row("uploads", uploads);
    for heap in &device.memory_heaps {
        let place = if heap.device_local { "on the device" } else { "of the host" };
        row("memory", format!("{} MiB {place}", heap.bytes >> 20));
    }
    row("storage buffers", format!("{} MiB each at most", device.max_storage_buffer_bytes >> 20));
    row("texel buffers", format!("{} elements each at most", device.max_texel_buffer_elements));
    let loads = Loads::of_device(device);
    row("scene through", format!("{}, unless it is too large for them: {}", loads.name(), loads.why()));
    row("subgroup", device.subgroup_size.to_string());
    let (has, lacks): (Vec<_>, Vec<_>) = device.abilities.iter().partition(|(_, there)| **there);
    let names = |list: &[(&&str, &bool)]| list.iter().map(|(name, _)| **name).collect::<Vec<_>>().join(", ");
    row("has", names(&has));
    row("has not", names(&lacks));
    if device.displays.is_empty() {
        row("displays", "none that Vulkan can drive without a desktop".to_owned());
    }
    for display in &device.displays {
        let modes: Vec<String> = display
            .modes
            .iter()
            .map(|m| format!("{}×{} at {:.2} Hz", m.width_px, m.height_px, m.refresh_hz()))
            .collect();
        row(&format!("display {}", display.connector), modes.join(", "));
    }
    table.to_string()
}
