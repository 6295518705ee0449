//! Files of RoomAlive and of Splash, each by another way than the reader's.
#![expect(clippy::unwrap_used, reason = "tests' helpers: what is given to them must be taken")]

mod common;

use common::{file, load, refused, shared};
use glam::{DMat4, DQuat, DVec2, DVec3, UVec2};
use lantern_calibration::describe::Description;
use lantern_calibration::{Calibration, Convention, Frustum, Matrix4};

const SIZE_PX: UVec2 = UVec2::new(1280, 720);

/// A matrix as RoomAlive writes it: by columns.
fn by_columns(name: &str, columns: &[&[f64]]) -> String {
    let column = |column: &&[f64]| {
        let entries: String = column.iter().map(|entry| format!("<d:double>{entry:?}</d:double>")).collect();
        format!("<d:ArrayOfdouble>{entries}</d:ArrayOfdouble>")
    };
    let columns: String = columns.iter().map(column).collect();
    format!(
        "<{name}><ValuesByColumn xmlns:d=\"http://schemas.microsoft.com/2003/10/Serialization/Arrays\">{columns}</ValuesByColumn></{name}>"
    )
}

fn ensemble(pose: DMat4, radial: [f64; 2]) -> String {
    let columns = pose.to_cols_array_2d();
    let projector = |name: &str| {
        [
            by_columns("cameraMatrix", &[&[961.0, 0.0, 0.0], &[0.0, 955.0, 0.0], &[650.5, 773.25, 1.0]]),
            "<displayIndex>2</displayIndex><height>720</height>".to_owned(),
            by_columns("lensDistortion", &[&radial]),
            format!("<name>{name}</name>"),
            by_columns("pose", &columns.each_ref().map(|column| column.as_slice())),
            "<width>1280</width>".to_owned(),
        ]
        .concat()
    };
    let projectors: String = ["0", "1"]
        .map(|name| {
            format!("<ProjectorCameraEnsemble.Projector>{}</ProjectorCameraEnsemble.Projector>", projector(name))
        })
        .concat();
    format!(
        "\u{feff}<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<ProjectorCameraEnsemble \
         xmlns=\"http://schemas.datacontract.org/2004/07/RoomAliveToolkit\"><cameras/><name>Untitled</name>\
         <projectors>{projectors}</projectors></ProjectorCameraEnsemble>"
    )
}

/// In RoomAlive's own terms: x left and y up of a camera that looks along z, and pixels that grow with both, so that the
/// picture is turned by half a turn at the end.
#[test]
fn roomalive_turned_by_half_a_turn() {
    let turn = DQuat::from_euler(glam::EulerRot::YXZ, 0.4, 0.3, -0.1);
    let world_from_projector = DMat4::from_rotation_translation(turn, DVec3::new(0.5, -0.2, 0.1));
    let radial = [-0.08, 0.02];
    let (_folder, path) = file(ensemble(world_from_projector, radial));
    let frustum = load(&path, "roomalive", SIZE_PX, "entry = \"1\"");
    for (x, y, depth) in [(0.0, 0.0, 2.0), (0.3, -0.2, 1.0), (-0.4, -0.6, 3.0), (0.5, -0.1, 0.5)] {
        let at_m = world_from_projector.transform_point3(DVec3::new(x, y, 1.0) * depth);
        let r2 = x * x + y * y;
        let bent = DVec2::new(x, y) * (1.0 + radial[0] * r2 + radial[1] * r2 * r2);
        let theirs = DVec2::new(961.0, 955.0) * bent + DVec2::new(650.5, 773.25);
        let expected_px = DVec2::new(1280.0, 720.0) - theirs + 0.5;
        let found_px = frustum.project(at_m).unwrap().place_px;
        assert!(found_px.distance(expected_px) < 1e-8, "{found_px} {expected_px}");
    }
    // Not mirrored, and up is up.
    let middle = Description::of(&frustum).middle.unwrap();
    assert!(!middle.mirrored && middle.up.dot(turn * DVec3::Y) > 0.9);
}

