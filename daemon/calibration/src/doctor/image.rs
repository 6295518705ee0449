//! The image: mirrored, of another resolution, off its axis.

use glam::{DMat3, DMat4, DVec2, DVec3, UVec2};
use lantern_config::{Calibration as Configured, Format};

use super::{Ailment, Finding, Patient};
use crate::Convention;
use crate::formats::have_same_shape;

/// How far lenses shift, in widths and heights of the image, from its middle to the axis. Ultra-short-throw lenses have their
/// axis one and a half heights below.
const SHIFT_WITHIN: DVec2 = DVec2::new(0.6, 1.5);

/// How far below the horizon the top of an image points that is upside down; one that looks straight down has no top.
const UPSIDE_DOWN: f64 = 0.2;

/// Where the sides of pixels are off a right angle by more, a homography or a shear is in the matrix, and neither aspect nor
/// axis mean what they mean of a lens.
const RIGHT_ANGLE_WITHIN: f64 = 1e-5;

/// Pixels are believed to be square to this: calibrations are off by 2 %.
const SQUARE_WITHIN: f64 = 0.04;

/// How near an aspect or a size must be to one that is common.
const COMMON_WITHIN: f64 = 0.01;

/// What to do about an image of another shape.
const ANOTHER_RESOLUTION: &str = "set resolution_px to the resolution that was calibrated, or calibrate at this one";

/// Width by height of what projectors show.
const COMMON_PX: [[u32; 2]; 14] = [
    [1920, 1080],
    [1920, 1200],
    [1024, 768],
    [1280, 1024],
    [4096, 2160],
    [1400, 1050],
    [1600, 1200],
    [1280, 720],
    [1280, 800],
    [2560, 1600],
    [3840, 2160],
    [800, 600],
    [2560, 1080],
    [854, 480],
];

/// An image that is the wrong way round.
pub(super) fn mirrored(patient: &Patient<'_>) -> Option<Finding> {
    let middle = patient.seen.middle.filter(|middle| middle.mirrored)?;
    let finding = |ailment, key, message: &str, hint: String| {
        Some(Finding { ailment, certain: false, key, message: message.to_owned(), hint })
    };
    let Configured::Matrices(matrices) = patient.configured else {
        let hint = "keep it for a rear projection; else look which way x and y run in the file".to_owned();
        return finding(Ailment::Mirrored, "file", "mirrored: the image is the wrong way round", hint);
    };
    let negate_z = "its world is one of Unity, Unreal or Direct3D: negate the third column of `view`; keep it where a \
                    mirror stands in the beam";
    if DMat3::from_mat4(DMat4::from_cols_array_2d(&matrices.view)).determinant() < 0.0 {
        let message = "left-handed: `view` mirrors the world, and so the image";
        return finding(Ailment::LeftHanded, "view", message, negate_z.to_owned());
    }
    // Upside down as well: y runs the other way. A projector that hangs from the ceiling is turned, not mirrored.
    if middle.up.y < -UPSIDE_DOWN {
        let other = match patient.calibration.convention() {
            Convention::OpenGl => "vulkan",
            Convention::Vulkan => "opengl",
        };
        let message = "mirrored: the image is upside down and the wrong way round, as where y runs the other way";
        return finding(Ailment::Mirrored, "convention", message, format!("set convention = \"{other}\""));
    }
    let [x, y, _, w] = matrices.projection;
    if x[0] > 0.0 && y[1] * -patient.calibration.convention().y_sign() > 0.0 && w[2] > 0.0 {
        let message = "left-handed: `projection` looks along +z with x to the right and y up, and so mirrors the image";
        return finding(Ailment::LeftHanded, "projection", message, negate_z.to_owned());
    }
    let hint = "keep it for a rear projection; else negate the first row of `projection`, or set the other convention";
    let hint = hint.to_owned();
    finding(Ailment::Mirrored, "projection", "mirrored: the image is the wrong way round", hint)
}

/// Half the image's sides in focal lengths turned over: focal lengths in half images, across and upright. `None` where the
/// matrix is no lens's: parallel rays, a homography, a shear.
fn focal(patient: &Patient<'_>) -> Option<DVec2> {
    patient.seen.position_m?;
    let clip_from_world = patient.calibration.clip_from_world();
    let row = |i: usize| clip_from_world.row(i).truncate();
    let (w, axis) = (row(3).length(), row(3).normalize_or_zero());
    let [across, upright]: [DVec3; 2] = [0, 1].map(|i| row(i).reject_from_normalized(axis) / w);
    let slant = across.normalize_or_zero().dot(upright.normalize_or_zero());
    (slant.abs() < RIGHT_ANGLE_WITHIN).then(|| DVec2::new(across.length(), upright.length()))
}

