//! Why an edit is refused, and the checks that need no scene.

use std::fmt;

use glam::{DQuat, DVec3};

/// An edit was refused, and with it every edit of its list.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{at}: {message}")]
pub struct EditError {
    /// One of `unknown-node`, `duplicate-node`, `unknown-mesh`, `unknown-material`, `unknown-light`, `bad-uri`,
    /// `outside-asset-roots`, `bad-gltf`, `bad-transform`, `bad-value`, `too-large`.
    pub code: &'static str,
    /// Cause, and after `hint:` the remedy.
    pub message: String,
    /// Where: `edits[3].node`.
    pub at: String,
}

/// An [`EditError`] that does not know its place in the list yet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Fault {
    pub(crate) code: &'static str,
    pub(crate) field: &'static str,
    pub(crate) message: String,
}

impl Fault {
    pub(crate) fn new(code: &'static str, field: &'static str, message: impl Into<String>) -> Self {
        Self { code, field, message: message.into() }
    }

    /// The fault of edit number `index`.
    pub(crate) fn at(self, index: usize) -> EditError {
        let Self { code, field, message } = self;
        EditError { code, message, at: format!("edits[{index}].{field}") }
    }
}

pub(crate) fn bad_value(field: &'static str, cause: impl fmt::Display, hint: &str) -> Fault {
    Fault::new("bad-value", field, format!("{field} {cause}; hint: {hint}"))
}

fn bad_transform(field: &'static str, cause: impl fmt::Display, hint: &str) -> Fault {
    Fault::new("bad-transform", field, format!("{field} {cause}; hint: {hint}"))
}

/// The largest distance from the world's origin that a node may be put at, m.
pub(crate) const MAX_DISTANCE_M: f64 = 1e8;

/// Finite, and not farther than [`MAX_DISTANCE_M`] along any axis.
pub(crate) fn checked_translation(translation_m: [f64; 3]) -> Result<DVec3, Fault> {
    if translation_m.iter().all(|x| x.abs() <= MAX_DISTANCE_M) {
        return Ok(translation_m.into());
    }
    Err(bad_transform(
        "translation_m",
        format_args!("{translation_m:?} is not a place within 1e8 m"),
        "three finite numbers, metres",
    ))
}

/// A unit quaternion to 1 % comes back normalised.
pub(crate) fn checked_rotation(rotation: [f64; 4]) -> Result<DQuat, Fault> {
    let quaternion = DQuat::from_array(rotation);
    let norm = quaternion.length();
    if (norm - 1.0).abs() <= 0.01 {
        // One that is as near to 1 as normalising brings it stays to the bit, so that a scene told and rebuilt is the same.
        return Ok(if (norm - 1.0).abs() < 1e-14 { quaternion } else { quaternion.normalize() });
    }
    Err(bad_transform(
        "rotation",
        format_args!("{rotation:?} has norm {norm}"),
        "a unit quaternion x, y, z, w; [0, 0, 0, 1] turns nothing",
    ))
}

/// Finite and not zero; a negative factor mirrors.
pub(crate) fn checked_scale(scale: [f64; 3]) -> Result<DVec3, Fault> {
    if scale.iter().all(|s| (1e-6..=1e6).contains(&s.abs())) {
        return Ok(scale.into());
    }
    Err(bad_transform(
        "scale",
        format_args!("{scale:?} has a factor that is zero, not finite or beyond 1e-6 to 1e6"),
        "one factor an axis; [1, 1, 1] keeps the size",
    ))
}

/// Names are what edits go by; `/` parts a node's name from those of its materials and lights.
pub(crate) fn checked_name<'a>(field: &'static str, name: &'a str) -> Result<&'a str, Fault> {
    if name.is_empty() || name.len() > 256 || name.contains('/') || name.chars().any(char::is_control) {
        return Err(bad_value(
            field,
            format_args!("{name:?} is no name"),
            "1 to 256 bytes without '/', which parts a node from its materials and lights",
        ));
    }
    Ok(name)
}

/// A list of known names for a message, the nearest to `wanted` first; at most five.
pub(crate) fn nearest<'a>(wanted: &str, known: impl Iterator<Item = &'a str>) -> String {
    let mut known: Vec<&str> = known.collect();
    known.sort_by(|a, b| strsim::jaro_winkler(wanted, b).total_cmp(&strsim::jaro_winkler(wanted, a)).then(a.cmp(b)));
    known.dedup();
    match known.as_slice() {
        [] => "there are none yet".into(),
        [only] => format!("there is {only:?} alone"),
        [first, others @ ..] => {
            let others: Vec<String> = others.iter().take(4).map(|name| format!("{name:?}")).collect();
            format!("the nearest is {first:?}; others: {}", others.join(", "))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quaternions_off_by_one_percent_are_normalised_and_beyond_refused() {
        assert_eq!(checked_rotation([0.0, 0.0, 0.0, 1.009]).unwrap(), DQuat::IDENTITY);
        for bad in [[0.0, 0.0, 0.0, 1.02], [0.0; 4], [f64::NAN, 0.0, 0.0, 1.0], [f64::INFINITY, 0.0, 0.0, 1.0]] {
            assert_eq!(checked_rotation(bad).unwrap_err().code, "bad-transform");
        }
    }

    #[test]
    fn placements_that_are_none_are_refused() {
        assert!(checked_scale([1.0, -2.0, 0.5]).is_ok());
        for bad in [[1.0, 0.0, 1.0], [1.0, f64::NAN, 1.0], [1.0, 1.0, f64::INFINITY]] {
            assert_eq!(checked_scale(bad).unwrap_err().code, "bad-transform");
            if bad[1] != 0.0 {
                assert_eq!(checked_translation(bad).unwrap_err().code, "bad-transform");
            }
        }
    }

    #[test]
    fn the_nearest_name_comes_first() {
        assert!(nearest("cra", ["head", "car", "floor"].into_iter()).starts_with("the nearest is \"car\""));
    }
}
