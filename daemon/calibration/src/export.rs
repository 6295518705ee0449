//! A calibration written down for others: as matrices for a configuration, or as MPCDI.

use std::fmt::Write as _;
use std::io::{Cursor, Write as _};

use glam::{DMat3, DVec2, DVec3, EulerRot, UVec2, Vec3};
use image::{ImageBuffer, ImageError, ImageFormat, Rgb};
use zip::ZipWriter;
use zip::result::ZipError;
use zip::write::SimpleFileOptions;

use crate::describe::Description;
use crate::formats::pfm::{self, Pfm};
use crate::{Calibration, Convention, Frustum, Lens, Map};

/// An MPCDI frustum has four angles, so what is sheared or keystoned by more than this, in pixels, is none. A matrix of
/// six decimals is off by about a thousandth of a pixel.
const FRUSTUM_WITHIN_PX: f64 = 0.05;

/// What is off by less, in pixels, is so by the last digits of what is exact.
const EXACT_WITHIN_PX: f64 = 1e-6;

/// What was written, and what could not be.
#[derive(Clone, Debug, PartialEq)]
pub struct Exported {
    /// The file.
    pub bytes: Vec<u8>,
    /// What the calibration has and the file does not, in words; and what the configuration must say of the file.
    pub left_out: Vec<String>,
}

