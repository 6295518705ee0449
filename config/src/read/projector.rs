//! `[[projector]]`.

use super::calibration::calibration;
use super::unique_name;
use crate::reader::{Table, Value};
use crate::types::{Output, Projector};
use std::collections::HashSet;
use std::path::Path;

/// The largest side of an image: what every Vulkan driver in use can render to.
const MAX_SIDE_PX: f64 = 16_384.0;

pub(crate) fn projectors(tables: Vec<Table<'_>>, base_dir: &Path) -> Option<Vec<Projector>> {
    let mut taken = HashSet::new();
    let projectors: Vec<_> = tables.into_iter().map(|table| projector(table, &mut taken, base_dir)).collect();
    projectors.into_iter().collect()
}

fn projector(table: Table<'_>, taken: &mut HashSet<String>, base_dir: &Path) -> Option<Projector> {
    let name = unique_name(&table, "projector", taken, "\"left\"");
    let resolution_px = table.required("resolution_px", "[1280, 800]").and_then(|value| resolution_px(&value));
    let output = match table.get("output") {
        None => Some(Output::Headless { refresh_hz: 60.0, latency_ms: 0.0 }),
        Some(value) => value.table().and_then(output),
    };
    let calibration = table
        .required("calibration", "{ convention = …, projection = …, view = … } or { file = …, format = … }")
        .and_then(|value| value.table())
        .and_then(|table| calibration(table, base_dir));
    table.finish();
    Some(Projector { name: name?, resolution_px: resolution_px?, output: output?, calibration: calibration? })
}

/// The sides of an image.
pub(super) fn resolution_px(value: &Value<'_>) -> Option<[u32; 2]> {
    let is_side = |x: f64| x.fract() == 0.0 && (1.0..=MAX_SIDE_PX).contains(&x);
    let sides: [f64; 2] = value.numbers_where("that is whole, from 1 to 16384", is_side)?;
    // Whole and in range, so the conversion is exact.
    Some(sides.map(|side| side as u32))
}

fn output(table: Table<'_>) -> Option<Output> {
    #[derive(Clone, Copy, PartialEq)]
    enum Kind {
        Headless,
        Window,
        Display,
    }
    let kinds = [("headless", Kind::Headless), ("window", Kind::Window), ("display", Kind::Display)];
    let kind_value = table.required("kind", "\"headless\"");
    let kind = kind_value.as_ref().and_then(|value| value.choice(&kinds));
    let refresh = table.get("refresh_hz");
    let refresh_hz = refresh.and_then(|v| v.number_where("from 1 to 1000", |hz| (1.0..=1000.0).contains(&hz)));

    let latency = table.get("latency_ms");
    let latency_ms = latency.and_then(|v| v.number_where("from 0 to 1000", |ms| (0.0..=1000.0).contains(&ms)));

    // A connector is a display's; where displays are refused as a whole it needs no words of its own.
    if let (Some(connector), Some(Kind::Headless)) = (table.get("connector"), kind) {
        connector.problem("a headless output has no connector", "remove `connector`");
    }
    if let (Some(value), Some(Kind::Window | Kind::Display)) = (&kind_value, kind) {
        value.problem("outputs other than headless are not built yet", "write output = { kind = \"headless\" }");
    }
    table.finish();
    let (refresh_hz, latency_ms) = (refresh_hz.unwrap_or(60.0), latency_ms.unwrap_or_default());
    (kind == Some(Kind::Headless)).then_some(Output::Headless { refresh_hz, latency_ms })
}
