//! `[[projector]]`.

use super::calibration::calibration;
use super::unique_name;
use crate::reader::{Table, Value};
use crate::types::{Fullscreen, Output, OutputKind, Pixels, Projector};
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
        None => Some(Output::default()),
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
        Export,
    }
    let kinds =
        [("headless", Kind::Headless), ("window", Kind::Window), ("display", Kind::Display), ("export", Kind::Export)];
    let kind = table.required("kind", "\"headless\"").and_then(|value| value.choice(&kinds));
    let refresh = table.get("refresh_hz");
    let refresh_hz = refresh.and_then(|v| v.number_where("from 1 to 1000", |hz| (1.0..=1000.0).contains(&hz)));
    let latency = table.get("latency_ms");
    let latency_ms = latency.and_then(|v| v.number_where("from 0 to 1000", |ms| (0.0..=1000.0).contains(&ms)));
    let pixels = [("8-bit", Pixels::Bits8), ("10-bit", Pixels::Bits10), ("hdr10", Pixels::Hdr10)];
    let pixels = table.get("pixels").map(|value| value.choice(&pixels));
    let white = table.get("white_nits");
    let white_nits = white.and_then(|v| v.number_where("from 1 to 10000", |nits| (1.0..=10_000.0).contains(&nits)));

    // Each kind has keys of its own; one of another's would be lost without a word.
    let own = |key: &'static str, of: Kind, owner: &str| {
        let value = table.get(key)?;
        if kind.is_some_and(|kind| kind != of) {
            value.problem(format!("`{}` belongs to {owner}", value.path), format!("remove `{key}`, or change `kind`"));
            return None;
        }
        Some(value)
    };
    let server = own("server", Kind::Window, "a window").and_then(|value| value.name());
    let fullscreen = own("fullscreen", Kind::Window, "a window").and_then(|value| {
        if value.is_string() {
            return value.name().map(Fullscreen::On);
        }
        value.boolean().map(|all| if all { Fullscreen::Any } else { Fullscreen::No })
    });
    let connector = own("connector", Kind::Display, "a display").and_then(|value| value.name());
    let edid = own("edid", Kind::Display, "a display").and_then(|value| value.name());
    if kind == Some(Kind::Display) && table.get("connector").is_none() && table.get("edid").is_none() {
        table.problem(
            "a display is known by its `connector` or its `edid`, and neither is there",
            "add connector = \"DP-1\", or edid = \"EPS-0123\"; lanternd devices lists both",
        );
    }
    table.finish();
    let kind = match kind? {
        Kind::Headless => OutputKind::Headless,
        Kind::Window => OutputKind::Window { server, fullscreen: fullscreen.unwrap_or(Fullscreen::No) },
        Kind::Display => OutputKind::Display { connector, edid },
        Kind::Export => OutputKind::Export,
    };
    let default = Output::default();
    Some(Output {
        kind,
        refresh_hz,
        latency_ms: latency_ms.unwrap_or(default.latency_ms),
        pixels: pixels.map_or(Some(default.pixels), |pixels| pixels)?,
        white_nits: white_nits.unwrap_or(default.white_nits),
    })
}
