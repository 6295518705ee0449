//! Clip space: which way is up, where the near limit lies, and the matrix that leads there; with it, what makes a
//! calibration: lens, brightness and pixels.

use std::sync::Arc;

use glam::{DMat4, DVec2, DVec4, UVec2};

pub use lantern_config::Matrix4;

use crate::lens::{Lens, LensError, Optics};
use crate::maps::{Maps, MapsError};

/// A determinant this small beside Hadamard's bound (the product of the row lengths, columns scaled to a largest entry of
/// one first) leaves no digit of the inverse. A frustum whose far plane is a million times as far as its near one, a
/// thousand kilometres from the world's origin, is still at 1e-6.
const SINGULAR_BELOW: f64 = 1e-13;

/// Beside the largest w of the clip cube's corners, one below this is at infinity.
const INFINITE_BELOW: f64 = 1e-12;

/// Why a pair of matrices is no calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// A number that is NaN or infinite.
    #[error(
        "the {matrix} matrix has {value} at row {row}, column {column}; hint: every entry must be a finite number, \
         written row by row"
    )]
    NotFinite {
        /// `projection` or `view`.
        matrix: &'static str,
        /// From 0.
        row: usize,
        /// From 0.
        column: usize,
        /// What stands there.
        value: f64,
    },
    /// A matrix that flattens space.
    #[error(
        "the {matrix} matrix is singular (determinant {determinant:e}), so its pixels have no rays; hint: {hint}",
        hint = singular_hint(matrix)
    )]
    Singular {
        /// `projection`, `view`, or `projection · view`.
        matrix: &'static str,
        /// Its determinant.
        determinant: f64,
    },
    /// No pixels.
    #[error("the resolution is {width} × {height} pixels; hint: both sides must be at least 1")]
    NoPixels {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// A lens without an inverse over the image.
    #[error(transparent)]
    Lens(#[from] LensError),
    /// Alpha or beta maps that are none.
    #[error(transparent)]
    Maps(#[from] MapsError),
}

fn singular_hint(matrix: &str) -> &'static str {
    match matrix {
        "view" => "its upper left 3 × 3 must be a rotation, its last row 0 0 0 1",
        _ => "its rows must be independent, and near and far must differ",
    }
}

/// The two clip spaces: they differ in which way is up and in where depth begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Convention {
    /// y = +1 is the top row; z from −1 to 1.
    OpenGl,
    /// y = −1 is the top row; z from 0 to 1.
    Vulkan,
}

impl Convention {
    /// The two limits of normalised depth, the first of them the near one of a standard (not reversed) matrix.
    pub fn depth_limits(self) -> [f64; 2] {
        match self {
            Self::OpenGl => [-1.0, 1.0],
            Self::Vulkan => [0.0, 1.0],
        }
    }

    /// +1 where clip y grows with the pixel row, −1 where it falls.
    pub fn y_sign(self) -> f64 {
        match self {
            Self::OpenGl => -1.0,
            Self::Vulkan => 1.0,
        }
    }

    /// Window z, what a depth attachment holds, of a normalised depth: equation 7 of Broecker, Smith and Thomas,
    /// ISMAR 2013 (OpenGL), or the number itself (Vulkan).
    pub fn window_z(self, ndc_z: f64) -> f64 {
        match self {
            Self::OpenGl => ndc_z * 0.5 + 0.5,
            Self::Vulkan => ndc_z,
        }
    }

    /// Takes this clip space to Vulkan's, for the raster pass.
    pub fn vulkan_clip_from_clip(self) -> DMat4 {
        match self {
            Self::OpenGl => dmat4_from_rows(&[
                [1.0, 0.0, 0.0, 0.0],
                [0.0, -1.0, 0.0, 0.0],
                [0.0, 0.0, 0.5, 0.5],
                [0.0, 0.0, 0.0, 1.0],
            ]),
            Self::Vulkan => DMat4::IDENTITY,
        }
    }
}

impl From<lantern_config::Convention> for Convention {
    fn from(convention: lantern_config::Convention) -> Self {
        match convention {
            lantern_config::Convention::OpenGl => Self::OpenGl,
            lantern_config::Convention::Vulkan => Self::Vulkan,
        }
    }
}

