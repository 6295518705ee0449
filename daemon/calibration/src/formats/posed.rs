//! What every format comes to: a camera of OpenCV's kind, where the file's world has it.

use std::sync::Arc;

use glam::{DMat3, DMat4, DVec2, DVec3, UVec2, Vec2};
use lantern_config::Unit;

use super::FileError;
use super::context::Context;
use crate::clip::dmat4_from_rows;
use crate::{BrownConrady, Calibration, Convention, Lens, Maps, Matrix4, Warp};

/// Nearer to its lens no projector is in focus.
const NEAR_M: f64 = 0.1;

/// How far the axes of a rotation may be from unit length and right angles: files have as few as four digits.
const ROTATION_WITHIN: f64 = 2e-3;

/// A projector as a file has it. Pixels are continuous: the middle of the first one is at ½.
pub(super) struct Posed {
    /// The image that the other numbers count.
    pub(super) size_px: UVec2,
    pub(super) focal_px: DVec2,
    /// Where the optical axis meets the image.
    pub(super) centre_px: DVec2,
    /// x right, y down, z forward, from the file's world; lengths in the file's unit.
    pub(super) view_from_file: DMat4,
    /// Of the file's lengths, where it states one.
    pub(super) unit: Option<Unit>,
    /// In the file's unit, where it states them.
    pub(super) near: Option<f64>,
    pub(super) far: Option<f64>,
    pub(super) image: Image,
}

/// What a file says of the image itself.
#[derive(Default)]
pub(super) struct Image {
    pub(super) lens: FileLens,
    pub(super) maps: Maps,
}

/// What stands between the ideal image and the real one, at any resolution.
#[derive(Default)]
pub(super) enum FileLens {
    #[default]
    Pinhole,
    /// k1, k2, p1, p2, k3 about the principal point, in focal lengths.
    BrownConrady([f64; 5]),
    /// The place of each node in the ideal image, in shares of its sides from the top left corner; NaN: no light.
    Warp { size: UVec2, places: Vec<Vec2> },
}

impl Posed {
    /// A calibration for the projector's own image, in our world.
    pub(super) fn calibration(&self, context: &Context<'_>) -> Result<Calibration, FileError> {
        let file = context.file;
        let (rotation, translation) = (DMat3::from_mat4(self.view_from_file), self.view_from_file.w_axis.truncate());
        check_rotation(rotation)?;
        let has_lengths = translation != DVec3::ZERO || self.near.is_some() || self.far.is_some();
        let unit_m = if has_lengths { context.unit_m(self.unit)? } else { 1.0 };

        // The frame of the file may be scaled to ours; the view is not, so that its z stays a distance in metres.
        let world_from_file = dmat4_from_rows(&file.world_from_file);
        let scale = world_from_file.x_axis.truncate().length();
        let view = affine(rotation, translation * unit_m) * world_from_file.inverse();
        let turned = DMat3::from_mat4(view) * scale;
        if turned.determinant() < 0.0 {
            return Err(left_handed(rotation.determinant() < 0.0));
        }
        let view = affine(turned, view.w_axis.truncate() * scale);

        let stated_m = |length: Option<f64>| length.map(|length| length * unit_m * scale);
        let near_m = file.near_m.or(stated_m(self.near)).unwrap_or(NEAR_M);
        let far_m = file.far_m.or(stated_m(self.far));
        check_planes(near_m, far_m)?;

        let convention = file.convention.into();
        let projection = self.projection(near_m, far_m, convention);
        let rows = |m: DMat4| -> Matrix4 { std::array::from_fn(|row| m.row(row).to_array()) };
        let calibration = Calibration::from_matrices(&projection, &rows(view), convention, context.resolution_px)?;
        Ok(calibration.with_lens(self.lens(context.resolution_px))?.with_maps(self.image.maps.clone())?)
    }

