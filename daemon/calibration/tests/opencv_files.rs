//! Files of OpenCV against what OpenCV's own `cv2.projectPoints` made of the same cameras.
#![expect(clippy::unwrap_used, reason = "tests' helpers: what is given to them must be taken")]

mod common;

use std::fs;

use common::{file, fixture, load, refused, shared};
use glam::{DVec2, DVec3, UVec2};
use lantern_calibration::Frustum;
use lantern_calibration::describe::Description;

const SIZE_PX: UVec2 = UVec2::new(1280, 720);

/// The points of a camera in opencv/points.txt, and where OpenCV saw them, continuous px.
fn points(camera: &str) -> Vec<(DVec3, DVec2)> {
    let lines = include_str!("opencv/points.txt").lines();
    let of_camera = lines.skip_while(|line| !line.starts_with(&format!("lens {camera} "))).skip(1);
    let points = of_camera.take_while(|line| line.starts_with("point")).map(|line| {
        let n: Vec<f64> = line.split_whitespace().skip(1).map(|word| word.parse().unwrap()).collect();
        (DVec3::new(n[0], n[1], n[2]), DVec2::new(n[3], n[4]) + 0.5)
    });
    let points: Vec<_> = points.collect();
    assert!(points.len() > 50);
    points
}

#[track_caller]
fn agrees(frustum: &Frustum, camera: &str, scale: DVec2) {
    let mut worst_px = 0.0f64;
    for (at_m, expected_px) in points(camera) {
        let found_px = frustum.project(at_m).unwrap().place_px;
        worst_px = worst_px.max(found_px.distance(expected_px * scale));
        // And the ray of that place goes through the point.
        let ray = frustum.ray(expected_px * scale).unwrap();
        let off_m = (at_m - ray.origin_m).reject_from_normalized(ray.direction).length();
        assert!(off_m < 1e-6, "{camera}: the ray misses by {off_m} m");
    }
    // The points are stored to a millionth of a pixel.
    assert!(worst_px < 1e-5, "{camera}: {worst_px} px");
}

#[test]
fn every_syntax_and_key_set_gives_the_pixels_of_opencv() {
    let mut read = 0;
    for name in ["procam", "procamcalib", "sample", "several"] {
        for ending in ["4.yml", "4.xml", "4.json", "5.yml"] {
            let path = fixture(&format!("{name}-{ending}"));
            let entry = if name == "several" { "entry = \"decentred\"\n" } else { "" };
            let frustum = load(&path, "opencv", SIZE_PX, &format!("{entry}unit = \"mm\""));
            agrees(&frustum, "decentred", DVec2::ONE);
            read += 1;
        }
    }
    assert_eq!(read, 16);
    let shifted =
        load(&fixture("several-4.yml"), "opencv", UVec2::new(1280, 800), "entry = \"shifted\"\nunit = \"mm\"");
    agrees(&shifted, "shifted", DVec2::ONE);
}

#[test]
fn a_projector_may_have_more_pixels_than_the_file() {
    let path = fixture("procam-4.yml");
    let keys = "unit = \"mm\"\nresolution_px = [1280, 720]\nnear_m = 0.05\nfar_m = 20\nconvention = \"opengl\"";
    agrees(&load(&path, "opencv", UVec2::new(3840, 2160), keys), "decentred", DVec2::splat(3.0));

    let said = refused(&path, "opencv", UVec2::new(1280, 800), keys);
    assert!(
        said.contains(
            "wrong resolution: it was made for 1280 × 720 pixels, and the projector has 1280 × 800; hint: set the \
             projector's resolution_px"
        ),
        "{said}"
    );
    // A file that states its image is believed, and contradicting it is refused.
    let said = refused(&fixture("sample-4.yml"), "opencv", SIZE_PX, "unit = \"mm\"\nresolution_px = [1920, 1080]");
    assert!(said.contains("says 1280 × 720 pixels, and `resolution_px` says 1920 × 1080 pixels"), "{said}");
    let said = refused(&fixture("sample-4.yml"), "opencv", UVec2::new(1280, 800), "unit = \"mm\"");
    assert!(said.contains("made for 1280 × 720"), "{said}");
}

#[test]
fn the_worlds_frame_and_scale_are_the_configurations() {
    // Our x is the file's y, our y its z, our z its x; our world is twice as large, and a step aside.
    let keys = "unit = \"mm\"\nworld_from_file = [[0, 2, 0, 1], [0, 0, 2, 0], [2, 0, 0, 0], [0, 0, 0, 1]]";
    let frustum = load(&fixture("procam-4.xml"), "opencv", SIZE_PX, keys);
    let mut farther = 0.0f64;
    for (at_m, expected_px) in points("decentred") {
        let found = frustum.project(DVec3::new(2.0 * at_m.y + 1.0, 2.0 * at_m.z, 2.0 * at_m.x)).unwrap();
        assert!(found.place_px.distance(expected_px) < 1e-5);
        farther = farther.max(found.clip_w);
    }
    // Depth stays in metres of ours: points of 0.4 to 6 m are at 0.8 to 12.
    assert!(farther > 6.0 && farther < 12.0, "{farther}");
    let near_m = Description::of(&frustum).middle.unwrap().near_m;
    assert!((0.1..0.12).contains(&near_m), "{near_m}");
}