/// One projector: clip-from-world, its convention, its lens, how bright its pixels are, and how many. Invertible and finite
/// by construction; a clone shares what is large.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    clip_from_world: DMat4,
    world_from_clip: DMat4,
    convention: Convention,
    resolution_px: UVec2,
    optics: Optics,
    maps: Arc<Maps>,
}

impl Calibration {
    /// From projection (clip from view) and view (view from world), both as arrays of rows, and the size of the image.
    ///
    /// A matrix and its negative are the same projective map, and pose estimation yields either. Where the given sign
    /// puts every pixel's ray at clip w ≤ 0, so that the projector would see nothing at all, the other sign is taken.
    ///
    /// # Errors
    /// An entry that is not finite, a singular matrix (named), or an empty image.
    pub fn from_matrices(
        projection: &Matrix4,
        view: &Matrix4,
        convention: Convention,
        resolution_px: UVec2,
    ) -> Result<Self, CalibrationError> {
        if resolution_px.min_element() == 0 {
            return Err(CalibrationError::NoPixels { width: resolution_px.x, height: resolution_px.y });
        }
        let clip_from_view = checked("projection", projection)?;
        let view_from_world = checked("view", view)?;
        let clip_from_world = clip_from_view * view_from_world;
        let world_from_clip = inverse("projection · view", clip_from_world)?;

        let (optics, maps) = (Optics::Pinhole, Arc::default());
        let calibration = Self { clip_from_world, world_from_clip, convention, resolution_px, optics, maps };
        // An infinite far plane comes out of the inversion as one of w = 1e-17 or so, of either sign: that sees nothing.
        let corners = convention
            .depth_limits()
            .into_iter()
            .flat_map(|z| [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)].map(|(x, y)| DVec4::new(x, y, z, 1.0)));
        let w: Vec<f64> = corners.map(|corner| (world_from_clip * corner).w).collect();
        let largest_w = w.iter().fold(0.0, |largest: f64, w| largest.max(w.abs()));
        let sees_something = w.iter().any(|w| *w > INFINITE_BELOW * largest_w);
        Ok(if sees_something {
            calibration
        } else {
            Self { clip_from_world: clip_from_world * -1.0, world_from_clip: world_from_clip * -1.0, ..calibration }
        })
    }

    /// The same projector behind a lens.
    ///
    /// # Errors
    /// A lens that is not one to one over the image.
    pub fn with_lens(self, lens: Lens) -> Result<Self, CalibrationError> {
        let optics = Optics::new(lens, self.resolution_px)?;
        Ok(Self { optics, ..self })
    }

    /// The same projector with alpha and beta maps.
    ///
    /// # Errors
    /// Sizes or values that are none of a map.
    pub fn with_maps(self, maps: Maps) -> Result<Self, CalibrationError> {
        maps.check()?;
        Ok(Self { maps: Arc::new(maps), ..self })
    }

    /// The same projector, carried: `home_from_world` takes the world to where everything stood about it when it was calibrated.
    /// It must be rigid.
    pub fn carried(&self, home_from_world: DMat4) -> Self {
        Self {
            clip_from_world: self.clip_from_world * home_from_world,
            world_from_clip: home_from_world.inverse() * self.world_from_clip,
            ..self.clone()
        }
    }

    /// What stands between the matrix's ideal image and the real one.
    pub fn optics(&self) -> &Optics {
        &self.optics
    }

    /// How bright each pixel is to be.
    pub fn maps(&self) -> &Arc<Maps> {
        &self.maps
    }

    /// Clip from world, in the projector's own convention, of the ideal image.
    pub fn clip_from_world(&self) -> DMat4 {
        self.clip_from_world
    }

    /// Its inverse.
    pub fn world_from_clip(&self) -> DMat4 {
        self.world_from_clip
    }

    /// Which clip space.
    pub fn convention(&self) -> Convention {
        self.convention
    }

    /// Columns and rows.
    pub fn resolution_px(&self) -> UVec2 {
        self.resolution_px
    }

    /// What the raster pass uses: y down and z from 0 to 1, whatever the convention. Window z is the same number.
    pub fn vulkan_clip_from_world(&self) -> DMat4 {
        self.convention.vulkan_clip_from_clip() * self.clip_from_world
    }

    /// Normalised clip x and y of a place in the ideal image: pixel (x, y) has its centre at (x + ½, y + ½), and row 0 is the
    /// top row of the projected image.
    pub fn ndc_from_px(&self, place_px: DVec2) -> DVec2 {
        let across = place_px / self.resolution_px.as_dvec2() * 2.0 - 1.0;
        DVec2::new(across.x, across.y * self.convention.y_sign())
    }

    /// The way back.
    pub fn px_from_ndc(&self, ndc: DVec2) -> DVec2 {
        (DVec2::new(ndc.x, ndc.y * self.convention.y_sign()) * 0.5 + 0.5) * self.resolution_px.as_dvec2()
    }
}

