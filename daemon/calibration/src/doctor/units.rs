//! Lengths that are read in another unit than they were written in.

use glam::{DVec2, DVec3};
use lantern_config::{Calibration as Configured, Format, Unit};

use super::{Ailment, Finding, Patient, Props};
use crate::Frustum;
use crate::clip::dmat4_from_rows;

/// From farther than this no projector lights anything.
const CERTAINLY_TOO_FAR_M: f64 = 1000.0;

/// From farther than this, and from many times the size of what it lights, few do.
const SUSPICIOUSLY_FAR_M: f64 = 100.0;
const SUSPICIOUSLY_FAR_SIZES: f64 = 30.0;

/// Nearer to the props than this no projector would stand in the unit that is proposed.
const NEAREST_M: f64 = 0.3;

/// A unit that makes the projector stand among the props is wrong by one of these, the usual one first.
const TOO_SMALL_BY: [f64; 2] = [1000.0, 100.0];

/// Where a projector stands in a unit that is too large or too small.
pub(super) fn wrong_units(patient: &Patient<'_>, props: Option<&Props>) -> Option<Finding> {
    let stands_m = patient.seen.position_m?;
    too_large(patient, stands_m, props).or_else(|| too_small(patient, stands_m, props?))
}

/// It stands too far off.
fn too_large(patient: &Patient<'_>, stands_m: DVec3, props: Option<&Props>) -> Option<Finding> {
    let distance_m = props.map_or(stands_m.length(), |props| distance_m(stands_m, props));
    let size_m = props.map_or(0.0, size_m);
    let certain = distance_m > CERTAINLY_TOO_FAR_M && props.is_some();
    let suspicious = distance_m > SUSPICIOUSLY_FAR_M && distance_m > SUSPICIOUSLY_FAR_SIZES * size_m;
    // Without props it may stand where it likes, but for the other side of the world.
    let known = props.is_some() || distance_m > CERTAINLY_TOO_FAR_M;
    if !known || !(certain || suspicious) {
        return None;
    }

    // The smallest unit of which it would not stand on the props. Where only the file knows its own, the steps are the same.
    let present = unit(patient.configured);
    let factor = |unit: Unit| unit.metres() / present.unwrap_or(Unit::Metre).metres();
    let is_near = |unit: &Unit| (NEAREST_M..=SUSPICIOUSLY_FAR_M).contains(&(distance_m * factor(*unit)));
    let written =
        [Unit::Millimetre, Unit::Centimetre].into_iter().filter(|unit| factor(*unit) < 1.0).find(|unit| is_near(unit));
    let (key, hint) = match written {
        Some(written) => remedy(patient.configured, present, written, factor(written)),
        None => {
            let (key, translation) = translation(patient.configured);
            (key, format!("no smaller unit brings it near: look at the translation {translation}"))
        }
    };
    let what = if props.is_some() { "the nearest prop" } else { "the world's origin" };
    let message = format!("wrong units: it stands {} m from {what}", thousands(distance_m));
    Some(Finding { ailment: Ailment::WrongUnits, certain, key, message, hint })
}

/// A file's projector stands inside of the box around all props, where another unit would have it light them from outside.
/// A room of props has its projectors inside too, but seldom so near the file's origin that this is so.
fn too_small(patient: &Patient<'_>, stands_m: DVec3, props: &Props) -> Option<Finding> {
    let Configured::File(file) = patient.configured else { return None };
    let present = unit(patient.configured).filter(|present| file.unit == Some(*present))?;
    if distance_m(stands_m, props) > 0.0 {
        return None;
    }
    let frustum = Frustum::new(patient.calibration.clone());
    let size_px = patient.seen.resolution_px.as_dvec2();
    let world_from_file = dmat4_from_rows(&file.world_from_file);
    let stands_in_file_m = world_from_file.inverse().transform_point3(stands_m);
    let written = TOO_SMALL_BY.into_iter().find_map(|factor| {
        let is_it = |unit: &Unit| (unit.metres() / present.metres() / factor - 1.0).abs() < 1e-9;
        let written = Unit::ALL.into_iter().find(is_it)?;
        let would_stand_m = world_from_file.transform_point3(stands_in_file_m * factor);
        let would_be_off_m = distance_m(would_stand_m, props);
        let farthest_m = SUSPICIOUSLY_FAR_M.min(SUSPICIOUSLY_FAR_SIZES * size_m(props));
        // That it stands elsewhere is as if the props did.
        let middle = frustum.project(props.middle_m() + stands_m - would_stand_m)?;
        let sees = middle.place_px.cmpge(DVec2::ZERO).all() && middle.place_px.cmple(size_px).all();
        (would_be_off_m >= NEAREST_M && would_be_off_m <= farthest_m && sees).then_some((written, factor))
    });
    let (written, factor) = written?;
    let (key, hint) = remedy(patient.configured, Some(present), written, factor);
    let message = "wrong units: it stands inside of the box around all props".to_owned();
    Some(Finding { ailment: Ailment::WrongUnits, certain: false, key, message, hint })
}

/// The unit that its lengths are read in; `None` where only the file says it.
fn unit(configured: &Configured) -> Option<Unit> {
    match configured {
        Configured::Matrices(_) => Some(Unit::Metre),
        // A `view` of the configuration is in metres, whatever unit the file has.
        Configured::File(file) if file.view.is_some() || file.format == Format::RoomAlive => Some(Unit::Metre),
        Configured::File(file) => file.unit,
    }
}

/// The key at which a length can be mended, and where it stands.
fn translation(configured: &Configured) -> (&'static str, &'static str) {
    match configured {
        Configured::Matrices(_) => ("view", "of `view`"),
        Configured::File(file) if file.view.is_some() => ("view", "of `view`"),
        Configured::File(_) => ("file", "in the file"),
    }
}

/// What makes lengths, read in one unit, those of another, `factor` times as long; and the key to do it at.
fn remedy(configured: &Configured, read: Option<Unit>, written: Unit, factor: f64) -> (&'static str, String) {
    let (key, what) = match (translation(configured).0, configured) {
        ("file", Configured::File(file)) if file.unit.is_some() => {
            ("unit", format!("set unit = \"{}\"", written.as_str()))
        }
        ("file", _) => ("file", format!("scale it by {factor} in world_from_file")),
        (key, _) => (key, format!("multiply the translation of `{key}` by {factor}")),
    };
    let looks = match read {
        Some(read) => format!("it looks like {} that are read as {}", plural(written), plural(read)),
        None => format!("its lengths look {:.0} times too large", factor.recip()),
    };
    (key, format!("{looks}: {what}"))
}

fn distance_m(from_m: DVec3, props: &Props) -> f64 {
    from_m.distance(from_m.clamp(props.low_m, props.high_m))
}

fn size_m(props: &Props) -> f64 {
    props.low_m.distance(props.high_m)
}

fn plural(unit: Unit) -> &'static str {
    match unit {
        Unit::Millimetre => "millimetres",
        Unit::Centimetre => "centimetres",
        Unit::Decimetre => "decimetres",
        Unit::Metre => "metres",
        Unit::Inch => "inches",
        Unit::Foot => "feet",
        Unit::Yard => "yards",
    }
}

/// A whole number with its thousands parted.
fn thousands(number: f64) -> String {
    let digits = format!("{number:.0}");
    let parted: Vec<&str> =
        digits.as_bytes().rchunks(3).rev().map(|chunk| std::str::from_utf8(chunk).unwrap_or_default()).collect();
    parted.join(",")
}