#[test]
fn what_the_file_does_not_say_the_configuration_must() {
    let said = refused(&fixture("procam-4.yml"), "opencv", SIZE_PX, "");
    let expected = "does not say in what unit its lengths are; hint: add unit = \"mm\", \"cm\", \"dm\", \"m\", \"in\", \
                    \"ft\", \"yd\" to [projector.calibration]";
    assert!(said.ends_with(expected), "{said}");
    let said = refused(&fixture("several-4.yml"), "opencv", SIZE_PX, "unit = \"mm\"");
    assert!(
        said.contains("has several projectors, and `entry` names none; hint: there are \"decentred\", \"shifted\""),
        "{said}"
    );
    let said = refused(&fixture("several-4.yml"), "opencv", SIZE_PX, "unit = \"mm\"\nentry = \"left\"");
    assert!(said.contains("has no projector \"left\"; hint: there are"), "{said}");

    let text = fs::read_to_string(fixture("sample-4.yml")).unwrap();
    let (_folder, path) = file(text.split("rvec").next().unwrap());
    let said = refused(&path, "opencv", SIZE_PX, "unit = \"mm\"");
    assert!(said.contains("does not say where the projector stands (no R and T); hint: add view ="), "{said}");

    // The pose of points.txt in metres, in the order that is said.
    let lens = include_str!("opencv/points.txt").lines().find(|line| line.starts_with("lens decentred")).unwrap();
    let n: Vec<f64> = lens.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    let row = |i: usize| [n[11 + 3 * i], n[12 + 3 * i], n[13 + 3 * i], n[20 + i]];
    let view = [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]];
    agrees(&load(&path, "opencv", SIZE_PX, &format!("unit = \"mm\"\nview = {view:?}")), "decentred", DVec2::ONE);
    // Then the file has no length, and a unit says nothing.
    agrees(&load(&path, "opencv", SIZE_PX, &format!("view = {view:?}")), "decentred", DVec2::ONE);
    let said = refused(&fixture("sample-4.yml"), "opencv", SIZE_PX, &format!("unit = \"mm\"\nview = {view:?}"));
    assert!(said.contains("and `view` says so as well"), "{said}");
}

#[test]
fn stored_by_columns() {
    // Written by something that stores columns: the camera matrix and the rotation are transposed.
    let text = fs::read_to_string(fixture("procam-4.yml")).unwrap();
    let transposed = |text: &str, name: &str| {
        let (before, after) = text.split_once(&format!("{name}: !!opencv-matrix")).unwrap();
        let (head, rest) = after.split_once('[').unwrap();
        let (data, rest) = rest.split_once(']').unwrap();
        let n: Vec<&str> = data.split(',').map(str::trim).collect();
        let columns: Vec<&str> = (0..9).map(|i| n[i % 3 * 3 + i / 3]).collect();
        format!("{before}{name}: !!opencv-matrix{head}[ {} ]{rest}", columns.join(", "))
    };
    let by_columns = transposed(&transposed(&text, "proj_int"), "roration");
    let (_folder, path) = file(&by_columns);
    let said = refused(&path, "opencv", SIZE_PX, "unit = \"mm\"");
    let expected = "proj_int looks transposed: the principal point is in the last row; set order = \"column\"; hint: \
                    matrices are read row by row";
    assert!(said.ends_with(expected), "{said}");
    agrees(&load(&path, "opencv", SIZE_PX, "unit = \"mm\"\norder = \"column\""), "decentred", DVec2::ONE);
    let said = refused(&fixture("procam-4.yml"), "opencv", SIZE_PX, "unit = \"mm\"\norder = \"column\"");
    assert!(said.contains("set order = \"row\""), "{said}");
}

