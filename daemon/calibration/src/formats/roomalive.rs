//! The RoomAlive Toolkit's ensemble: cameras and projectors in XML, in metres.
//!
//! x left, y up, z forward, right-handed; matrices by columns; a pose is world from projector; two terms of radial
//! distortion.

use glam::{DMat4, DVec2, DVec3, DVec4, UVec2};
use lantern_config::Unit;
use roxmltree::Node;

use super::context::Context;
use super::posed::{FileLens, Image, Posed};
use super::text::{malformed, number, text};
use super::{FileError, xml};

const FORMAT: &str = "a RoomAlive ensemble";

/// To OpenCV's camera: x and y the other way; its own inverse.
const FROM_ROOMALIVE: DVec3 = DVec3::new(-1.0, -1.0, 1.0);

/// Reads a projector.
pub(super) fn read(bytes: &[u8], context: &Context<'_>) -> Result<Posed, FileError> {
    let document = xml::parse(text(bytes, FORMAT)?, FORMAT)?;
    let root = document.root_element();
    if !root.tag_name().name().eq_ignore_ascii_case("ProjectorCameraEnsemble") {
        let message = format!("its root is <{}>, not <ProjectorCameraEnsemble>", root.tag_name().name());
        return Err(malformed(FORMAT, message));
    }
    let all = xml::needed(root, "projectors", FORMAT)?
        .children()
        .filter(Node::is_element)
        .map(|projector| (xml::child_text(projector, "name").unwrap_or_default().to_owned(), projector))
        .collect();
    let projector = context.entry("projector", all)?;

    let stated_px =
        DVec2::new(xml::child_number(projector, "width", FORMAT)?, xml::child_number(projector, "height", FORMAT)?);
    // A fraction or a sign does not survive the way there and back.
    let size_px = stated_px.as_uvec2();
    if size_px.as_dvec2() != stated_px || size_px.min_element() == 0 {
        return Err(malformed(FORMAT, format!("its image is {} × {} pixels", stated_px.x, stated_px.y)));
    }
    let size_px: UVec2 = context.size_px(Some(size_px))?;

    let [x, y, z] = columns::<3, 3>(projector, "cameraMatrix")?;
    if (x[1], x[2], y[0], y[2], z[2]) != (0.0, 0.0, 0.0, 0.0, 1.0) || x[0] <= 0.0 || y[1] <= 0.0 {
        return Err(malformed(FORMAT, "cameraMatrix has no focal lengths and principal point, by columns".to_owned()));
    }
    let [radial] = columns::<1, 2>(projector, "lensDistortion")?;
    let [a, b, c, d] = columns::<4, 4>(projector, "pose")?.map(DVec4::from_array);
    let world_from_projector = DMat4::from_cols(a, b, c, d);
    if world_from_projector.row(3) != DVec4::W {
        return Err(malformed(FORMAT, "pose has no last row of 0 0 0 1".to_owned()));
    }
    Ok(Posed {
        size_px,
        focal_px: DVec2::new(x[0], y[1]),
        // Its x and y grow to the other sides; half a pixel is between its pixels and continuous ones.
        centre_px: size_px.as_dvec2() - DVec2::new(z[0], z[1]) + 0.5,
        view_from_file: DMat4::from_scale(FROM_ROOMALIVE) * rigid_inverse(world_from_projector)?,
        unit: Some(Unit::Metre),
        near: None,
        far: None,
        image: Image { lens: FileLens::BrownConrady([radial[0], radial[1], 0.0, 0.0, 0.0]), ..Image::default() },
    })
}

/// The inverse of a pose, where it has one.
fn rigid_inverse(world_from_projector: DMat4) -> Result<DMat4, FileError> {
    let inverse = world_from_projector.inverse();
    if inverse.is_finite() { Ok(inverse) } else { Err(malformed(FORMAT, "pose cannot be inverted".to_owned())) }
}

/// A matrix of `C` columns of `R` numbers.
fn columns<const C: usize, const R: usize>(
    projector: Node<'_, '_>,
    name: &'static str,
) -> Result<[[f64; R]; C], FileError> {
    let values = xml::needed(xml::needed(projector, name, FORMAT)?, "ValuesByColumn", FORMAT)?;
    let column = |element: Node<'_, '_>| -> Result<[f64; R], FileError> {
        let entries = element.children().filter(Node::is_element);
        let numbers: Vec<f64> =
            entries.map(|entry| number(entry.text().unwrap_or_default(), FORMAT, name)).collect::<Result<_, _>>()?;
        <[f64; R]>::try_from(numbers)
            .map_err(|numbers| malformed(FORMAT, format!("a column of {name} has {} numbers, not {R}", numbers.len())))
    };
    let all: Vec<[f64; R]> = values.children().filter(Node::is_element).map(column).collect::<Result<_, _>>()?;
    <[[f64; R]; C]>::try_from(all)
        .map_err(|all| malformed(FORMAT, format!("{name} has {} columns, not {C}", all.len())))
}