/// Why nothing can be written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The format has no words for such a projector.
    #[error("MPCDI has no frustum for it: {0}; hint: --format matrices holds any matrix")]
    NoFrustum(&'static str),
    /// Its image is a rectangle in no frame.
    #[error(
        "MPCDI has no frustum for it: its image is sheared or keystoned by {off_px:.2} px; hint: --format matrices holds \
         any matrix"
    )]
    NotRectangular {
        /// How far the corner that is worst off lies from that of the nearest rectangle, px.
        off_px: f64,
    },
    /// An archive or a picture could not be made.
    #[error("the archive cannot be made: {0}")]
    Archive(#[from] ZipError),
    /// A map could not be made.
    #[error("a map cannot be made: {0}")]
    Picture(#[from] ImageError),
    /// The archive could not be written.
    #[error("the archive cannot be written: {0}")]
    Write(#[from] std::io::Error),
}

/// A `[projector.calibration]` to paste.
pub fn matrices(calibration: &Calibration) -> Exported {
    let mut left_out = Vec::new();
    if calibration.optics().lens() != Lens::Pinhole {
        left_out.push("its lens, which is no part of a matrix: straight lines stay straight".to_owned());
    }
    if calibration.maps().alpha.is_some() || calibration.maps().beta.is_some() {
        left_out.push("its alpha and beta maps".to_owned());
    }
    let convention = match calibration.convention() {
        Convention::OpenGl => "opengl",
        Convention::Vulkan => "vulkan",
    };
    let mut text = String::new();
    for line in &left_out {
        text += &format!("# Not in here: {line}.\n");
    }
    // The product alone is what a calibration is; to part it again would recover what nobody asked for.
    let m = calibration.clip_from_world();
    let rows = [0, 1, 2, 3].map(|row| format!("    {:?},", m.row(row).to_array())).join("\n");
    text += &format!(
        "[projector.calibration]\nconvention = \"{convention}\"\nprojection = [\n{rows}\n]\n\
         view = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"
    );
    Exported { bytes: text.into_bytes(), left_out }
}

/// An archive of profile 3d with one region.
///
/// # Errors
/// [`ExportError`].
pub fn mpcdi(calibration: &Calibration, region: &str) -> Result<Exported, ExportError> {
    let frustum = Frustum::new(calibration.clone());
    let shape = Shape::of(calibration)?;
    let size_px = calibration.resolution_px();
    let mut left_out = vec![
        "its unit, which is metres: set unit = \"m\" where it is loaded".to_owned(),
        "its near and far planes and its clip space: set near_m, far_m and convention where they matter".to_owned(),
    ];
    if shape.off_px > EXACT_WITHIN_PX {
        left_out.push(format!("its shear and keystone, of up to {:.6} px: a frustum has none", shape.off_px));
    }

    let mut members: Vec<(&str, Vec<u8>)> = Vec::new();
    let mut files = String::new();
    if calibration.optics().lens() != Lens::Pinhole {
        let map = warp(&frustum, size_px);
        members.push(("warp.pfm", pfm::write(&map)));
        files +=
            "      <geometryWarpFile><path>warp.pfm</path><interpolation>linear</interpolation></geometryWarpFile>\n";
        left_out.push("its lens between the middles of pixels, where the warp is interpolated".to_owned());
    }
    // A beta map is linear and has no word for it.
    let linear = "<gammaEmbedded>1</gammaEmbedded>";
    let maps = calibration.maps();
    for (name, element, gamma, map) in
        [("alpha.png", "alphaMap", linear, &maps.alpha), ("beta.png", "betaMap", "", &maps.beta)]
    {
        let Some(map) = map else { continue };
        members.push((name, picture(map)?));
        files += &format!(
            "      <{element}><path>{name}</path><componentDepth>3</componentDepth><bitdepth>16</bitdepth>{gamma}</{element}>\n"
        );
        left_out.push(format!("what 16 bits do not hold of {name}"));
    }
    let xml = document(&shape, size_px, region, &files);
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    members.insert(0, ("mpcdi.xml", xml.into_bytes()));
    for (name, bytes) in members {
        writer.start_file(name, SimpleFileOptions::default())?;
        writer.write_all(&bytes)?;
    }
    Ok(Exported { bytes: writer.finish()?.into_inner(), left_out })
}

/// Position, turn and angles of an MPCDI region.
struct Shape {
    position_m: DVec3,
    /// Yaw to the right, pitch up, roll clockwise, degrees.
    turn_deg: [f64; 3],
    /// Left, right, up and down, degrees.
    angles_deg: [f64; 4],
    /// How far the image's corners lie from those of the calibration, at the most, px.
    off_px: f64,
}

impl Shape {
    fn of(calibration: &Calibration) -> Result<Self, ExportError> {
        // What the matrix says, without the lens.
        let ideal = calibration.clone().with_lens(Lens::Pinhole).map_err(|_| ExportError::NoFrustum("no lens"))?;
        let frustum = Frustum::new(ideal);
        let seen = Description::of(&frustum);
        let position_m = seen.position_m.ok_or(ExportError::NoFrustum("its rays are parallel"))?;
        if seen.middle.is_some_and(|middle| middle.mirrored) {
            return Err(ExportError::NoFrustum("its image is mirrored"));
        }
        let size_px = calibration.resolution_px().as_dvec2();
        let corners_px = [DVec2::ZERO, DVec2::new(size_px.x, 0.0), DVec2::new(0.0, size_px.y), size_px];
        let hidden = ExportError::NoFrustum("a part of its image has no ray");
        let corners: Option<Vec<DVec3>> = corners_px.iter().map(|at| Some(frustum.ray(*at)?.direction)).collect();
        let corners: [DVec3; 4] = corners.and_then(|all| all.try_into().ok()).ok_or(hidden)?;

        // The frame of an image plane at distance 1 before the eye: what is ahead, and which way its rows and columns run.
        // Where these are at no right angle, both give way alike.
        let ahead = seen.axis;
        let on_plane = corners.map(|direction| direction / direction.dot(ahead));
        let along_rows = (on_plane[1] - on_plane[0] + on_plane[3] - on_plane[2]).normalize();
        let along_columns = (on_plane[0] - on_plane[2] + on_plane[1] - on_plane[3]).normalize();
        let right = (along_rows + ahead.cross(along_columns)).normalize();
        let up = right.cross(ahead);

        // The rectangle whose sides are where those of the image are on average.
        let places = on_plane.map(|at| DVec2::new(at.dot(right), at.dot(up)));
        let [left_top, right_top, left_bottom, right_bottom] = places;
        let (left, right_side) = ((left_top.x + left_bottom.x) * 0.5, (right_top.x + right_bottom.x) * 0.5);
        let (top, bottom) = ((left_top.y + right_top.y) * 0.5, (left_bottom.y + right_bottom.y) * 0.5);
        let pixel = DVec2::new(right_side - left, top - bottom) / size_px;
        let rectangle = [(left, top), (right_side, top), (left, bottom), (right_side, bottom)].map(DVec2::from);
        let off_px: [f64; 4] = std::array::from_fn(|i| ((places[i] - rectangle[i]) / pixel).length());
        // Written so that a NaN is refused too.
        let is_rectangle = off_px.iter().all(|off_px| *off_px <= FRUSTUM_WITHIN_PX);
        let off_px = off_px.into_iter().fold(0.0, f64::max);
        if !is_rectangle {
            return Err(ExportError::NotRectangular { off_px });
        }
        let world_from_view = DMat3::from_cols(right, up, -ahead);
        let (yaw, pitch, roll) = world_from_view.to_euler(EulerRot::YXZ);
        let angle = |tangent: f64| tangent.atan().to_degrees();
        Ok(Self {
            position_m,
            turn_deg: [-yaw, pitch, -roll].map(f64::to_degrees),
            angles_deg: [angle(left), angle(right_side), angle(top), angle(bottom)],
            off_px,
        })
    }
}

fn document(shape: &Shape, size_px: UVec2, region: &str, files: &str) -> String {
    let [left, right, up, down] = shape.angles_deg;
    let [yaw, pitch, roll] = shape.turn_deg;
    let id: String = region.chars().map(|c| if "<>&\"'".contains(c) { '_' } else { c }).collect();
    let UVec2 { x: columns, y: rows } = size_px;
    let mut frustum = String::new();
    let frame_axes = [("yaw", [0.0, -1.0, 0.0]), ("pitch", [1.0, 0.0, 0.0]), ("roll", [0.0, 0.0, -1.0])];
    let angles = [("rightAngle", right), ("leftAngle", left), ("upAngle", up), ("downAngle", down)];
    for (name, value) in [("yaw", yaw), ("pitch", pitch), ("roll", roll)].into_iter().chain(angles) {
        // Writing into a String cannot fail; shortest digits that read back to the same number.
        let _ = writeln!(frustum, "          <{name}>{value:?}</{name}>");
    }
    let mut frame = String::new();
    for (axis, value) in ["x", "y", "z"].into_iter().zip(shape.position_m.to_array()) {
        let _ = writeln!(frame, "          <pos{axis}>{value:?}</pos{axis}>");
    }
    for (name, vector) in frame_axes {
        for (axis, value) in ["x", "y", "z"].into_iter().zip(vector) {
            let _ = writeln!(frame, "          <{name}{axis}>{value:?}</{name}{axis}>");
        }
    }
    let files = if files.is_empty() {
        String::new()
    } else {
        format!("  <files>\n    <fileset region=\"{id}\">\n{files}    </fileset>\n  </files>\n")
    };
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<!-- Lengths are metres. -->\n\
         <MPCDI profile=\"3d\" geometry=\"1\" color=\"1\" version=\"2.0\">\n  <display>\n    <buffer id=\"0\">\n      \
         <region id=\"{id}\" xResolution=\"{columns}\" yResolution=\"{rows}\" x=\"0\" y=\"0\" xsize=\"1\" ysize=\"1\">\n        \
         <frustum>\n{frustum}        </frustum>\n        <coordinateFrame>\n{frame}        </coordinateFrame>\n      </region>\n    \
         </buffer>\n  </display>\n{files}</MPCDI>\n"
    )
}

/// The ideal place of each pixel's middle, in shares of the image.
fn warp(frustum: &Frustum, size_px: UVec2) -> Pfm {
    let optics = frustum.calibration().optics();
    let place = |index: u32| {
        let centre_px = UVec2::new(index % size_px.x, index / size_px.x).as_dvec2() + 0.5;
        let ideal_px = optics.ideal_px(centre_px);
        ideal_px.map_or(Vec3::NAN, |ideal_px| (ideal_px / size_px.as_dvec2()).extend(0.0).as_vec3())
    };
    Pfm { size: size_px, pixels: (0..size_px.element_product()).map(place).collect() }
}

/// Linear values in 16 bits.
fn picture(map: &Map) -> Result<Vec<u8>, ImageError> {
    let value = |x: u32, y: u32| {
        let value = map.values[(y * map.size.x + x) as usize];
        // From 0 to 1, as every map is, so it stays in range.
        Rgb((value * f32::from(u16::MAX)).round().to_array().map(|value| value as u16))
    };
    let mut bytes = Cursor::new(Vec::new());
    ImageBuffer::<Rgb<u16>, Vec<u16>>::from_fn(map.size.x, map.size.y, value).write_to(&mut bytes, ImageFormat::Png)?;
    Ok(bytes.into_inner())
}
