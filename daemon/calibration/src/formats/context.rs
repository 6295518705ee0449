//! What the configuration says of a file, beside what the file says itself.

use glam::UVec2;
use lantern_config::{CalibrationFile, Unit};

use super::FileError;

/// Two shapes of an image are the same where their aspects differ by less than this: 1366 × 768 is 16 : 9.
const SAME_ASPECT: f64 = 2e-3;

/// Whether what was made for one image can be used for the other.
pub(crate) fn have_same_shape(a: UVec2, b: UVec2) -> bool {
    let aspect = |size: UVec2| f64::from(size.x) / f64::from(size.y);
    (aspect(a) / aspect(b) - 1.0).abs() < SAME_ASPECT
}

/// A file's table in the configuration, and the projector that it is for.
pub(super) struct Context<'a> {
    pub(super) file: &'a CalibrationFile,
    /// Of the projector.
    pub(super) resolution_px: UVec2,
}

impl Context<'_> {
    /// The image that the file's numbers count, where the file states one or not. It may be larger or smaller than the
    /// projector's, but not of another shape.
    pub(super) fn size_px(&self, stated_px: Option<UVec2>) -> Result<UVec2, FileError> {
        let said_px = self.file.resolution_px.map(UVec2::from);
        if let (Some(stated_px), Some(said_px)) = (stated_px, said_px)
            && stated_px != said_px
        {
            let pixels = |size: UVec2| format!("{} × {} pixels", size.x, size.y);
            return Err(FileError::Contradicted {
                key: "resolution_px",
                file: pixels(stated_px),
                config: pixels(said_px),
            });
        }
        let size_px = stated_px.or(said_px).unwrap_or(self.resolution_px);
        if size_px.min_element() == 0 || !have_same_shape(size_px, self.resolution_px) {
            return Err(FileError::Resolution { file_px: size_px, projector_px: self.resolution_px });
        }
        Ok(size_px)
    }

    /// The length of the file's unit, m.
    pub(super) fn unit_m(&self, stated: Option<Unit>) -> Result<f64, FileError> {
        match (stated, self.file.unit) {
            (Some(stated), Some(said)) if stated != said => Err(FileError::Contradicted {
                key: "unit",
                file: format!("\"{}\"", stated.as_str()),
                config: format!("\"{}\"", said.as_str()),
            }),
            (Some(unit), _) | (None, Some(unit)) => Ok(unit.metres()),
            (None, None) => Err(FileError::Unsaid {
                what: "in what unit its lengths are".to_owned(),
                key: "unit",
                example: Unit::ALL.map(|unit| format!("\"{}\"", unit.as_str())).join(", "),
            }),
        }
    }

    /// The one of several named things that the configuration asks for.
    pub(super) fn entry<T>(&self, what: &str, all: Vec<(String, T)>) -> Result<T, FileError> {
        let names: Vec<_> = all.iter().map(|(name, _)| name.clone()).collect();
        let refused = |message| FileError::Entry { message, there: names };
        let mut found: Vec<_> = match &self.file.entry {
            None => all,
            Some(entry) => all.into_iter().filter(|(name, _)| name == entry).collect(),
        };
        match (found.pop(), found.is_empty(), &self.file.entry) {
            (Some((_, one)), true, _) => Ok(one),
            (None, _, None) => Err(refused(format!("has no {what}"))),
            (None, _, Some(entry)) => Err(refused(format!("has no {what} {entry:?}"))),
            (Some(_), false, None) => Err(refused(format!("has several {what}s, and `entry` names none"))),
            (Some(_), false, Some(entry)) => Err(refused(format!("has several {what}s {entry:?}"))),
        }
    }
}
