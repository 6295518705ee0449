//! How bright each pixel of a projector is to be: MPCDI's alpha and beta maps.

use glam::{UVec2, Vec3};

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

impl Maps {
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