/// A glam matrix (stored by columns) from an array of rows.
pub(crate) fn dmat4_from_rows(rows: &Matrix4) -> DMat4 {
    DMat4::from_cols_array_2d(rows).transpose()
}

/// A matrix whose every entry is finite and which can be inverted.
fn checked(matrix: &'static str, rows: &Matrix4) -> Result<DMat4, CalibrationError> {
    for (row, entries) in rows.iter().enumerate() {
        for (column, &value) in entries.iter().enumerate() {
            if !value.is_finite() {
                return Err(CalibrationError::NotFinite { matrix, row, column, value });
            }
        }
    }
    let mat = dmat4_from_rows(rows);
    inverse(matrix, mat).map(|_| mat)
}

/// The inverse, refined by one step of Newton and Schulz, which takes the cofactor formula's error to the last digits.
fn inverse(matrix: &'static str, mat: DMat4) -> Result<DMat4, CalibrationError> {
    let determinant = mat.determinant();
    let column_sizes = DVec4::from_array(std::array::from_fn(|i| mat.col(i).abs().max_element()));
    let balanced = mat * DMat4::from_diagonal(column_sizes.recip());
    let bound: f64 = (0..4).map(|i| balanced.row(i).length()).product();
    let first = mat.inverse();
    // Written so that a NaN, from an empty column or from products that overflow, is singular too.
    let has_an_inverse = balanced.determinant().abs() > SINGULAR_BELOW * bound && first.is_finite();
    if !has_an_inverse {
        return Err(CalibrationError::Singular { matrix, determinant });
    }
    Ok(first * (DMat4::IDENTITY * 2.0 - mat * first))
}

#[cfg(test)]
mod tests {
    use super::*;

    const IDENTITY: Matrix4 = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

    #[test]
    fn the_top_left_corner_is_where_each_convention_has_it() {
        let size = UVec2::new(1280, 800);
        let gl = Calibration::from_matrices(&IDENTITY, &IDENTITY, Convention::OpenGl, size).unwrap();
        let vk = Calibration::from_matrices(&IDENTITY, &IDENTITY, Convention::Vulkan, size).unwrap();
        assert_eq!(gl.ndc_from_px(DVec2::ZERO), DVec2::new(-1.0, 1.0));
        assert_eq!(vk.ndc_from_px(DVec2::ZERO), DVec2::new(-1.0, -1.0));
        let place_px = DVec2::new(17.5, 700.5);
        for calibration in [&gl, &vk] {
            let back_px = calibration.px_from_ndc(calibration.ndc_from_px(place_px));
            assert!((back_px - place_px).length() < 1e-10, "{back_px}");
        }
    }

    #[test]
    fn vulkan_clip_has_the_same_window_z_and_the_same_row() {
        let projection = [[1.2, 0.0, 0.1, 0.0], [0.0, 1.9, -0.2, 0.0], [0.0, 0.0, -1.02, -0.2], [0.0, 0.0, -1.0, 0.0]];
        let gl = Calibration::from_matrices(&projection, &IDENTITY, Convention::OpenGl, UVec2::new(640, 480)).unwrap();
        let at = DVec4::new(0.3, -0.4, -2.5, 1.0);
        let own = gl.clip_from_world() * at;
        let vulkan = gl.vulkan_clip_from_world() * at;
        assert!((vulkan.z / vulkan.w - Convention::OpenGl.window_z(own.z / own.w)).abs() < 1e-15);
        assert!((vulkan.y / vulkan.w + own.y / own.w).abs() < 1e-15);
    }

