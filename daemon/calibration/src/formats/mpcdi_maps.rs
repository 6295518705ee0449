//! The files of an MPCDI region: where its pixels really fall, and how bright they are to be.

use glam::{UVec2, Vec2, Vec3};
use image::{ImageFormat, ImageReader, Limits};
use roxmltree::Node;
use std::io::Cursor;

use super::archive::Archive;
use super::context::Context;
use super::mpcdi::{FORMAT, Profile};
use super::pfm::{self, Pfm};
use super::posed::{FileLens, Image, Posed};
use super::text::malformed;
use super::{FileError, limits, xml};
use crate::{Map, Maps};

/// A packed picture: 16 bits of four channels at the most.
const PICTURE_BYTES: u64 = limits::MAP_PX * 8;

/// Reads what a file set names.
pub(super) fn read(
    files: Node<'_, '_>,
    mut archive: Option<&mut Archive<'_>>,
    profile: Profile,
    posed: &Posed,
    context: &Context<'_>,
) -> Result<Image, FileError> {
    let mut take = |of: Node<'_, '_>, limit_bytes: u64| -> Result<Vec<u8>, FileError> {
        let path = xml::child_text(of, "path")
            .ok_or_else(|| malformed(FORMAT, format!("<{}> has no <path>", of.tag_name().name())))?;
        let archive = archive.as_deref_mut().ok_or_else(|| FileError::Wrong {
            key: "file",
            message: format!("it names {path:?}, and an XML alone holds no maps"),
            hint: "name the .mpcdi archive that it came in, or remove its <files>".to_owned(),
        })?;
        archive.read(path, limit_bytes)
    };

    // What bends the image is the distortion map where there is one. The warp beside it has the points of the screen then,
    // which is what our props are.
    let distortion = xml::child(files, "distortionMap");
    let warp = xml::child(files, "geometryWarpFile");
    let lens = match (distortion, warp) {
        (Some(map), _) => shares(
            pfm::parse(&take(map, pfm::BYTES)?)?,
            "<distortionMap> holds points",
            "export it as a map of the image, or its points as a <geometryWarpFile> with a <geometricUnit>",
        )?,
        (None, Some(warp)) => {
            check_interpolation(warp)?;
            let pfm = pfm::parse(&take(warp, pfm::BYTES)?)?;
            let has_points = profile == Profile::ShaderLamps || posed.unit.is_some();
            if has_points {
                points(pfm, warp, posed, context)?
            } else {
                shares(
                    pfm,
                    "<geometryWarpFile> holds points and says no unit",
                    "write <geometricUnit> beside its <path>, or export it as a map of the image",
                )?
            }
        }
        (None, None) => FileLens::Pinhole,
    };
    let mut map = |name| xml::child(files, name).map(|map| brightness(map, &take(map, PICTURE_BYTES)?)).transpose();
    let maps = Maps { alpha: map("alphaMap")?, beta: map("betaMap")? };
    Ok(Image { lens, maps })
}

fn check_interpolation(warp: Node<'_, '_>) -> Result<(), FileError> {
    match xml::child_text(warp, "interpolation") {
        Some(name) if ["keystone", "smooth"].contains(&name.to_ascii_lowercase().as_str()) => Err(FileError::Wrong {
            key: "file",
            message: format!("its warp is to be interpolated by {name:?}, which is not built"),
            hint: "export it with interpolation \"linear\"".to_owned(),
        }),
        _ => Ok(()),
    }
}

/// u to the right and v down, in shares of the image. Points of the world look alike but for their third number, which a
/// place in the image has no use for: those are refused with what they are and what to do. That the configuration says a
/// unit makes no points of them: it does so for where the projector stands.
fn shares(pfm: Pfm, points: &str, hint: &str) -> Result<FileLens, FileError> {
    if pfm.pixels.iter().any(|pixel| pixel.z.is_finite() && pixel.z != 0.0) {
        return Err(FileError::Wrong {
            key: "file",
            message: format!("its {points}: its third numbers are not 0, as those of a map of the image are"),
            hint: hint.to_owned(),
        });
    }
    Ok(FileLens::Warp { size: pfm.size, places: pfm.pixels.iter().map(|pixel| pixel.truncate()).collect() })
}

/// Points of the world: a pixel's light goes from the frustum's centre through its point.
fn points(pfm: Pfm, warp: Node<'_, '_>, posed: &Posed, context: &Context<'_>) -> Result<FileLens, FileError> {
    // Any unit will do, as long as it is that of the projector's own place, which has none of its own in the file.
    context.unit_m(posed.unit)?;
    let origin = xml::child_text(warp, "originOf3DData").unwrap_or_default();
    if origin.eq_ignore_ascii_case("idealEyePoint") {
        return Err(FileError::Wrong {
            key: "file",
            message: "the points of its warp are seen from an eye, which is not built".to_owned(),
            hint: "export it with originOf3DData \"floorCenter\"".to_owned(),
        });
    }
    let place = |point: &Vec3| {
        let view = posed.view_from_file.transform_point3(point.as_dvec3());
        let ahead = if view.z > 0.0 { view.z } else { f64::NAN };
        let at_px = posed.centre_px + posed.focal_px * view.truncate() / ahead;
        (at_px / posed.size_px.as_dvec2()).as_vec2()
    };
    Ok(FileLens::Warp { size: pfm.size, places: pfm.pixels.iter().map(place).collect::<Vec<Vec2>>() })
}

/// A picture as linear values.
fn brightness(map: Node<'_, '_>, bytes: &[u8]) -> Result<Map, FileError> {
    let name = map.tag_name().name();
    // Beta maps are written without a gamma, and added to linear light as they are.
    let is_beta = name.eq_ignore_ascii_case("betaMap");
    let is_linear = is_beta && xml::child(map, "gammaEmbedded").is_none();
    let gamma = if is_linear { 1.0 } else { xml::child_number(map, "gammaEmbedded", FORMAT)? };
    if !(0.1..=10.0).contains(&gamma) {
        return Err(malformed(FORMAT, format!("gammaEmbedded of <{name}> is {gamma}")));
    }
    let mut reader = ImageReader::with_format(Cursor::new(bytes), ImageFormat::Png);
    let mut bounds = Limits::default();
    bounds.max_alloc = Some(2 * PICTURE_BYTES);
    (bounds.max_image_width, bounds.max_image_height) = (Some(1 << 16), Some(1 << 16));
    reader.limits(bounds);
    let damaged = |error: image::ImageError| malformed("a PNG map", format!("<{name}>: {error}"));
    let (width, height) = {
        let header = ImageReader::with_format(Cursor::new(bytes), ImageFormat::Png);
        header.into_dimensions().map_err(damaged)?
    };
    if u64::from(width) * u64::from(height) > limits::MAP_PX {
        return Err(malformed("a PNG map", format!("<{name}> is {width} × {height} pixels")));
    }
    let picture = reader.decode().map_err(damaged)?.into_rgb16();
    let linear = |value: u16| (f64::from(value) / f64::from(u16::MAX)).powf(gamma) as f32;
    let values = picture.pixels().map(|pixel| Vec3::from_array(pixel.0.map(linear))).collect();
    Ok(Map { size: UVec2::new(width, height), values })
}
