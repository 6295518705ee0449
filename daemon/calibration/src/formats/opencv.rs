//! OpenCV FileStorage: a camera matrix, its distortion, and where it stands.
//!
//! x right, y down, z forward; pixels count from the middle of the first one, so that continuous pixels are ½ more;
//! x_projector = R · x_world + T. Distortion is that of Brown and Conrady: k1, k2, p1, p2, k3.

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3, UVec2};
use lantern_config::{Order, Unit};

use super::FileError;
use super::context::Context;
use super::posed::{FileLens, Image, Posed, affine};
use super::storage::{self, FORMAT, Matrix, Node};
use super::text::{malformed, text};
use crate::clip::dmat4_from_rows;

/// What a program calls the parts of a calibration.
struct KeySet {
    matrix: &'static str,
    distortion: &'static str,
    rotation: &'static [&'static str],
    translation: &'static [&'static str],
}

/// Met in the wild: procam-calibration (which misspells rotation), procamcalib, and OpenCV's own sample, which stores no one
/// pose and therefore has none of its own names for it.
const KEY_SETS: [KeySet; 3] = [
    KeySet {
        matrix: "proj_int",
        distortion: "proj_dist",
        rotation: &["roration", "rotation"],
        translation: &["translation"],
    },
    KeySet { matrix: "proj_K", distortion: "proj_kc", rotation: &["R"], translation: &["T"] },
    KeySet {
        matrix: "camera_matrix",
        distortion: "distortion_coefficients",
        rotation: &["R", "rotation", "rvec"],
        translation: &["T", "translation", "tvec"],
    },
];

/// Reads a projector.
pub(super) fn read(bytes: &[u8], context: &Context<'_>) -> Result<Posed, FileError> {
    let root = storage::parse(text(bytes, FORMAT)?)?;
    let (node, keys) = projector(&root, context)?;

    // The image is the file's own where it says which; a camera's beside it is another image.
    let side = |name| node.get(name).map(|side| side.count(name)).transpose();
    let stated_px = match (side("image_width")?, side("image_height")?) {
        (Some(width), Some(height)) => Some(UVec2::new(width, height)),
        _ => None,
    };
    let size_px = context.size_px(stated_px)?;

    let order = context.file.order;
    let (focal_px, centre_px) = intrinsics(&needed(node, keys.matrix)?.matrix(keys.matrix)?, keys.matrix, order)?;
    let distortion = node
        .get(keys.distortion)
        .map(|found| distortion(&found.matrix(keys.distortion)?, keys.distortion))
        .transpose()?;
    let image = Image { lens: distortion.map_or(FileLens::Pinhole, FileLens::BrownConrady), ..Image::default() };
    let (view_from_file, unit) = pose(node, keys, context)?;
    Ok(Posed { size_px, focal_px, centre_px, view_from_file, unit, near: None, far: None, image })
}

/// The map that has a key set, and which: the whole file, or one of several maps in it by name.
fn projector<'a>(root: &'a Node, context: &Context<'_>) -> Result<(&'a Node, &'static KeySet), FileError> {
    let key_set = |node: &Node| KEY_SETS.iter().find(|keys| node.get(keys.matrix).is_some());
    if context.file.entry.is_none()
        && let Some(keys) = key_set(root)
    {
        return Ok((root, keys));
    }
    let all: Vec<_> = root.maps().filter_map(|(name, node)| Some((name.to_owned(), (node, key_set(node)?)))).collect();
    if all.is_empty() && context.file.entry.is_none() {
        let known = KEY_SETS.map(|keys| keys.matrix).join(", ");
        return Err(malformed(FORMAT, format!("there is no camera matrix in it: none of {known}")));
    }
    context.entry("projector", all)
}

fn needed<'a>(node: &'a Node, name: &str) -> Result<&'a Node, FileError> {
    node.get(name).ok_or_else(|| malformed(FORMAT, format!("there is no {name} in it")))
}

