//! What is exported and loaded again gives the same rays.
#![expect(clippy::unwrap_used, reason = "tests' helpers: what is given to them must be taken")]

mod common;

use std::io::{Cursor, Read};
use std::path::Path;

use common::{file, fixture, load};
use glam::{DMat3, DVec2, DVec3, EulerRot, UVec2, Vec3};
use lantern_calibration::export::{ExportError, matrices, mpcdi};
use lantern_calibration::{Calibration, Convention, Frustum, Map, Maps};
use lantern_config::Config;

const SIZE_PX: UVec2 = UVec2::new(1280, 720);

/// At the middles of pixels, which is where a warp is exact.
#[track_caller]
fn same_rays(a: &Frustum, b: &Frustum) {
    for (column, row) in (0..=8).flat_map(|row| (0..=8).map(move |column| (column, row))) {
        let place_px = (DVec2::new(f64::from(column), f64::from(row)) / 8.0 * (SIZE_PX.as_dvec2() - 1.0)).floor() + 0.5;
        let (a, b) = (a.ray(place_px).unwrap(), b.ray(place_px).unwrap());
        assert!(a.direction.distance(b.direction) < 1e-6, "{place_px}: {} and {}", a.direction, b.direction);
        assert!(b.direction.cross(b.origin_m - a.origin_m).length() < 1e-6, "{place_px}");
    }
}

fn pinhole() -> Frustum {
    load(&fixture("shaded.mpcdi.xml"), "mpcdi", SIZE_PX, "unit = \"m\"\nfar_m = 20\nconvention = \"opengl\"")
}

fn distorted() -> Frustum {
    load(&fixture("sample-4.yml"), "opencv", SIZE_PX, "unit = \"mm\"")
}

#[test]
fn matrices_come_back() {
    let original = pinhole();
    let exported = matrices(original.calibration());
    assert_eq!(exported.left_out, Vec::<String>::new());
    let text = format!(
        "[[projector]]\nname = \"a\"\nresolution_px = [1280, 720]\n{}",
        String::from_utf8(exported.bytes).unwrap()
    );
    let config = Config::parse(&text, "lab.toml", Path::new(".")).unwrap();
    let back = Calibration::from_config(&config.projectors[0]).unwrap();
    // To the bit: the matrix is all that there is.
    assert_eq!(&back, original.calibration());

    let exported = matrices(distorted().calibration());
    assert_eq!(exported.left_out, ["its lens, which is no part of a matrix: straight lines stay straight"]);
    assert!(exported.bytes.starts_with(b"# Not in here: its lens"));
}

#[test]
fn mpcdi_comes_back() {
    for original in [pinhole(), distorted()] {
        let exported = mpcdi(original.calibration(), "left & right").unwrap();
        assert!(exported.left_out[0].contains("set unit = \"m\" where it is loaded"), "{:?}", exported.left_out);
        let (_folder, path) = file(exported.bytes);
        same_rays(&original, &load(&path, "mpcdi", SIZE_PX, "unit = \"m\"\nentry = \"left _ right\""));
    }
}

/// Projectors as people write them down: a shifted lens, turned somehow, each number with so many decimals.
fn written_with(decimals: i32, [yaw, pitch, roll]: [f64; 3]) -> Calibration {
    let eye_from_world = DMat3::from_euler(EulerRot::YXZ, yaw, pitch, roll).transpose();
    let stands_m = DVec3::new(1.3, -0.7, 2.9);
    let moved = eye_from_world * -stands_m;
    let rounded = |value: f64| (value * 10.0f64.powi(decimals)).round() / 10.0f64.powi(decimals);
    let view = [0, 1, 2].map(|i| eye_from_world.row(i).extend(moved[i]).to_array().map(rounded));
    let view = [view[0], view[1], view[2], [0.0, 0.0, 0.0, 1.0]];
    let projection = [[2.0, 0.0, 0.1, 0.0], [0.0, 3.55, 0.9, 0.0], [0.0, 0.0, -1.0, -0.2], [0.0, 0.0, -1.0, 0.0]];
    Calibration::from_matrices(&projection, &view, Convention::OpenGl, SIZE_PX).unwrap()
}