#[test]
fn what_cannot_be_right_is_said() {
    let text = fs::read_to_string(fixture("sample-4.yml")).unwrap();
    let said = |old: &str, new: &str| {
        assert!(text.contains(old), "{old}");
        let (_folder, path) = file(text.replacen(old, new, 1));
        refused(&path, "opencv", SIZE_PX, "unit = \"mm\"")
    };
    for (old, new, words) in [
        ("[ 1000., 0., 655.", "[ 1000., 3., 655.", "has a skew of 3, which is not built"),
        ("[ 1000., 0., 655.", "[ -1000., 0., 655.", "has focal lengths of -1000 and 1010"),
        ("[ 1000., 0., 655.", "[ 0., 0., 655.", "has focal lengths of 0 and 1010"),
        ("[ 1000., 0., 655.", "[ .Nan, 0., 655.", "no finite number"),
        ("[ 1000., 0., 655.", "[ 1000., 655.", "is said to be 3 × 3, and has 8 numbers"),
        ("rows: 3\n   cols: 3", "rows: 999999999\n   cols: 3", "is 999999999"),
        ("camera_matrix: ", "matrix: ", "no camera matrix in it: none of proj_int, proj_K, camera_matrix"),
        ("cols: 5", "cols: 6", "is said to be 1 × 6"),
        ("image_width: 1280", "image_width: &a 1280\nother: *a", "aliases are not read"),
        ("0., 0., 1. ]", "0., 0.1, 1. ]", "is no camera matrix"),
    ] {
        let said = said(old, new);
        assert!(said.contains(words) && said.contains("hint:"), "{said} does not say {words}");
    }
    let (_folder, path) = file("{\"camera_matrix\": 3}");
    assert!(refused(&path, "opencv", SIZE_PX, "").contains("camera_matrix has no rows"));
    let (_folder, path) = file("<opencv_storage/>");
    assert!(refused(&path, "opencv", SIZE_PX, "").contains("no camera matrix"));
    let (_folder, path) = file("");
    assert!(refused(&path, "opencv", SIZE_PX, "").contains("nothing is in it"));
    let (folder, _) = file("");
    assert!(refused(&folder.path().join("none"), "opencv", SIZE_PX, "").contains("cannot be read"));
    assert!(refused(folder.path(), "opencv", SIZE_PX, "").contains("cannot be read"));
}

#[test]
fn more_coefficients_than_are_built_are_refused_and_zeros_are_none() {
    let text = fs::read_to_string(fixture("procam-4.yml")).unwrap();
    let grown = |more: &str| {
        let text = text.replace("0.0040000000000000001 ]", &format!("0.004, {more} ]"));
        text.replacen("cols: 5", "cols: 8", 2).replacen("cols: 8", "cols: 5", 1)
    };
    let (_folder, path) = file(grown("0., 0., 0."));
    agrees(&load(&path, "opencv", SIZE_PX, "unit = \"mm\""), "decentred", DVec2::ONE);
    let (_folder, path) = file(grown("0., 0.1, 0."));
    let said = refused(&path, "opencv", SIZE_PX, "unit = \"mm\"");
    assert!(said.contains("coefficients beyond k1, k2, p1, p2 and k3"), "{said}");
}

#[test]
fn a_mirrored_world_is_left_handed() {
    let text = fs::read_to_string(fixture("procamcalib-4.yml")).unwrap();
    let mirror = |text: &str| {
        let (before, after) = text.split_once("R: !!opencv-matrix").unwrap();
        let (head, rest) = after.split_once('[').unwrap();
        let (data, rest) = rest.split_once(']').unwrap();
        let n: Vec<f64> = data.split(',').map(|n| n.trim().parse().unwrap()).collect();
        let n: Vec<String> =
            n.iter().enumerate().map(|(i, n)| format!("{:?}", if i % 3 == 2 { -n } else { *n })).collect();
        format!("{before}R: !!opencv-matrix{head}[ {} ]{rest}", n.join(", "))
    };
    let (_folder, path) = file(mirror(&text));
    let said = refused(&path, "opencv", SIZE_PX, "unit = \"mm\"");
    let expected = "left-handed: its axes mirror the world, as no projector's do; hint: if its world is left-handed (Unity, \
                    Unreal), set world_from_file = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]";
    assert!(said.ends_with(expected), "{said}");
    let keys = "unit = \"mm\"\nworld_from_file = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]";
    // A mirrored world mirrored again is the one that the points are in.
    agrees(&load(&path, "opencv", SIZE_PX, keys), "decentred", DVec2::ONE);
    let said = refused(&fixture("procamcalib-4.yml"), "opencv", SIZE_PX, keys);
    assert!(said.contains("world_from_file mirrors a world that is right-handed already"), "{said}");
}

#[test]
fn a_real_pair_of_camera_and_projector() {
    let Some(path) = shared("opencv-procam.xml") else { return };
    let frustum = load(&path, "opencv", UVec2::new(1280, 800), "unit = \"mm\"");
    let seen = Description::of(&frustum);
    // −Rᵀ·T of its numbers, by hand: 91 mm to the left of the camera, 620 mm below it (y is down), 150 mm ahead.
    let at_m = seen.position_m.unwrap();
    assert!(at_m.distance(DVec3::new(-0.0913, 0.6198, 0.1502)) < 2e-3, "{at_m}");
}