/// Matrices of an image of another shape: only then are the pixels of a projector not square.
pub(super) fn pixels_not_square(patient: &Patient<'_>) -> Option<Finding> {
    let size = patient.seen.resolution_px.as_dvec2();
    let focal_px = focal(patient)? * size * 0.5;
    let ratio = focal_px.x / focal_px.y;
    let near = |a: f64, b: f64, within: f64| (a / b - 1.0).abs() < within;
    if near(ratio, 1.0, SQUARE_WITHIN) {
        return None;
    }
    let aspect = |[width, height]: [u32; 2]| f64::from(width) / f64::from(height);
    let upright = COMMON_PX.map(|[width, height]| [height, width]);
    let made_for = COMMON_PX
        .into_iter()
        .chain(upright)
        .find(|size_px| near(size.x / size.y / ratio, aspect(*size_px), COMMON_WITHIN))?;
    Some(Finding {
        ailment: Ailment::WrongResolution,
        certain: false,
        key: key_of(patient, "projection"),
        message: format!(
            "wrong resolution: at {} × {} its pixels are {:.2} times as wide as high, as those of a calibration for {} × {} are",
            size.x,
            size.y,
            1.0 / ratio,
            made_for[0],
            made_for[1]
        ),
        hint: ANOTHER_RESOLUTION.to_owned(),
    })
}

/// An OpenCV file whose axis is in the middle of another common image: only there does the unit of the image come from the
/// configuration.
pub(super) fn made_for_another_image(patient: &Patient<'_>) -> Option<Finding> {
    let Configured::File(file) = patient.configured else { return None };
    if file.format != Format::OpenCv || file.resolution_px.is_some() {
        return None;
    }
    let size = patient.seen.resolution_px;
    let axis_px = axis_px(patient)?;
    let is_middle = |of: UVec2| (axis_px / (of.as_dvec2() * 0.5) - 1.0).abs().max_element() < 2.0 * COMMON_WITHIN;
    let made_for = COMMON_PX.map(UVec2::from).into_iter().find(|of| *of != size && is_middle(*of))?;
    if is_middle(size) {
        return None;
    }
    Some(Finding {
        ailment: Ailment::WrongResolution,
        certain: false,
        key: "file",
        message: format!(
            "wrong resolution: its axis is at ({:.0}, {:.0}) px, which is the middle of {} × {} and not of {} × {}",
            axis_px.x, axis_px.y, made_for.x, made_for.y, size.x, size.y
        ),
        // Beside `file` only an image of the projector's own shape is taken.
        hint: if have_same_shape(made_for, size) {
            format!("if it was made for that image, set resolution_px = [{}, {}] beside `file`", made_for.x, made_for.y)
        } else {
            ANOTHER_RESOLUTION.to_owned()
        },
    })
}

/// Where the optical axis meets the ideal image, px.
fn axis_px(patient: &Patient<'_>) -> Option<DVec2> {
    let size = patient.seen.resolution_px.as_dvec2();
    patient.seen.lens_shift.map(|shift| size * (0.5 - DVec2::new(shift.x, -shift.y)))
}

/// An axis farther off than lenses shift.
pub(super) fn principal_point_outside(patient: &Patient<'_>) -> Option<Finding> {
    focal(patient)?;
    let shift = patient.seen.lens_shift?;
    if shift.abs().cmple(SHIFT_WITHIN).all() {
        return None;
    }
    let (axis_px, size) = (axis_px(patient)?, patient.seen.resolution_px);
    Some(Finding {
        ailment: Ailment::PrincipalPointOutside,
        certain: false,
        key: key_of(patient, "projection"),
        message: format!(
            "principal point outside: the axis is at ({:.0}, {:.0}) px of an image of {} × {}",
            axis_px.x, axis_px.y, size.x, size.y
        ),
        hint: "look whether cx and cy are in pixels of this resolution, and not swapped".to_owned(),
    })
}

fn key_of(patient: &Patient<'_>, of_matrices: &'static str) -> &'static str {
    match patient.configured {
        Configured::Matrices(_) => of_matrices,
        Configured::File(_) => "file",
    }
}
