//! How bright each pixel of a projector is to be: MPCDI's alpha and beta maps.

use glam::{IVec2, UVec2, Vec2, Vec3};

/// One map over the image: bilinear between the middles of its cells, row 0 on top, of any size.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Columns and rows.
    pub size: UVec2,
    /// Red, green and blue on linear values, 0 to 1; `size.x · size.y` of them.
    pub values: Vec<Vec3>,
}

/// What is multiplied and added, on linear values: `out = in·α·(1 − β) + β` (VESA MPCDI 2.0).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Maps {
    /// α, how bright; 1 where there is none.
    pub alpha: Option<Map>,
    /// β, how much black is raised; 0 where there is none.
    pub beta: Option<Map>,
}

/// Those that a calibration takes hold no NaN, so that each is the same as itself: where one is shared, nothing is compared.
impl Eq for Maps {}

/// Why a pair of maps cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MapsError {
    /// A map without values, or with more or fewer than its size says.
    #[error("the {map} map of {columns} × {rows} has {values} values; hint: the file is cut off or empty")]
    Size {
        /// `alpha` or `beta`.
        map: &'static str,
        /// Columns.
        columns: u32,
        /// Rows.
        rows: u32,
        /// Values.
        values: usize,
    },
    /// A value that is no share.
    #[error(
        "the {map} map has {value} in column {column}, row {row}; hint: values are from 0 to 1, after the file's largest \
         number and its gamma are taken out"
    )]
    Value {
        /// `alpha` or `beta`.
        map: &'static str,
        /// From 0.
        column: u32,
        /// From 0.
        row: u32,
        /// Red, green and blue.
        value: Vec3,
    },
}

impl Map {
    /// Bilinear at a place of the image, from 0 to 1 on each axis; beyond the outer middles their own value.
    fn at(&self, place: Vec2) -> Vec3 {
        let at = place * self.size.as_vec2() - 0.5;
        let first = at.floor();
        let last = self.size.as_ivec2() - 1;
        let value = |x: i32, y: i32| {
            let at = (first.as_ivec2() + IVec2::new(x, y)).clamp(IVec2::ZERO, last);
            self.values[(at.y * self.size.x as i32 + at.x) as usize]
        };
        let t = at - first;
        value(0, 0).lerp(value(1, 0), t.x).lerp(value(0, 1).lerp(value(1, 1), t.x), t.y)
    }
}

impl Maps {
    /// Whether there is neither.
    pub fn is_empty(&self) -> bool {
        self.alpha.is_none() && self.beta.is_none()
    }

    /// α's red, green and blue and β's, of each pixel of an image, row by row: 16 bits each from 0 to 1, the first in the lower
    /// half of its word. Read by `resolve.comp`.
    pub fn packed(&self, resolution_px: UVec2) -> Vec<[u32; 3]> {
        let of = |map: &Option<Map>, place, none| map.as_ref().map_or(none, |map: &Map| map.at(place));
        let pixel = |x: u32, y: u32| {
            let place = (UVec2::new(x, y).as_vec2() + 0.5) / resolution_px.as_vec2();
            let (alpha, beta) = (of(&self.alpha, place, Vec3::ONE), of(&self.beta, place, Vec3::ZERO));
            let bits = |value: f32| (value.clamp(0.0, 1.0) * 65535.0).round() as u32;
            [(alpha.x, alpha.y), (alpha.z, beta.x), (beta.y, beta.z)].map(|(low, high)| bits(low) | bits(high) << 16)
        };
        (0..resolution_px.y).flat_map(|y| (0..resolution_px.x).map(move |x| (x, y))).map(|(x, y)| pixel(x, y)).collect()
    }

    /// Checks sizes and values.
    pub(crate) fn check(&self) -> Result<(), MapsError> {
        for (name, map) in [("alpha", &self.alpha), ("beta", &self.beta)] {
            let Some(Map { size, values }) = map else { continue };
            let expected = u64::from(size.x) * u64::from(size.y);
            if expected == 0 || expected != values.len() as u64 {
                return Err(MapsError::Size { map: name, columns: size.x, rows: size.y, values: values.len() });
            }
            let share = |value: &Vec3| value.cmpge(Vec3::ZERO).all() && value.cmple(Vec3::ONE).all();
            if let Some(index) = values.iter().position(|value| !share(value)) {
                let (row, column) = (index as u32 / size.x, index as u32 % size.x);
                return Err(MapsError::Value { map: name, column, row, value: values[index] });
            }
        }
        Ok(())
    }
}
