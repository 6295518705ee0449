//! Damaged and hostile files: whatever is done to a good one, it is taken or refused in words, and nothing panics.
#![expect(clippy::unwrap_used, reason = "tests' helpers: what is given to them must be taken")]

mod common;

use std::io::{Cursor, Write};

use common::{fixture, projector};
use glam::UVec2;
use lantern_calibration::formats::from_bytes;
use lantern_config::{Calibration, CalibrationFile};
use proptest::prelude::*;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

const SIZE_PX: UVec2 = UVec2::new(1280, 720);

/// A good file of each kind, and the table that names it.
fn good() -> Vec<(CalibrationFile, Vec<u8>)> {
    let of = |format: &str, keys: &str| match projector("x".as_ref(), format, SIZE_PX, keys).calibration {
        Calibration::File(file) => file,
        Calibration::Matrices(_) => panic!("matrices are no file"),
    };
    let mut all: Vec<_> = ["4.yml", "4.xml", "4.json", "5.yml"]
        .map(|ending| (of("opencv", "unit = \"mm\""), std::fs::read(fixture(&format!("sample-{ending}"))).unwrap()))
        .into();
    for (name, format, keys) in [
        ("shaded.mpcdi.xml", "mpcdi", "unit = \"m\""),
        ("office.xml", "roomalive", ""),
        ("stage.json", "splash", "unit = \"m\"\nentry = \"cam1\""),
    ] {
        all.push((of(format, keys), std::fs::read(fixture(name)).unwrap()));
    }
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let xml = std::fs::read_to_string(fixture("shaded.mpcdi.xml")).unwrap();
    let files =
        "<files><fileset region=\"left\"><geometryWarpFile><path>left.pfm</path></geometryWarpFile></fileset></files>";
    let mut pfm = b"PF\n2 2\n-1\n".to_vec();
    pfm.extend([0.2f32, 0.2, 0.0, 0.8, 0.2, 0.0, 0.2, 0.8, 0.0, 0.8, 0.8, 0.0].into_iter().flat_map(f32::to_le_bytes));
    for (name, bytes) in
        [("mpcdi.xml", xml.replace("</MPCDI>", &format!("{files}</MPCDI>")).into_bytes()), ("left.pfm", pfm)]
    {
        archive.start_file(name, SimpleFileOptions::default()).unwrap();
        archive.write_all(&bytes).unwrap();
    }
    all.push((of("mpcdi", "unit = \"m\""), archive.finish().unwrap().into_inner()));
    all
}

/// What is refused says what to do.
fn survives(file: &CalibrationFile, bytes: &[u8]) {
    if let Err(error) = from_bytes(bytes, file, SIZE_PX) {
        assert!(error.to_string().contains("hint:"), "{error}");
    }
}

#[test]
fn the_files_that_are_damaged_are_good() {
    for (file, bytes) in good() {
        if let Err(error) = from_bytes(&bytes, &file, SIZE_PX) {
            panic!("{:?}: {error}", file.format);
        }
    }
}

#[test]
fn every_prefix_of_a_good_file() {
    for (file, bytes) in good() {
        for end in 0..bytes.len() {
            survives(&file, &bytes[..end]);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1500, failure_persistence: None, ..ProptestConfig::default() })]

    /// Flipped bits, pieces left out, pieces doubled, numbers made large.
    #[test]
    fn damage(which in any::<prop::sample::Index>(), at in any::<prop::sample::Index>(), length in 0..40usize, bit in 0..8u32, kind in 0..5u32) {
        let all = good();
        let (file, mut bytes) = all[which.index(all.len())].clone();
        let start = at.index(bytes.len());
        let end = (start + length).min(bytes.len());
        match kind {
            0 => bytes[start] ^= 1 << bit,
            1 => drop(bytes.drain(start..end)),
            2 => {
                let piece = bytes[start..end].repeat(20);
                bytes.splice(start..start, piece).for_each(drop);
            }
            3 => bytes[start..end].fill(b'9'),
            _ => bytes[start..end].fill(0xff),
        }
        survives(&file, &bytes);
    }

    #[test]
    fn noise(which in any::<prop::sample::Index>(), bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let all = good();
        survives(&all[which.index(all.len())].0, &bytes);
    }
}

#[test]
fn what_is_deep_or_long_is_refused() {
    for (file, _) in good() {
        for open in ["[", "{\"a\":", "<a>", "<a b='>' c=''>", "- ", "a: \n ", "{", "? ", "!!a ", "&a "] {
            survives(&file, open.repeat(200_000).as_bytes());
            survives(&file, format!("<opencv_storage>{}", open.repeat(200_000)).as_bytes());
            survives(&file, format!("%YAML:1.0\n---\n{}", open.repeat(200_000)).as_bytes());
        }
        // Well-formed, and deeper than any stack.
        for (open, close) in [("<a>", "</a>"), ("<a b=\"/>\">", "</a>"), ("<a><!--</-->", "</a>"), ("<_>", "</_>")] {
            let deep = format!("{}{}", open.repeat(100_000), close.repeat(100_000));
            survives(&file, deep.as_bytes());
            survives(&file, format!("<opencv_storage>{deep}</opencv_storage>").as_bytes());
        }
        survives(&file, "<a".repeat(4 << 20).as_bytes());
        // A few lines that would be gigabytes.
        let laughs: String =
            (0..9).map(|i| format!("<!ENTITY e{} \"{}\">", i + 1, format!("&e{i};").repeat(10))).collect();
        survives(&file, format!("<!DOCTYPE a [<!ENTITY e0 \"ha\">{laughs}]><a>&e9;</a>").as_bytes());
        let laughs: String =
            (0..9).map(|i| format!("a{}: &a{} [{}]\n", i + 1, i + 1, format!("*a{i},").repeat(10))).collect();
        survives(&file, format!("%YAML:1.0\n---\na0: &a0 ha\n{laughs}").as_bytes());
        survives(&file, &vec![b' '; 9 << 20]);
    }
}
