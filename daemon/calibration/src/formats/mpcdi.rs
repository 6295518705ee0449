//! VESA MPCDI 2.0: a zip with `mpcdi.xml`, or that XML alone; profiles 3d and sl (shader lamps).
//!
//! Angles are degrees. With B = the axis columns [pitch | −yaw | −roll] of the coordinate frame, the projector's axes
//! (x right, y up, looking along −z) stand in the world as B · Ry(−yaw) · Rx(pitch) · Rz(−roll), and its image reaches over
//! the tangents of its four angles.

use glam::{DMat3, DMat4, DVec2, DVec3, UVec2};
use lantern_config::Unit;
use roxmltree::Node;

use super::archive::Archive;
use super::context::Context;
use super::mpcdi_maps;
use super::posed::{FROM_OPENGL, Posed, affine};
use super::text::{malformed, number, text};
use super::{FileError, limits, xml};

pub(super) const FORMAT: &str = "MPCDI";

/// What a file was written for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Profile {
    /// A frustum, and at most a warp.
    Simulation,
    /// A projector that lights things, which is what we have.
    ShaderLamps,
}

/// Reads a region.
pub(super) fn read(bytes: &[u8], context: &Context<'_>) -> Result<Posed, FileError> {
    if !Archive::is(bytes) {
        return of_xml(text(bytes, FORMAT)?, None, context);
    }
    let mut archive = Archive::open(bytes)?;
    // Some writers call it by the format's first name.
    let xml = archive.read("mpcdi.xml", limits::TEXT_BYTES).or_else(|error| match error {
        FileError::Malformed { .. } => archive.read("mpacs.xml", limits::TEXT_BYTES).map_err(|_| error),
        other => Err(other),
    })?;
    of_xml(text(&xml, FORMAT)?, Some(&mut archive), context)
}

fn of_xml(text: &str, archive: Option<&mut Archive<'_>>, context: &Context<'_>) -> Result<Posed, FileError> {
    let document = xml::parse(text, FORMAT)?;
    let root = document.root_element();
    if !root.tag_name().name().eq_ignore_ascii_case("mpcdi") {
        return Err(malformed(FORMAT, format!("its root is <{}>, not <MPCDI>", root.tag_name().name())));
    }
    let profile = profile(root)?;
    let buffers = xml::children(xml::needed(root, "display", FORMAT)?, "buffer");
    let regions = buffers.flat_map(|buffer| xml::children(buffer, "region"));
    let all = regions.map(|region| (xml::attribute(region, "id").unwrap_or_default().to_owned(), region)).collect();
    let region = context.entry("region", all)?;
    let size_px = context.size_px(resolution(region)?)?;

    let frustum = xml::needed(region, "frustum", FORMAT)?;
    let frame = xml::child(region, "coordinateFrame");
    if frame.is_none() && profile == Profile::ShaderLamps {
        return Err(malformed(FORMAT, "profile sl has no <coordinateFrame>".to_owned()));
    }
    let (focal_px, centre_px) = image(frustum, size_px)?;
    let view_from_file = view(frustum, frame)?;

    let id = xml::attribute(region, "id").unwrap_or_default();
    let of_region = |set: &Node<'_, '_>| xml::attribute(*set, "region") == Some(id);
    let files = xml::child(root, "files").and_then(|files| xml::children(files, "fileset").find(of_region));
    let mut posed = Posed {
        size_px,
        focal_px,
        centre_px,
        view_from_file,
        unit: files.map(stated_unit).transpose()?.flatten(),
        near: None,
        far: None,
        image: Default::default(),
    };
    if let Some(files) = files {
        posed.image = mpcdi_maps::read(files, archive, profile, &posed, context)?;
    }
    Ok(posed)
}

fn profile(root: Node<'_, '_>) -> Result<Profile, FileError> {
    let name = xml::attribute(root, "profile").unwrap_or_default().trim().to_ascii_lowercase();
    let refused = |message: &str, hint: &str| {
        Err(FileError::Wrong { key: "file", message: format!("its profile is {message}"), hint: hint.to_owned() })
    };
    let other = "export it with profile \"3d\" or \"sl\"";
    match name.as_str() {
        "3d" => Ok(Profile::Simulation),
        "sl" => Ok(Profile::ShaderLamps),
        "2d" => refused("\"2d\", which bends a flat picture and does not say where the projector stands", other),
        "a3" => refused(
            "\"a3\", which says where each pixel lands and not where the projector stands; it is not built",
            other,
        ),
        "" => refused("not said", "write profile=\"3d\" or profile=\"sl\" into its first element, as it is"),
        other_name => refused(&format!("{other_name:?}, which there is none of"), other),
    }
}