#[test]
fn a_real_office() {
    let Some(path) = shared("roomalive-office.xml") else { return };
    let frustum = load(&path, "roomalive", SIZE_PX, "");
    let seen = Description::of(&frustum);
    // Its pose is world from projector, so it stands where the last column says, and looks along the third.
    assert!(seen.position_m.unwrap().distance(DVec3::new(-0.016519, -0.098981, 0.040908)) < 1e-6);
    assert!(seen.axis.distance(DVec3::new(-0.009104, 0.392044, 0.919902)) < 1e-5, "{}", seen.axis);
    let middle = seen.middle.unwrap();
    assert!(!middle.mirrored && middle.up.y > 0.7, "{middle:?}");
    let said = refused(&path, "roomalive", SIZE_PX, "unit = \"mm\"");
    assert!(said.contains("says \"m\", and `unit` says \"mm\""), "{said}");
    assert!(refused(&path, "roomalive", UVec2::new(1280, 800), "").contains("made for 1280 × 720 pixels"));
}

#[test]
fn ensembles_that_are_none() {
    let good = ensemble(DMat4::IDENTITY, [0.0; 2]);
    let said = |old: &str, new: &str| {
        assert!(good.contains(old), "{old}");
        let (_folder, path) = file(good.replace(old, new));
        refused(&path, "roomalive", SIZE_PX, "entry = \"0\"")
    };
    for (old, new, words) in [
        ("ProjectorCameraEnsemble", "Ensemble", "its root is <Ensemble>"),
        ("<name>0<", "<name>2<", "has no projector \"0\"; hint: there are \"2\", \"1\""),
        ("<height>720<", "<height>720.5<", "its image is 1280 × 720.5 pixels"),
        ("<height>720<", "<height>-720<", "its image is 1280 × -720 pixels"),
        ("961.0", "-961.0", "cameraMatrix has no focal lengths"),
        ("961.0", "1e999", "no finite number"),
        ("<d:double>773.25</d:double>", "", "a column of cameraMatrix has 2 numbers, not 3"),
        ("lensDistortion", "lens", "has no <lensDistortion>"),
        ("<width>", "<wide>", "RoomAlive"),
    ] {
        let said = said(old, new);
        assert!(said.contains(words) && said.contains("hint:"), "{said} does not say {words}");
    }
    let (_folder, path) = file(&good);
    assert!(refused(&path, "roomalive", SIZE_PX, "").contains("several projectors, and `entry` names none"));
    // What was stored by rows has its translation where the last row should be 0 0 0 1.
    let by_rows = DMat4::from_translation(DVec3::new(1.0, 2.0, 3.0)).transpose();
    let (_folder, path) = file(ensemble(by_rows, [0.0; 2]));
    assert!(refused(&path, "roomalive", SIZE_PX, "entry = \"0\"").contains("pose has no last row of 0 0 0 1"));
    let flat = DMat4::from_cols_array_2d(&[[1.0, 0.0, 0.0, 0.0], [0.0; 4], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]);
    let (_folder, path) = file(ensemble(flat, [0.0; 2]));
    assert!(refused(&path, "roomalive", SIZE_PX, "entry = \"0\"").contains("pose cannot be inverted"));
}

const SPLASH: &str = include_str!("formats/stage.json");

/// By OpenGL's own functions: a look-at and a frustum of left, right, bottom and top.
fn by_opengl(eye: DVec3, target: DVec3, fov_deg: f64, [cx, cy]: [f64; 2]) -> Frustum {
    let near = 0.1;
    let t = near * (fov_deg.to_radians() / 2.0).tan();
    let wide = t * 1280.0 / 720.0;
    let (top, bottom) = (t * (1.0 - 2.0 * (cy - 0.5)), -t * (1.0 + 2.0 * (cy - 0.5)));
    let (right, left) = (wide * (1.0 - 2.0 * (cx - 0.5)), -wide * (1.0 + 2.0 * (cx - 0.5)));
    let projection: Matrix4 = [
        [2.0 * near / (right - left), 0.0, (right + left) / (right - left), 0.0],
        [0.0, 2.0 * near / (top - bottom), (top + bottom) / (top - bottom), 0.0],
        [0.0, 0.0, -1.0, -2.0 * near],
        [0.0, 0.0, -1.0, 0.0],
    ];
    // gluLookAt's rows: side, up, and against the way that it looks.
    let ahead = (target - eye).normalize();
    let side = ahead.cross(DVec3::Z).normalize();
    let row = |axis: DVec3| [axis.x, axis.y, axis.z, -axis.dot(eye)];
    let rows: Matrix4 = [row(side), row(side.cross(ahead)), row(-ahead), [0.0, 0.0, 0.0, 1.0]];
    Frustum::new(Calibration::from_matrices(&projection, &rows, Convention::OpenGl, SIZE_PX).unwrap())
}

