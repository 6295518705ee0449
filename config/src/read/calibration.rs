//! `[projector.calibration]`: matrices, or a file with what it leaves unsaid.

use super::{IDENTITY, path, similarity};
use crate::calibration::{Calibration, CalibrationFile, Convention, Format, Matrices, Matrix4, Order, Unit};
use crate::reader::{Table, Value};
use std::path::Path;

/// Nearer than any prop, and far enough that depth keeps its digits.
const NEAR_M: (f64, f64) = (1e-4, 1e4);

const CONVENTIONS: [(&str, Convention); 2] = [("opengl", Convention::OpenGl), ("vulkan", Convention::Vulkan)];

/// Reads the table. Every key is asked for in any case, so that an unknown one is told all of them.
pub(super) fn calibration(table: Table<'_>, base_dir: &Path) -> Option<Calibration> {
    let keys = Keys {
        convention: table.get("convention"),
        projection: table.get("projection"),
        view: table.get("view"),
        order: table.get("order"),
        file: table.get("file"),
        format: table.get("format"),
        entry: table.get("entry"),
        unit: table.get("unit"),
        resolution_px: table.get("resolution_px"),
        near_m: table.get("near_m"),
        far_m: table.get("far_m"),
        world_from_file: table.get("world_from_file"),
    };
    let read = match &keys.file {
        Some(file) => of_file(&table, &keys, file, base_dir).map(Calibration::File),
        None => of_matrices(&table, &keys).map(Calibration::Matrices),
    };
    table.finish();
    read
}

struct Keys<'a> {
    convention: Option<Value<'a>>,
    projection: Option<Value<'a>>,
    view: Option<Value<'a>>,
    order: Option<Value<'a>>,
    file: Option<Value<'a>>,
    format: Option<Value<'a>>,
    entry: Option<Value<'a>>,
    unit: Option<Value<'a>>,
    resolution_px: Option<Value<'a>>,
    near_m: Option<Value<'a>>,
    far_m: Option<Value<'a>>,
    world_from_file: Option<Value<'a>>,
}

fn of_matrices(table: &Table<'_>, keys: &Keys<'_>) -> Option<Matrices> {
    let of_files =
        [&keys.format, &keys.entry, &keys.unit, &keys.resolution_px, &keys.near_m, &keys.far_m, &keys.world_from_file];
    for value in of_files.into_iter().flatten() {
        value.problem(format!("`{}` is of no use without `file`", value.path), "remove it");
    }
    if keys.convention.is_none() {
        let hint = "add convention = \"opengl\" (y up, z from -1 to 1) or \"vulkan\" (y down, z from 0 to 1): the clip \
                    space that `projection` leads to, which nothing else tells";
        table.problem("the calibration has no `convention`, which is required", hint);
    }
    let convention = keys.convention.as_ref().and_then(|value| value.choice(&CONVENTIONS));
    let order = order(keys);
    let matrix = |key| {
        let value = table.required(key, "[[…], […], […], […]]")?;
        value.matrix().map(|matrix| rows(matrix, order.unwrap_or_default()))
    };
    let (projection, view) = (matrix("projection"), matrix("view"));
    Some(Matrices { convention: convention?, projection: projection?, view: view?, order: order? })
}

fn of_file(table: &Table<'_>, keys: &Keys<'_>, file: &Value<'_>, base_dir: &Path) -> Option<CalibrationFile> {
    let formats = Format::ALL.map(|format| (format.as_str(), format));
    let units = Unit::ALL.map(|unit| (unit.as_str(), unit));
    if keys.format.is_none() {
        let hint = "add format = \"opencv\", \"mpcdi\", \"roomalive\" or \"splash\": what wrote the file";
        table.problem("the calibration has a `file` and no `format`, which is required", hint);
    }
    let format = keys.format.as_ref().and_then(|value| value.choice(&formats));

    // A pose beside a file is for a file that has none; which format may lack one, its own reader knows.
    if let Some(projection) = &keys.projection {
        let message =
            format!("`{}` stands beside `{}`: a calibration has matrices or a file", file.path, projection.path);
        file.problem(message, "remove `file` and `format`, or the matrices");
    }
    if let Some(format) = format.filter(|format| *format != Format::OpenCv && keys.projection.is_none()) {
        for value in [&keys.view, &keys.order].into_iter().flatten() {
            let message =
                format!("`{}` is of no use here: a file of format \"{}\" says it itself", value.path, format.as_str());
            value.problem(message, "remove it");
        }
    }

    let order = order(keys);
    let view = optional(&keys.view, |value| value.matrix().map(|matrix| rows(matrix, order.unwrap_or_default())));
    let world_from_file = optional(&keys.world_from_file, |value| {
        let hint = "take a rotation or a mirroring, at most with a translation and one scale for all axes";
        similarity(value, true, hint)
    });
    let distance = |value: &Value<'_>| {
        let allowed = format!("from {} to {}", NEAR_M.0, NEAR_M.1);
        value.number_where(&allowed, |metres| (NEAR_M.0..=NEAR_M.1).contains(&metres))
    };
    let (near_m, far_m) = (optional(&keys.near_m, distance), optional(&keys.far_m, distance));
    if let (Some(Some(near_m)), Some(Some(far_m)), Some(value)) = (near_m, far_m, &keys.far_m)
        && far_m <= near_m
    {
        value.problem(format!("`{}` is {far_m}, and `near_m` is {near_m}", value.path), "the far plane lies beyond");
        return None;
    }
    let read = CalibrationFile {
        path: path(file, base_dir)?,
        format: format?,
        entry: optional(&keys.entry, |value| value.name())?,
        unit: optional(&keys.unit, |value| value.choice(&units))?,
        resolution_px: optional(&keys.resolution_px, super::projector::resolution_px)?,
        near_m: near_m?,
        far_m: far_m?,
        convention: optional(&keys.convention, |value| value.choice(&CONVENTIONS))?.unwrap_or(Convention::Vulkan),
        order: order?,
        view: view?,
        world_from_file: world_from_file?.unwrap_or(IDENTITY),
    };
    keys.projection.is_none().then_some(read)
}

/// `None` where the value is there and wrong, which has been noted; `Some(None)` where it is not there.
fn optional<T>(value: &Option<Value<'_>>, read: impl Fn(&Value<'_>) -> Option<T>) -> Option<Option<T>> {
    match value {
        None => Some(None),
        Some(value) => read(value).map(Some),
    }
}

fn order(keys: &Keys<'_>) -> Option<Order> {
    optional(&keys.order, |value| value.choice(&[("row", Order::Row), ("column", Order::Column)]))
        .map(Option::unwrap_or_default)
}

/// A matrix as rows.
fn rows(matrix: Matrix4, order: Order) -> Matrix4 {
    match order {
        Order::Row => matrix,
        Order::Column => std::array::from_fn(|row| std::array::from_fn(|column| matrix[column][row])),
    }
}