fn resolution(region: Node<'_, '_>) -> Result<Option<UVec2>, FileError> {
    let side = |name| {
        let Some(text) = xml::attribute(region, name) else { return Ok(None) };
        let side = number(text, FORMAT, name)?;
        if side.fract() != 0.0 || !(1.0..=65_536.0).contains(&side) {
            return Err(malformed(FORMAT, format!("{name} is {side}")));
        }
        // Whole and in range, so the conversion is exact.
        Ok(Some(side as u32))
    };
    Ok(side("xResolution")?.zip(side("yResolution")?).map(UVec2::from))
}

/// Focal lengths and the place of the axis, from the tangents at the image's edges.
fn image(frustum: Node<'_, '_>, size_px: UVec2) -> Result<(DVec2, DVec2), FileError> {
    let tangent = |name| -> Result<f64, FileError> {
        let degrees = xml::child_number(frustum, name, FORMAT)?;
        if degrees.abs() >= 90.0 {
            return Err(malformed(FORMAT, format!("{name} is {degrees} degrees")));
        }
        Ok(degrees.to_radians().tan())
    };
    let (left, right) = (tangent("leftAngle")?, tangent("rightAngle")?);
    let (down, up) = (tangent("downAngle")?, tangent("upAngle")?);
    if left >= right || down >= up {
        let message = "its frustum is empty: leftAngle must be below rightAngle, and downAngle below upAngle";
        return Err(malformed(FORMAT, message.to_owned()));
    }
    let focal_px = size_px.as_dvec2() / DVec2::new(right - left, up - down);
    Ok((focal_px, focal_px * DVec2::new(-left, up)))
}

/// x right, y down, z forward from the file's world.
fn view(frustum: Node<'_, '_>, frame: Option<Node<'_, '_>>) -> Result<DMat4, FileError> {
    let angle = |name| xml::child_number(frustum, name, FORMAT).map(f64::to_radians);
    let turned = DMat3::from_rotation_y(-angle("yaw")?)
        * DMat3::from_rotation_x(angle("pitch")?)
        * DMat3::from_rotation_z(-angle("roll")?);
    let (axes, position) = match frame {
        None => (DMat3::IDENTITY, DVec3::ZERO),
        Some(frame) => {
            let vector = |names: [&'static str; 3]| -> Result<DVec3, FileError> {
                let [x, y, z] = names.map(|name| xml::child_number(frame, name, FORMAT));
                Ok(DVec3::new(x?, y?, z?))
            };
            let pitch = vector(["pitchx", "pitchy", "pitchz"])?;
            let yaw = vector(["yawx", "yawy", "yawz"])?;
            let roll = vector(["rollx", "rolly", "rollz"])?;
            (DMat3::from_cols(pitch, -yaw, -roll), vector(["posx", "posy", "posz"])?)
        }
    };
    let world_from_view = affine(axes * turned, position);
    let view_from_world = world_from_view.inverse();
    if !view_from_world.is_finite() {
        return Err(malformed(FORMAT, "the axes of its coordinateFrame are not independent".to_owned()));
    }
    Ok(DMat4::from_scale(FROM_OPENGL) * view_from_world)
}

/// The unit that stands beside the warp: the only one in a file.
fn stated_unit(files: Node<'_, '_>) -> Result<Option<Unit>, FileError> {
    let Some(name) = xml::child(files, "geometryWarpFile").and_then(|warp| xml::child_text(warp, "geometricUnit"))
    else {
        return Ok(None);
    };
    let name = name.to_ascii_lowercase();
    // The last one is the misspelling of a widespread implementation.
    if ["2d", "unknown", "unkown"].contains(&name.as_str()) {
        return Ok(None);
    }
    let unit = Unit::ALL.into_iter().find(|unit| unit.as_str() == name);
    unit.map(Some).ok_or_else(|| malformed(FORMAT, format!("geometricUnit is {name:?}")))
}