#[test]
fn splash_by_the_functions_of_opengl() {
    let (_folder, path) = file(SPLASH);
    for (entry, expected) in [
        ("cam1", by_opengl(DVec3::new(1.0, 2.0, 1.5), DVec3::new(0.2, 0.0, 0.4), 35.0, [0.45, 0.8])),
        ("cam2", by_opengl(DVec3::Z, DVec3::new(0.0, 1.0, 1.0), 50.0, [0.5, 0.5])),
    ] {
        let found = load(&path, "splash", SIZE_PX, &format!("unit = \"m\"\nentry = {entry:?}"));
        for at in [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE, DVec2::new(0.3, 0.6)] {
            let place_px = at * SIZE_PX.as_dvec2();
            let (found, expected) = (found.ray(place_px).unwrap(), expected.ray(place_px).unwrap());
            assert!(found.direction.distance(expected.direction) < 1e-12, "{entry} at {at}");
            assert!(found.origin_m.distance(expected.origin_m) < 1e-12, "{entry} at {at}");
        }
    }
    // A principal point high in the image leaves little above it.
    let middle = Description::of(&load(&path, "splash", SIZE_PX, "unit = \"m\"\nentry = \"cam1\"")).lens_shift.unwrap();
    assert!((middle - DVec2::new(0.05, -0.3)).length() < 1e-12, "{middle}");
}

#[test]
fn splash_files_that_are_none() {
    let said = |old: &str, new: &str| {
        assert!(SPLASH.contains(old), "{old}");
        let (_folder, path) = file(SPLASH.replacen(old, new, 1));
        refused(&path, "splash", SIZE_PX, "unit = \"m\"\nentry = \"cam1\"")
    };
    for (old, new, words) in [
        ("\"cam1\"", "\"cam3\"", "has no camera \"cam1\"; hint: there are \"cam3\", \"cam2\""),
        ("\"fov\" : [35.0],", "", "the camera has no fov"),
        ("[35.0]", "[180]", "fov is 180 degrees"),
        ("[35.0]", "\"wide\"", "fov is \"wide\", not 1 numbers"),
        ("[0.2, 0.0, 0.4]", "[1.0, 2.0, 1.5]", "do not span a plane"),
        ("[0.2, 0.0, 0.4]", "[1.0, 2.0, 7]", "do not span a plane"),
        ("[0.2, 0.0, 0.4]", "[0.2, 0.0]", "target is [0.2,0.0], not 3 numbers"),
        ("[1280, 720]", "[1280, 0]", "size is 1280 × 0"),
        ("[1280, 720]", "[1920, 1200]", "made for 1920 × 1200 pixels"),
        ("{", "", "is not readable as a Splash configuration"),
    ] {
        let said = said(old, new);
        assert!(said.contains(words) && said.contains("hint:"), "{said} does not say {words}");
    }
    let (_folder, path) = file(SPLASH);
    assert!(refused(&path, "splash", SIZE_PX, "entry = \"cam1\"").contains("does not say in what unit"));
    assert!(refused(&path, "splash", SIZE_PX, "unit = \"m\"").contains("several cameras, and `entry` names none"));
    // What it says of depth is taken, in its own unit.
    let (_folder, path) = file(SPLASH.replace("\"fov\" : [35.0]", "\"fov\" : 35, \"near\" : 50, \"far\" : [4000.0]"));
    let middle = Description::of(&load(&path, "splash", SIZE_PX, "unit = \"mm\"\nentry = \"cam1\"")).middle.unwrap();
    assert!((middle.far_m / middle.near_m - 80.0).abs() < 1e-6, "{middle:?}");
}
