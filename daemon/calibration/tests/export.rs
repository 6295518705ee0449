//! What is exported and loaded again gives the same rays.
#![expect(clippy::unwrap_used, reason = "tests' helpers: what is given to them must be taken")]

mod common;

use std::io::{Cursor, Read};
use std::path::Path;

use common::{file, fixture, load};
use glam::{DVec2, UVec2, Vec3};
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
        match mpcdi(&calibration, "left") {
            Err(ExportError::NoFrustum(why)) => why,
            other => panic!("{other:?}"),
        }
    };
    let depth = [0.0, 0.0, -1.0, -0.2];
    assert_eq!(
        of([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], depth, [0.1, 0.2, -1.0, 0.0]]),
        "its image is sheared or keystoned"
    );
    assert_eq!(
        of([[1.0, 0.1, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], depth, [0.0, 0.0, -1.0, 0.0]]),
        "its image is sheared or keystoned"
    );
    assert_eq!(
        of([[-1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], depth, [0.0, 0.0, -1.0, 0.0]]),
        "its image is mirrored"
    );
    assert_eq!(of(identity), "its rays are parallel");
}
