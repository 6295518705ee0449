//! The two containers, GLB and plain JSON, and what a document asks for as a whole.

use gltf::json::Root;

use super::error::{Located, Problem, bad, here};
use super::warnings::Warnings;

/// The largest JSON part; even a million nodes stay below it.
const MAX_JSON_BYTES: usize = 128 << 20;

/// What Lantern reads of glTF's extensions. Anything else that a file requires is refused, that it merely uses warned of.
const EXTENSIONS: [&str; 8] = [
    "KHR_lights_punctual",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
];

/// A file's parts.
pub(super) struct Container<'a> {
    pub(super) json: &'a [u8],
    /// A GLB's second chunk.
    pub(super) bin: Option<&'a [u8]>,
}

/// Splits a file (glTF 2.0, section 4.4, "Binary glTF Layout").
pub(super) fn split(bytes: &[u8]) -> Result<Container<'_>, Located> {
    if !bytes.starts_with(b"glTF") {
        return Ok(Container { json: bytes, bin: None });
    }
    let container = |cause: String| here("GLB header", Problem::Container(cause));
    let truncated = |object: &str, needed: u64| {
        here(object, Problem::Truncated { of: "the file".into(), needed, available: bytes.len() as u64 })
    };
    let version = word(bytes, 4).ok_or_else(|| truncated("GLB header", 12))?;
    let length = word(bytes, 8).ok_or_else(|| truncated("GLB header", 12))?;
    if version != 2 {
        return Err(container(format!("is binary glTF of version {version}; Lantern reads 2")));
    }
    if u64::from(length) > bytes.len() as u64 {
        return Err(truncated("GLB header", length.into()));
    }
    // What lies behind the declared length is not the file's.
    let bytes = &bytes[..length as usize];

    let first = chunk(bytes, 12).ok_or_else(|| truncated("GLB chunk 0", 20))?;
    if first.kind != *b"JSON" {
        return Err(container("begins with a chunk that is not JSON".into()));
    }
    let json = first.data.ok_or_else(|| truncated("GLB chunk 0", first.end as u64))?;
    let bin = match chunk(bytes, first.end) {
        Some(second) if second.kind == *b"BIN\0" => {
            Some(second.data.ok_or_else(|| truncated("GLB chunk 1", second.end as u64))?)
        }
        _ => None,
    };
    Ok(Container { json, bin })
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    let word = bytes.get(at..at.checked_add(4)?)?;
    Some(u32::from_le_bytes(word.try_into().ok()?))
}

/// One chunk of a GLB.
struct Chunk<'a> {
    kind: [u8; 4],
    /// `None` where they are cut off.
    data: Option<&'a [u8]>,
    /// The place behind it.
    end: usize,
}

/// The chunk at a place; `None` where not even its head is there.
fn chunk(bytes: &[u8], at: usize) -> Option<Chunk<'_>> {
    let length = word(bytes, at)? as usize;
    let kind = bytes.get(at + 4..at + 8)?.try_into().ok()?;
    let end = at.checked_add(8)?.checked_add(length)?;
    Some(Chunk { kind, data: bytes.get(at + 8..end), end })
}

/// Parses the JSON; values are checked where they are used.
pub(super) fn parse(json: &[u8]) -> Result<Root, Located> {
    if json.len() > MAX_JSON_BYTES {
        let (count, limit) = (json.len() as u64, MAX_JSON_BYTES as u64);
        return Err(here("JSON", Problem::TooMany { what: "bytes of JSON", count, limit, key: "fixed" }));
    }
    let start = json.iter().find(|byte| !byte.is_ascii_whitespace());
    if start != Some(&b'{') {
        let cause = "is neither GLB (\"glTF\" at its start) nor JSON";
        return Err(here("file", Problem::Container(cause.into())));
    }
    let root: Root = gltf::json::deserialize::from_slice(json).map_err(|error| here("JSON", Problem::Json(error)))?;
    let version = &root.asset.version;
    if version != "2" && !version.starts_with("2.") {
        return Err(bad("asset", format!("is glTF of version {version:?}; Lantern reads 2.0")));
    }
    Ok(root)
}

/// Refuses a file that requires what is not read, and warns of what is ignored as a whole.
pub(super) fn check_extensions(root: &Root, warnings: &mut Warnings) -> Result<(), Located> {
    let unknown = |name: &&String| !EXTENSIONS.contains(&name.as_str());
    if let Some(name) = root.extensions_required.iter().find(unknown) {
        return Err(here("extensionsRequired", Problem::Extension(name.clone())));
    }
    for name in root.extensions_used.iter().filter(unknown) {
        warnings.add(format!("the extension {name} is ignored"));
    }
    for (used, what) in [
        (!root.animations.is_empty(), "animations are ignored; the model keeps its rest pose"),
        (!root.skins.is_empty(), "skins are ignored; the model keeps its bind pose"),
        (!root.cameras.is_empty(), "cameras are ignored; calibrations place projectors"),
    ] {
        if used {
            warnings.add(what);
        }
    }
    Ok(())
}
