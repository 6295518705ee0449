//! Where a projector stands beside the props.

use glam::{DMat4, DVec4};
use lantern_config::Calibration as Configured;

use super::units::wrong_units;
use super::{Ailment, Finding, Patient, Props};
use crate::Calibration;
use crate::clip::dmat4_from_rows;

/// Beyond the image by so much of it, for the sake of lenses, a box is certainly not in it.
const BESIDE: f64 = 1.25;

/// The first of what can be said of its place: one makes the next.
pub(super) fn place(patient: &Patient<'_>, props: Option<&Props>) -> Option<Finding> {
    if let Some(finding) = wrong_units(patient, props) {
        return Some(finding);
    }
    let props = props?;
    near_plane_behind(patient, props).or_else(|| {
        outside(patient.calibration, props)
            .then(|| nothing_in_view(patient.configured, patient.calibration, Some(props)))
    })
}

/// Clip space of the corners that are ahead.
fn ahead(calibration: &Calibration, props: &Props) -> Vec<DVec4> {
    let corners = props.corners_m().map(|corner_m| calibration.clip_from_world() * corner_m.extend(1.0));
    corners.into_iter().filter(|corner| corner.w > 0.0).collect()
}

fn near_plane_behind(patient: &Patient<'_>, props: &Props) -> Option<Finding> {
    let (seen, calibration) = (&patient.seen, patient.calibration);
    let (middle, stands_m) = (seen.middle?, seen.position_m?);
    let ahead = ahead(calibration, props);
    let window_z = |corner: &DVec4| calibration.convention().window_z(corner.z / corner.w);
    let is_before = |corner: &DVec4| if seen.reversed_depth { window_z(corner) > 1.0 } else { window_z(corner) < 0.0 };
    if ahead.is_empty() || !ahead.iter().all(is_before) {
        return None;
    }
    let farthest_m =
        props.corners_m().into_iter().map(|corner_m| (corner_m - stands_m).dot(seen.axis)).fold(0.0, f64::max);
    let near_m = middle.near_m * middle.direction.dot(seen.axis);
    let (key, remedy) = match patient.configured {
        Configured::Matrices(_) => {
            ("projection", format!("make `projection` with a near plane of less than {farthest_m:.2} m"))
        }
        Configured::File(_) => ("near_m", format!("set near_m to less than {farthest_m:.2}")),
    };
    Some(Finding {
        ailment: Ailment::NearPlaneBehindProps,
        certain: false,
        key,
        message: format!(
            "near plane behind the props: it is {near_m:.2} m away, and the farthest of them {farthest_m:.2} m"
        ),
        hint: format!("{remedy}; look as well whether its unit is that of `view`"),
    })
}

/// Whether a box lies wholly on the far side of one side of the image, or behind the projector.
fn outside(calibration: &Calibration, props: &Props) -> bool {
    let corners = props.corners_m().map(|corner_m| calibration.clip_from_world() * corner_m.extend(1.0));
    let sides: [fn(&DVec4) -> f64; 5] = [
        |corner| corner.w,
        |corner| BESIDE * corner.w - corner.x,
        |corner| BESIDE * corner.w + corner.x,
        |corner| BESIDE * corner.w - corner.y,
        |corner| BESIDE * corner.w + corner.y,
    ];
    sides.iter().any(|side| corners.iter().all(|corner| side(corner) <= 0.0))
}

/// That no prop is in the image, and what may be the reason: another calibration that differs by one of the usual mistakes
/// and would see them.
pub fn nothing_in_view(configured: &Configured, calibration: &Calibration, props: Option<&Props>) -> Finding {
    let message = "nothing in view: it sees no prop and will stay black".to_owned();
    let guess = props.and_then(|props| guess(configured, calibration, props));
    let (key, hint) = guess.unwrap_or_else(|| {
        (
            "",
            "compare its position and direction, as `lanternd check` tells them, with where the props stand".to_owned(),
        )
    });
    Finding { ailment: Ailment::NothingInView, certain: false, key, message, hint }
}

fn guess(configured: &Configured, calibration: &Calibration, props: &Props) -> Option<(&'static str, String)> {
    let sees = |clip_from_world: DMat4| {
        let at = clip_from_world * props.middle_m().extend(1.0);
        at.w > 0.0 && at.x.abs() <= at.w && at.y.abs() <= at.w
    };
    let turned = DMat4::from_diagonal(DVec4::new(1.0, -1.0, -1.0, 1.0));
    match configured {
        Configured::Matrices(matrices) => {
            let (projection, view) = (dmat4_from_rows(&matrices.projection), dmat4_from_rows(&matrices.view));
            if sees(projection * view.inverse()) {
                let hint = "its inverse would see the props: `view` is eye from world, and a pose is world from eye";
                return Some(("view", hint.to_owned()));
            }
            if sees(projection * turned * view) {
                let hint = "it looks the other way: OpenCV's eye looks along +z with y down, OpenGL's along -z with y up; \
                            negate the second and third row of `view`";
                return Some(("view", hint.to_owned()));
            }
            None
        }
        // Where the frame was turned already, another turn is nobody's guess.
        Configured::File(file) if dmat4_from_rows(&file.world_from_file) != DMat4::IDENTITY => None,
        Configured::File(_) => {
            let clip_from_world = calibration.clip_from_world();
            let z_up = DMat4::from_cols(DVec4::X, DVec4::Z, -DVec4::Y, DVec4::W);
            let tries = [
                (z_up, "[[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]", "z up"),
                (turned, "[[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]", "y down"),
            ];
            let found = tries.into_iter().find(|(file_from_world, ..)| sees(clip_from_world * *file_from_world));
            found.map(|(_, rows, up)| {
                (
                    "world_from_file",
                    format!("it would see the props if its world had {up}: set world_from_file = {rows}"),
                )
            })
        }
    }
}