    #[test]
    fn what_cannot_be_inverted_is_named() {
        let size = UVec2::new(64, 64);
        let mut flat = IDENTITY;
        flat[2] = flat[3];
        let refused = |projection: &Matrix4, view: &Matrix4| {
            Calibration::from_matrices(projection, view, Convention::OpenGl, size).unwrap_err().to_string()
        };
        assert!(refused(&flat, &IDENTITY).starts_with("the projection matrix is singular"));
        assert!(refused(&IDENTITY, &flat).starts_with("the view matrix is singular"));
        assert!(refused(&[[0.0; 4]; 4], &IDENTITY).contains("hint:"));

        // Independent in exact arithmetic, but by less than the numbers can tell.
        let mut almost = IDENTITY;
        almost[0] = [1.0, 1.0, 0.0, 0.0];
        almost[1] = [1.0, 1.0 + 1e-15, 0.0, 0.0];
        assert!(refused(&almost, &IDENTITY).contains("singular"));

        // Far from the origin, by less than a digit of the rotation: no reason to refuse.
        let mut far_away = IDENTITY;
        for row in &mut far_away[..3] {
            row[3] = 1e7;
        }
        assert!(Calibration::from_matrices(&IDENTITY, &far_away, Convention::OpenGl, size).is_ok());

        let mut holed = IDENTITY;
        holed[1][3] = f64::NAN;
        assert!(refused(&IDENTITY, &holed).starts_with("the view matrix has NaN at row 1, column 3"));
        let none = Calibration::from_matrices(&IDENTITY, &IDENTITY, Convention::Vulkan, UVec2::new(0, 5));
        assert_eq!(none, Err(CalibrationError::NoPixels { width: 0, height: 5 }));
    }

    #[test]
    fn what_is_carried_sees_from_there_what_it_saw_from_home() {
        let projection = [[1.2, 0.0, 0.1, 0.0], [0.0, 1.9, -0.2, 0.0], [0.0, 0.0, -1.02, -0.2], [0.0, 0.0, -1.0, 0.0]];
        let home = Calibration::from_matrices(&projection, &IDENTITY, Convention::OpenGl, UVec2::new(64, 48)).unwrap();
        let world_from_home = DMat4::from_rotation_translation(
            glam::DQuat::from_rotation_y(0.7) * glam::DQuat::from_rotation_x(-0.2),
            glam::DVec3::new(3.0, -1.0, 2.0),
        );
        let away = home.carried(world_from_home.inverse());
        let at = DVec4::new(0.3, -0.4, -2.5, 1.0);
        assert!((away.clip_from_world() * (world_from_home * at) - home.clip_from_world() * at).length() < 1e-12);
        let back = away.clip_from_world() * away.world_from_clip();
        assert!((back - DMat4::IDENTITY).to_cols_array().iter().all(|x| x.abs() < 1e-12), "{back}");
    }

    #[test]
    fn a_matrix_and_its_negative_are_one_calibration() {
        let projection = [[1.2, 0.0, 0.1, 0.0], [0.0, 1.9, -0.2, 0.0], [0.0, 0.0, -1.02, -0.2], [0.0, 0.0, -1.0, 0.0]];
        let negative = projection.map(|row| row.map(|entry: f64| -entry));
        let of = |rows| Calibration::from_matrices(rows, &IDENTITY, Convention::OpenGl, UVec2::new(64, 48)).unwrap();
        assert_eq!(of(&projection).clip_from_world(), of(&negative).clip_from_world());

        // Also where the far plane is infinite, and its w is rounded to something above 0.
        let infinite = [
            [-4.3666446546321325, 0.0, 0.3175283489103837, 0.0],
            [0.0, -8.280452085820933, 0.6449380902967681, 0.0],
            [0.0, 0.0, 1.0, 0.4421945257086409],
            [0.0, 0.0, 1.0, 0.0],
        ];
        let view = [
            [0.5236986308922684, -0.153881979572274, -0.8378902555612412, -0.10846117263347799],
            [0.018228489294553264, -0.9813012349237231, 0.19161317416924759, -0.11617257637191042],
            [-0.8517085570660904, -0.11562103052686533, -0.511101077205188, -1.4915562699845026],
            [0.0, 0.0, 0.0, 1.0],
        ];
        let of = |rows| Calibration::from_matrices(rows, &view, Convention::OpenGl, UVec2::new(64, 48)).unwrap();
        let negative = infinite.map(|row| row.map(|entry: f64| -entry));
        assert_eq!(of(&infinite).clip_from_world(), of(&negative).clip_from_world());
    }
}