#[test]
fn six_decimals_make_a_frustum_that_is_off_by_what_is_stated() {
    let mut worst_px = 0.0f64;
    for i in 0..60 {
        let angle = |step: f64| (f64::from(i) * step) % 3.0 - 1.5;
        let original = Frustum::new(written_with(6, [angle(0.37), angle(0.71) * 0.6, angle(1.13)]));
        let exported = mpcdi(original.calibration(), "left").unwrap();
        let said = exported.left_out.iter().find_map(|line| line.strip_prefix("its shear and keystone, of up to "));
        let said_px = said.map_or(0.0, |said| said.split_once(" px").unwrap().0.parse::<f64>().unwrap());

        let (_folder, path) = file(exported.bytes);
        let back = load(&path, "mpcdi", SIZE_PX, "unit = \"m\"");
        let places = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE, DVec2::splat(0.5), DVec2::new(0.9, 0.2)];
        for place_px in places.map(|share| share * SIZE_PX.as_dvec2()) {
            let found_px = back.project(original.ray(place_px).unwrap().at(3.0)).unwrap().place_px;
            let off_px = found_px.distance(place_px);
            // It is said to six decimals.
            assert!(off_px <= said_px + 1e-6, "{off_px} px, and {said_px} are said: {:?}", exported.left_out);
            worst_px = worst_px.max(off_px);
        }
    }
    // There is something to state.
    assert!(worst_px > 1e-4 && worst_px < 0.01, "{worst_px}");

    // What is exact says nothing of it.
    let exact = mpcdi(pinhole().calibration(), "left").unwrap();
    assert!(!exact.left_out.iter().any(|line| line.contains("shear")), "{:?}", exact.left_out);
    let coarse = mpcdi(&written_with(3, [0.4, -0.3, 0.2]), "left");
    let Err(ExportError::NotRectangular { off_px }) = coarse else { panic!("{coarse:?}") };
    assert!((0.05..2.0).contains(&off_px), "{off_px}");
}

#[test]
fn maps_come_back_in_sixteen_bits() {
    let values: Vec<Vec3> = (0..6u8).map(|i| Vec3::new(0.1, 0.2, 0.3) * f32::from(i) * 0.5).collect();
    let map = Map { size: UVec2::new(3, 2), values };
    let maps = Maps { alpha: Some(map.clone()), beta: Some(map) };
    let calibration = pinhole().calibration().clone().with_maps(maps.clone()).unwrap();
    let exported = mpcdi(&calibration, "left").unwrap();
    let mut xml = String::new();
    let mut archive = zip::ZipArchive::new(Cursor::new(&exported.bytes)).unwrap();
    archive.by_name("mpcdi.xml").unwrap().read_to_string(&mut xml).unwrap();
    // A beta map has no gamma of its own in MPCDI.
    assert!(xml.contains("<bitdepth>16</bitdepth></betaMap>"), "{xml}");
    assert!(xml.contains("<gammaEmbedded>1</gammaEmbedded></alphaMap>"), "{xml}");
    let (_folder, path) = file(exported.bytes);
    let back = load(&path, "mpcdi", SIZE_PX, "unit = \"m\"");
    for (back, map) in [(&back.calibration().maps().alpha, &maps.alpha), (&back.calibration().maps().beta, &maps.beta)]
    {
        let (back, map) = (back.as_ref().unwrap(), map.as_ref().unwrap());
        assert_eq!(back.size, map.size);
        for (a, b) in back.values.iter().zip(&map.values) {
            assert!((*a - *b).abs().max_element() < 1e-5, "{a} {b}");
        }
    }
    assert_eq!(matrices(&calibration).left_out, ["its alpha and beta maps"]);
}

#[test]
fn what_mpcdi_has_no_frustum_for_is_refused() {
    let identity = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    let of = |projection: [[f64; 4]; 4]| {
        let calibration = Calibration::from_matrices(&projection, &identity, Convention::OpenGl, SIZE_PX).unwrap();
        mpcdi(&calibration, "left").unwrap_err().to_string()
    };
    let words = |why: &str| format!("MPCDI has no frustum for it: {why}; hint: --format matrices holds any matrix");
    let depth = [0.0, 0.0, -1.0, -0.2];
    let keystoned = of([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], depth, [0.1, 0.2, -1.0, 0.0]]);
    assert!(keystoned.starts_with("MPCDI has no frustum for it: its image is sheared or keystoned by "), "{keystoned}");
    let sheared = of([[1.0, 0.1, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], depth, [0.0, 0.0, -1.0, 0.0]]);
    assert!(sheared.contains("its image is sheared or keystoned by "), "{sheared}");
    let mirrored = of([[-1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], depth, [0.0, 0.0, -1.0, 0.0]]);
    assert_eq!(mirrored, words("its image is mirrored"));
    assert_eq!(of(identity), words("its rays are parallel"));
}