    /// The lens, in pixels of an image of this size.
    fn lens(&self, resolution_px: UVec2) -> Lens {
        let size_px = resolution_px.as_dvec2();
        match &self.image.lens {
            FileLens::Pinhole => Lens::Pinhole,
            FileLens::BrownConrady(coefficients) if coefficients.iter().all(|c| *c == 0.0) => Lens::Pinhole,
            FileLens::BrownConrady([k1, k2, p1, p2, k3]) => {
                let scale = size_px / self.size_px.as_dvec2();
                let (focal_px, centre_px) = (self.focal_px * scale, self.centre_px * scale);
                Lens::BrownConrady(BrownConrady { focal_px, centre_px, k1: *k1, k2: *k2, p1: *p1, p2: *p2, k3: *k3 })
            }
            FileLens::Warp { size, places } => {
                let ideal_px = places.iter().map(|place| *place * size_px.as_vec2()).collect();
                Lens::Warp(Arc::new(Warp { size: *size, ideal_px }))
            }
        }
    }

    /// Clip from view. The image's two sides go to −1 and 1, so it holds at any resolution of the same shape.
    fn projection(&self, near_m: f64, far_m: Option<f64>, convention: Convention) -> Matrix4 {
        let size_px = self.size_px.as_dvec2();
        let scale = self.focal_px * 2.0 / size_px;
        let shift = self.centre_px * 2.0 / size_px - 1.0;
        let y = convention.y_sign();

        // z from near to far becomes (depth · z + base) / z from the convention's first limit to its second.
        let [first, second] = convention.depth_limits();
        let (depth, base) = match far_m {
            None => (second, (first - second) * near_m),
            Some(far_m) => {
                let base = (first - second) * near_m * far_m / (far_m - near_m);
                (second - base / far_m, base)
            }
        };
        [
            [scale.x, 0.0, shift.x, 0.0],
            [0.0, y * scale.y, y * shift.y, 0.0],
            [0.0, 0.0, depth, base],
            [0.0, 0.0, 1.0, 0.0],
        ]
    }
}

/// That the axes are those of a rotation, or of one that mirrors.
fn check_rotation(rotation: DMat3) -> Result<(), FileError> {
    let off = (rotation.transpose() * rotation - DMat3::IDENTITY).to_cols_array();
    let worst = off.iter().fold(0.0, |worst: f64, entry| worst.max(entry.abs()));
    // Written so that a NaN is refused too.
    if worst <= ROTATION_WITHIN {
        return Ok(());
    }
    Err(FileError::Wrong {
        key: "file",
        message: format!("its rotation is none: axes are off unit length or right angles by {worst:.3}"),
        hint: "look whether it was written whole, and in the order that `order` says".to_owned(),
    })
}

fn left_handed(by_the_file: bool) -> FileError {
    let mirror = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]";
    let (key, hint) = if by_the_file {
        ("file", format!("if its world is left-handed (Unity, Unreal), set world_from_file = {mirror}"))
    } else {
        (
            "world_from_file",
            "world_from_file mirrors a world that is right-handed already: negate one of its columns".to_owned(),
        )
    };
    FileError::Wrong { key, message: "left-handed: its axes mirror the world, as no projector's do".to_owned(), hint }
}

fn check_planes(near_m: f64, far_m: Option<f64>) -> Result<(), FileError> {
    let good = near_m > 0.0 && near_m.is_finite() && far_m.is_none_or(|far_m| far_m > near_m);
    if good {
        return Ok(());
    }
    let far = far_m.map_or("infinity".to_owned(), |far_m| format!("{far_m} m"));
    Err(FileError::Wrong {
        key: "near_m",
        message: format!("its near plane is at {near_m} m and its far plane at {far}"),
        hint: "set near_m and far_m, so that the props lie between".to_owned(),
    })
}

/// A point is turned first and moved then.
pub(super) fn affine(rotation: DMat3, translation: DVec3) -> DMat4 {
    let axis = |i| rotation.col(i).extend(0.0);
    DMat4::from_cols(axis(0), axis(1), axis(2), translation.extend(1.0))
}

/// The y and z axes of OpenGL's cameras, which look along −z with y up, to ours; its own inverse.
pub(super) const FROM_OPENGL: DVec3 = DVec3::new(1.0, -1.0, -1.0);
