//! The kept scene's form on the disk, and how those of earlier releases become today's.
//!
//! A form that was ever released stays readable: whoever changes it raises [`VERSION`], adds a step to `STEPS` and a file that the
//! last version wrote to `daemon/tests/state/`.

use lantern_config::Scene;
use lantern_proto::Edit;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::document::{self, Document, DocumentError};

/// Version of the form that is written.
///
/// | version | form |
/// |---|---|
/// | 1 | `{"version": 1, "scene_fingerprint", "revision", "edits"}` alone; the fingerprint is [`Scene::fingerprint_with_nulls`] |
/// | 2 | a [`document`] `lantern scene` of `{"scene_fingerprint", "revision", "edits"}`; [`Scene::fingerprint`] |
pub const VERSION: u32 = 2;

const FORMAT: &str = "lantern scene";

/// What is kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// Of the configuration's scene when this was written: a state of another scene is not shown.
    pub scene_fingerprint: String,
    /// The revision.
    pub revision: u64,
    /// Edits that rebuild it.
    pub edits: Vec<Edit>,
}

/// Why a file is no state.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum FormatError {
    /// It is another thing, or not whole.
    #[error(transparent)]
    Document(#[from] DocumentError),
    /// A later release wrote it.
    #[error("its version is {0}, and this release knows those up to {VERSION}")]
    Later(u32),
    /// It is of that version by its own word alone.
    #[error("it is no state of version {version}: {reason}")]
    Body {
        /// What it says.
        version: u32,
        /// What is wrong with it.
        reason: String,
    },
}

/// From each version to the next; the first makes 2 of 1. `scene` is the configuration's of today.
type Step = fn(body: Value, scene: &Scene) -> Result<Value, String>;
const STEPS: [Step; VERSION as usize - 1] = [from_1_to_2];

/// Version 2 has a fingerprint that stays as it is where a release adds keys to `[scene]` that nobody has written.
fn from_1_to_2(mut body: Value, scene: &Scene) -> Result<Value, String> {
    let body_map = body.as_object_mut().ok_or("it is no object")?;
    body_map.shift_remove("version");
    let fingerprint = body_map.get_mut("scene_fingerprint").ok_or("it has no scene_fingerprint")?;
    if *fingerprint == scene.fingerprint_with_nulls() {
        *fingerprint = scene.fingerprint().into();
    }
    Ok(body)
}

/// As a file, which has a body of `limit_bytes` at most.
///
/// # Errors
/// In words, where it cannot be written so.
pub fn write(state: &State, limit_bytes: u64) -> Result<Vec<u8>, String> {
    let body = serde_json::to_vec(state).map_err(|error| error.to_string())?;
    if body.len() as u64 > limit_bytes {
        return Err(format!("it has {} bytes, and {limit_bytes} can be kept", body.len()));
    }
    Ok(document::seal(FORMAT, VERSION, &body))
}

/// What a file holds that this or an earlier release has written, in today's form. `scene` is the configuration's of today.
///
/// # Errors
/// [`FormatError`].
pub fn read(file: &[u8], scene: &Scene) -> Result<State, FormatError> {
    let (version, text) = version_of(file)?;
    let wrong = |version, reason| FormatError::Body { version, reason };
    if version == VERSION {
        return serde_json::from_slice(text).map_err(|error| wrong(version, error.to_string()));
    }
    tracing::info!(
        from = version,
        to = VERSION,
        "an earlier release has kept this scene; its form is brought up to date"
    );
    let mut body = serde_json::from_slice(text).map_err(|error| wrong(version, error.to_string()))?;
    for step in &STEPS[version as usize - 1..] {
        body = step(body, scene).map_err(|reason| wrong(version, reason))?;
    }
    serde_json::from_value(body).map_err(|error| wrong(version, error.to_string()))
}

/// The version, from 1 to today's, and what is written in it.
fn version_of(file: &[u8]) -> Result<(u32, &[u8]), FormatError> {
    match document::open(FORMAT, file) {
        Ok(Document { version: version @ 2..=VERSION, body }) => Ok((version, body)),
        Ok(Document { version: version @ 0..2, .. }) => {
            Err(FormatError::Body { version, reason: "that one had no head".into() })
        }
        Ok(Document { version, .. }) => Err(FormatError::Later(version)),
        // Version 1 had no head: the file is all body.
        Err(DocumentError::NoHead) => match serde_json::from_slice(file) {
            Ok(Version { version: 1 }) => Ok((1, file)),
            Ok(_) | Err(_) => Err(DocumentError::NoHead.into()),
        },
        Err(error) => Err(error.into()),
    }
}

#[derive(Deserialize)]
struct Version {
    version: u32,
}

#[cfg(test)]
mod tests {
    use super::*;
    use lantern_config::Config;
    use serde_json::json;
    use std::path::Path;

    const CONFIG_1: &str = include_str!("../../../tests/state/version-1/lantern.toml");
    const STATE_1: &[u8] = include_bytes!("../../../tests/state/version-1/scene.json");

    fn scene(text: &str) -> Scene {
        Config::parse(text, "lantern.toml", Path::new("/")).unwrap().scene
    }

    #[test]
    fn a_state_of_version_1_becomes_one_of_today() {
        let (scene_1, other) = (scene(CONFIG_1), scene(&CONFIG_1.replace("#406080", "#102030")));
        let before: Value = serde_json::from_slice(STATE_1).unwrap();
        let state = read(STATE_1, &scene_1).unwrap();
        assert_eq!(state.scene_fingerprint, scene_1.fingerprint());
        assert_eq!(json!(state.revision), before["revision"]);
        assert_eq!(state.edits, serde_json::from_value::<Vec<Edit>>(before["edits"].clone()).unwrap());
        // Written and read again it is the same, and has said its version.
        let file = write(&state, 1 << 20).unwrap();
        assert_eq!(document::open(FORMAT, &file).unwrap().version, VERSION);
        assert_eq!(read(&file, &other).unwrap(), state);
        // Of a configuration whose scene has changed since, it is told apart as before.
        assert_ne!(read(STATE_1, &other).unwrap().scene_fingerprint, other.fingerprint());
    }

    #[test]
    fn what_is_no_state_says_why() {
        let any = Scene::default();
        let why = |file: &[u8]| read(file, &any).unwrap_err().to_string();
        for (file, words) in [
            (&b""[..], "does not say what it is"),
            (b"{", "does not say what it is"),
            (b"\0\0\0\0", "does not say what it is"),
            (b"[1]", "it is no object"),
            (b"{\"version\": 0}", "does not say what it is"),
            (b"{\"version\": 99}", "does not say what it is"),
            (b"{\"version\": 1}", "no scene_fingerprint"),
            (&STATE_1[..STATE_1.len() / 2], "does not say what it is"),
            (&document::seal(FORMAT, 3, b"{}"), "its version is 3, and this release knows those up to 2"),
            (&document::seal(FORMAT, 2, b"{}"), "missing field"),
            (&document::seal(FORMAT, 2, b"dear diary"), "expected value"),
            (&document::seal(FORMAT, 0, b"{}"), "version 0"),
            (&document::seal("lantern configuration", 1, b"{}"), "lantern configuration"),
        ] {
            assert!(why(file).contains(words), "{}: {}", String::from_utf8_lossy(file), why(file));
        }
        let state = State { scene_fingerprint: String::new(), revision: 1, edits: vec![] };
        assert!(write(&state, 10).unwrap_err().contains("10 can be kept"));
    }
}