/// Focal lengths and principal point, in continuous pixels.
fn intrinsics(matrix: &Matrix, name: &str, order: Order) -> Result<(DVec2, DVec2), FileError> {
    let rows = square(matrix, name, order)?;
    let wrong = |message: String, hint: &str| FileError::Wrong { key: "file", message, hint: hint.to_owned() };
    let [[fx, skew, cx], [below, fy, cy], last] = rows;
    if (cx, cy) == (0.0, 0.0) && (last[0], last[1]) != (0.0, 0.0) {
        let (now, then) = match order {
            Order::Row => ("row", "column"),
            Order::Column => ("column", "row"),
        };
        let message =
            format!("{name} looks transposed: the principal point is in the last row; set order = \"{then}\"");
        return Err(wrong(message, &format!("matrices are read {now} by {now}")));
    }
    if last != [0.0, 0.0, 1.0] || below != 0.0 {
        let hint = "its rows must be fx 0 cx, 0 fy cy, 0 0 1, in pixels";
        return Err(wrong(format!("{name} is no camera matrix"), hint));
    }
    if skew.abs() > 1e-6 * fx.abs() {
        let hint = "calibrate without skew, as OpenCV does";
        return Err(wrong(format!("{name} has a skew of {skew}, which is not built"), hint));
    }
    if !(fx > 0.0 && fy > 0.0) {
        let hint = "focal lengths are above 0, in pixels; a mirrored image is told by `projection` and `view`";
        return Err(wrong(format!("{name} has focal lengths of {fx} and {fy}"), hint));
    }
    Ok((DVec2::new(fx, fy), DVec2::new(cx, cy) + 0.5))
}

/// k1, k2, p1, p2, k3, as many as there are.
fn distortion(matrix: &Matrix, name: &str) -> Result<[f64; 5], FileError> {
    let more = matrix.data.iter().skip(5).any(|coefficient| *coefficient != 0.0);
    if more {
        return Err(FileError::Wrong {
            key: "file",
            message: format!("{name} has coefficients beyond k1, k2, p1, p2 and k3, which are not built"),
            hint: "calibrate without CALIB_RATIONAL_MODEL, CALIB_THIN_PRISM_MODEL and CALIB_TILTED_MODEL".to_owned(),
        });
    }
    Ok(std::array::from_fn(|i| matrix.data.get(i).copied().unwrap_or(0.0)))
}

/// x right, y down, z forward from the file's world; and the unit of its lengths, where it is known.
fn pose(node: &Node, keys: &KeySet, context: &Context<'_>) -> Result<(DMat4, Option<Unit>), FileError> {
    let found = |names: &'static [&'static str]| names.iter().find_map(|name| Some((*name, node.get(name)?)));
    match (found(keys.rotation), found(keys.translation), &context.file.view) {
        (Some((name, _)), _, Some(_)) | (None, Some((name, _)), Some(_)) => Err(FileError::Contradicted {
            key: "view",
            file: format!("where it stands ({name})"),
            config: "so as well".to_owned(),
        }),
        (Some((rotation_name, rotation_node)), Some((translation_name, translation)), None) => {
            let rotation = rotation(&rotation_node.matrix(rotation_name)?, rotation_name, context.file.order)?;
            let translation = translation.matrix(translation_name)?;
            let [x, y, z] = vector(&translation, translation_name)?;
            Ok((affine(rotation, DVec3::new(x, y, z)), None))
        }
        // In metres, as all that the configuration says. The file has no other length, so any unit of its own will do.
        (None, None, Some(view)) => {
            let view = dmat4_from_rows(view);
            let unit = context.file.unit.unwrap_or(Unit::Metre);
            Ok((affine(DMat3::from_mat4(view), view.w_axis.truncate() / unit.metres()), Some(unit)))
        }
        (None, _, None) | (Some(_), None, None) => Err(FileError::Unsaid {
            what: format!("where the projector stands (no {} and {})", keys.rotation[0], keys.translation[0]),
            key: "view",
            example: "[[…], […], […], […]], which is [R | T] of OpenCV in metres".to_owned(),
        }),
    }
}

/// A rotation matrix, or the vector of an axis as long as the angle.
fn rotation(matrix: &Matrix, name: &str, order: Order) -> Result<DMat3, FileError> {
    if matrix.rows * matrix.columns == 3 {
        return Ok(DMat3::from_quat(DQuat::from_scaled_axis(DVec3::from_array(vector(matrix, name)?))));
    }
    Ok(DMat3::from_cols_array_2d(&square(matrix, name, order)?).transpose())
}

/// Three rows of three.
fn square(matrix: &Matrix, name: &str, order: Order) -> Result<[[f64; 3]; 3], FileError> {
    if (matrix.rows, matrix.columns) != (3, 3) {
        return Err(malformed(FORMAT, format!("{name} is {} × {}, not 3 × 3", matrix.rows, matrix.columns)));
    }
    Ok(std::array::from_fn(|row| {
        std::array::from_fn(|column| match order {
            Order::Row => matrix.data[row * 3 + column],
            Order::Column => matrix.data[column * 3 + row],
        })
    }))
}

fn vector(matrix: &Matrix, name: &str) -> Result<[f64; 3], FileError> {
    let numbers = <[f64; 3]>::try_from(matrix.data.as_slice());
    numbers.map_err(|_| malformed(FORMAT, format!("{name} has {} numbers, not 3", matrix.data.len())))
}
