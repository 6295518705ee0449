//! Splash's configuration: JSON with comments, whose cameras are its projectors.
//!
//! A camera has `eye`, `target` and `up`, an upright field of view in degrees, and a principal point in shares of the
//! image from the bottom left. It looks along −z. Values may be scalars or arrays of one.

use glam::{DMat4, DVec2, DVec3, UVec2};
use serde_json::{Map, Value};

use super::context::Context;
use super::posed::{FROM_OPENGL, Image, Posed};
use super::text::{malformed, text};
use super::{FileError, json, limits};

const FORMAT: &str = "a Splash configuration";

/// Reads a camera.
pub(super) fn read(bytes: &[u8], context: &Context<'_>) -> Result<Posed, FileError> {
    let root = json::parse(&json::without_comments(text(bytes, FORMAT)?), FORMAT)?;
    let mut cameras = Vec::new();
    find_cameras(&root, &mut cameras);
    let camera = context.entry("camera", cameras)?;

    let size_px = context.size_px(size(camera)?)?;
    let fov = numbers::<1>(camera, "fov")?.ok_or_else(|| lacks("fov"))?[0];
    if !(fov > 0.0 && fov < 180.0) {
        return Err(malformed(FORMAT, format!("fov is {fov} degrees")));
    }
    let vector = |name| numbers::<3>(camera, name)?.map(DVec3::from_array).ok_or_else(|| lacks(name));
    let (eye, target, up) = (vector("eye")?, vector("target")?, vector("up")?);
    let forward = (target - eye).normalize_or_zero();
    let right = forward.cross(up).normalize_or_zero();
    if forward == DVec3::ZERO || right == DVec3::ZERO {
        return Err(malformed(FORMAT, "eye, target and up do not span a plane".to_owned()));
    }
    let world_from_view =
        DMat4::from_cols(right.extend(0.0), right.cross(forward).extend(0.0), (-forward).extend(0.0), eye.extend(1.0));

    // On a plane at distance 1 the image reaches from −t·(1 + 2(c − ½)) to t·(1 − 2(c − ½)), from the left and from below,
    // with t = tan(fov / 2) upright and as much more across as the image is wider than high. So the axis meets it at c of
    // its side, and a pixel is 2t / rows wide and high.
    let principal = numbers::<2>(camera, "principalPoint")?.map_or(DVec2::splat(0.5), DVec2::from_array);
    let size = size_px.as_dvec2();
    let focal_px = DVec2::splat(size.y / (2.0 * (fov.to_radians() / 2.0).tan()));
    Ok(Posed {
        size_px,
        focal_px,
        centre_px: DVec2::new(principal.x, 1.0 - principal.y) * size,
        view_from_file: DMat4::from_scale(FROM_OPENGL) * world_from_view.inverse(),
        unit: None,
        near: numbers::<1>(camera, "near")?.map(|[near]| near),
        far: numbers::<1>(camera, "far")?.map(|[far]| far),
        image: Image::default(),
    })
}

fn lacks(name: &str) -> FileError {
    malformed(FORMAT, format!("the camera has no {name}"))
}

/// Objects of type `camera`, wherever they stand, by name. The depth of JSON is bounded by its parser.
fn find_cameras<'a>(value: &'a Value, found: &mut Vec<(String, &'a Map<String, Value>)>) {
    let Value::Object(map) = value else { return };
    for (name, value) in map {
        match value {
            Value::Object(inner) if is_camera(inner) => found.push((name.clone(), inner)),
            other => find_cameras(other, found),
        }
    }
}

fn is_camera(object: &Map<String, Value>) -> bool {
    let kind = object.get("type");
    let kind = kind.map(|kind| kind.as_array().map_or(std::slice::from_ref(kind), Vec::as_slice));
    kind.is_some_and(|kind| matches!(kind, [Value::String(kind)] if kind == "camera"))
}

/// A number or an array of as many as are wanted.
fn numbers<const N: usize>(camera: &Map<String, Value>, name: &str) -> Result<Option<[f64; N]>, FileError> {
    let Some(value) = camera.get(name) else { return Ok(None) };
    let items = value.as_array().map_or(std::slice::from_ref(value), Vec::as_slice);
    let numbers: Option<Vec<f64>> = items.iter().map(Value::as_f64).collect();
    let numbers = numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
    numbers.map(Some).ok_or_else(|| malformed(FORMAT, format!("{name} is {value}, not {N} numbers")))
}

/// The image that it states, where it does.
fn size(camera: &Map<String, Value>) -> Result<Option<UVec2>, FileError> {
    let Some(size) = numbers::<2>(camera, "size")? else { return Ok(None) };
    let is_side = |side: f64| side.fract() == 0.0 && side >= 1.0 && side <= limits::MAP_PX as f64;
    if !size.into_iter().all(is_side) {
        return Err(malformed(FORMAT, format!("size is {} × {}", size[0], size[1])));
    }
    // Whole and in range, so the conversion is exact.
    Ok(Some(UVec2::new(size[0] as u32, size[1] as u32)))
}
