//! The doctor: each ailment in its exact words, and no alarm over good calibrations.
#![expect(clippy::unwrap_used, reason = "tests' helpers: what is given to them must be taken")]

use std::path::Path;

use glam::{DMat4, DQuat, DVec3, DVec4, UVec2};
use lantern_calibration::doctor::{Ailment, Finding, Props, examine, nothing_in_view};
use lantern_calibration::{Calibration, Matrix4};
use lantern_config::{Calibration as Configured, Config, Projector};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

/// What is lit in these tests: half a metre to either side of the origin.
const PROPS: Props = Props { low_m: DVec3::splat(-0.5), high_m: DVec3::splat(0.5) };

/// A projector 2 m before the props and 1 m above, looking at them: 16:10, its lens shifted up by a tenth.
const GOOD: &str = r#"
[[projector]]
name = "left"
resolution_px = [1280, 800]
[projector.calibration]
convention = "opengl"
projection = [[2, 0, 0, 0], [0, 3.2, 0.2, 0], [0, 0, -1.01, -0.201], [0, 0, -1, 0]]
view = [[1, 0, 0, 0], [0, 0.8944271909999159, -0.4472135954999579, 0], [0, 0.4472135954999579, 0.8944271909999159, -2.23606797749979], [0, 0, 0, 1]]
"#;

fn projector(text: &str) -> Projector {
    let config = Config::parse(text, "lab.toml", Path::new("."));
    config.unwrap_or_else(|problems| panic!("{problems:?}\n{text}")).projectors.remove(0)
}

fn findings(projector: &Projector, props: Option<&Props>) -> Vec<Finding> {
    examine(&projector.calibration, &Calibration::from_config(projector).unwrap(), props)
}

/// The one thing that is said after changes of the good one.
#[track_caller]
fn one(changes: &[(&str, &str)]) -> Finding {
    let text = changes.iter().fold(GOOD.to_owned(), |text, (old, new)| {
        assert!(text.contains(old), "{old}");
        text.replace(old, new)
    });
    let found = findings(&projector(&text), Some(&PROPS));
    let [finding] = found.as_slice() else { panic!("not one finding: {found:#?}\n{text}") };
    finding.clone()
}

#[track_caller]
fn says(finding: &Finding, ailment: Ailment, certain: bool, key: &str, words: &str) {
    assert_eq!((finding.ailment, finding.certain, finding.key), (ailment, certain, key), "{finding}");
    assert_eq!(finding.to_string(), words);
}

const VIEW: &str = "view = [[1, 0, 0, 0], [0, 0.8944271909999159, -0.4472135954999579, 0], [0, 0.4472135954999579, 0.8944271909999159, -2.23606797749979], [0, 0, 0, 1]]";
const VIEW_BY_COLUMNS: &str = "view = [[1, 0, 0, 0], [0, 0.8944271909999159, 0.4472135954999579, 0], [0, -0.4472135954999579, 0.8944271909999159, 0], [0, 0, -2.23606797749979, 1]]";
const PROJECTION: &str = "projection = [[2, 0, 0, 0], [0, 3.2, 0.2, 0], [0, 0, -1.01, -0.201], [0, 0, -1, 0]]";
const PROJECTION_BY_COLUMNS: &str =
    "projection = [[2, 0, 0, 0], [0, 3.2, 0, 0], [0, 0.2, -1.01, -1], [0, 0, -0.201, 0]]";

#[test]
fn the_projector_that_the_others_change_is_good() {
    assert_eq!(findings(&projector(GOOD), Some(&PROPS)), []);
    assert_eq!(findings(&projector(GOOD), None), []);
}

#[test]
fn transposed() {
    let words = "looks transposed: the translation is in the last row; set order = \"column\"; hint: the translation stands in \
                 the last column of a matrix that is written row by row";
    let both = [(VIEW, VIEW_BY_COLUMNS), (PROJECTION, PROJECTION_BY_COLUMNS)];
    says(&one(&both), Ailment::Transposed, true, "view", words);
    // What it says is right: then nothing is wrong.
    let cured = both.iter().fold(GOOD.to_owned(), |text, (old, new)| text.replace(old, new)) + "order = \"column\"\n";
    assert_eq!(findings(&projector(&cured), Some(&PROPS)), []);
    let sick = format!("{GOOD}order = \"column\"\n");
    let finding = findings(&projector(&sick), Some(&PROPS)).remove(0);
    assert!(finding.message.ends_with("looks transposed: the translation is in the last row; set order = \"row\""));

    let view_alone = one(&[(VIEW, VIEW_BY_COLUMNS)]);
    let words = "`view` looks transposed: the translation is in the last row; hint: write it in the order of `projection`, \
                 which is not transposed";
    says(&view_alone, Ailment::Transposed, true, "view", words);
    let words = "`projection` looks transposed: the perspective is in the last column; hint: write it in the order of `view`, \
                 which is not transposed";
    let symmetric = PROJECTION_BY_COLUMNS.replace("0.2, -1.01", "0, -1.01");
    says(&one(&[(PROJECTION, &symmetric)]), Ailment::Transposed, true, "projection", words);
    let words = "looks transposed: the perspective is in the last column; set order = \"column\"; hint: the perspective, 0 0 -1 0 \
                 or 0 0 1 0, is the last row of a matrix that is written row by row";
    let at_origin = VIEW.replace("-2.23606797749979", "0");
    says(&one(&[(PROJECTION, &symmetric), (VIEW, &at_origin)]), Ailment::Transposed, true, "projection", words);
}

#[test]
fn mirrored() {
    let finding = one(&[("[[2, 0, 0, 0], [0, 3.2", "[[-2, 0, 0, 0], [0, 3.2")]);
    let words = "mirrored: the image is the wrong way round; hint: keep it for a rear projection; else negate the first row of \
                 `projection`, or set the other convention";
    says(&finding, Ailment::Mirrored, false, "projection", words);
    let words = "mirrored: the image is upside down and the wrong way round, as where y runs the other way; hint: set \
                 convention = \"vulkan\"";
    says(&one(&[("0, 3.2, 0.2, 0", "0, -3.2, -0.2, 0")]), Ailment::Mirrored, false, "convention", words);
}

#[test]
fn left_handed() {
    // The world of another program: its z is the negative of ours.
    let words = "left-handed: `view` mirrors the world, and so the image; hint: its world is one of Unity, Unreal or Direct3D: \
                 negate the third column of `view`; keep it where a mirror stands in the beam";
    let mirrored = "view = [[1, 0, 0, 0], [0, 0.8944271909999159, 0.4472135954999579, 0], [0, 0.4472135954999579, -0.8944271909999159, -2.23606797749979], [0, 0, 0, 1]]";
    says(&one(&[(VIEW, mirrored)]), Ailment::LeftHanded, false, "view", words);
    let words = "left-handed: `projection` looks along +z with x to the right and y up, and so mirrors the image; hint: its \
                 world is one of Unity, Unreal or Direct3D: negate the third column of `view`; keep it where a mirror stands in \
                 the beam";
    let direct3d = "projection = [[2, 0, 0, 0], [0, 3.2, -0.2, 0], [0, 0, 1.01, -0.201], [0, 0, 1, 0]]";
    let behind = "view = [[1, 0, 0, 0], [0, 0.8944271909999159, 0.4472135954999579, 0], [0, -0.4472135954999579, 0.8944271909999159, 2.23606797749979], [0, 0, 0, 1]]";
    says(&one(&[(PROJECTION, direct3d), (VIEW, behind)]), Ailment::LeftHanded, false, "projection", words);
}

#[test]
fn wrong_units() {
    let words = "wrong units: it stands 2,235 m from the nearest prop; hint: it looks like millimetres that are read as metres: \
                 multiply the translation of `view` by 0.001";
    let finding = one(&[("-2.23606797749979", "-2236.06797749979")]);
    says(&finding, Ailment::WrongUnits, true, "view", words);
    let words = "wrong units: it stands 223 m from the nearest prop; hint: it looks like centimetres that are read as metres: \
                 multiply the translation of `view` by 0.01";
    says(&one(&[("-2.23606797749979", "-223.606797749979")]), Ailment::WrongUnits, false, "view", words);

    // The same of a file, whose key then says it.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("left.yml");
    let storage = "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 1280., 0., 640., \
                   0., 1280., 500., 0., 0., 1. ]\nR: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 1., 0., 0., 0., \
                   -1., 0., 0., 0., -1. ]\nT: !!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n   data: [ 0., 0., 1800.5 ]\n";
    std::fs::write(&path, storage).unwrap();
    let of = |unit: &str| {
        let text = format!(
            "[[projector]]\nname = \"left\"\nresolution_px = [1280, 800]\n[projector.calibration]\nfile = {path:?}\nformat = \"opencv\"\nunit = {unit:?}\n"
        );
        findings(&projector(&text), Some(&PROPS))
    };
    let found = of("m");
    let words = "wrong units: it stands 1,800 m from the nearest prop; hint: it looks like millimetres that are read as metres: \
                 set unit = \"mm\"";
    says(&found[0], Ailment::WrongUnits, true, "unit", words);
    assert_eq!((found.len(), of("mm")), (1, vec![]));
    // What is proposed hangs on what is set.
    let words = "wrong units: it stands 548 m from the nearest prop; hint: it looks like millimetres that are read as feet: \
                 set unit = \"mm\"";
    says(&of("ft")[0], Ailment::WrongUnits, false, "unit", words);
    std::fs::write(&path, storage.replace("1800.5", "1800500.")).unwrap();
    let words = "wrong units: it stands 1,800 m from the nearest prop; hint: no smaller unit brings it near: look at the \
                 translation in the file";
    says(&of("mm")[0], Ailment::WrongUnits, true, "file", words);

    // Metres that are read as millimetres: it stands among the props.
    std::fs::write(&path, storage.replace("1800.5", "1.8")).unwrap();
    let words = "wrong units: it stands inside of the box around all props; hint: it looks like metres that are read as \
                 millimetres: set unit = \"m\"";
    says(&of("mm")[0], Ailment::WrongUnits, false, "unit", words);
    says(&of("cm")[0], Ailment::WrongUnits, false, "unit", &words.replace("milli", "centi"));
    assert_eq!(of("m"), []);
    // As metres these would be too far off.
    std::fs::write(&path, storage.replace("1800.5", "300.")).unwrap();
    let words = words.replace("like metres", "like decimetres").replace("\"m\"", "\"dm\"");
    says(&of("mm")[0], Ailment::WrongUnits, false, "unit", &words);
}

/// Metres of the configuration are metres whatever unit the file has, so that is not what to set.
#[test]
fn wrong_units_of_a_view_beside_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("left.yml");
    let storage = "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 1280., 0., 640., \
                   0., 1280., 500., 0., 0., 1. ]\n";
    std::fs::write(&path, storage).unwrap();
    let view = "[[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 1800.5], [0, 0, 0, 1]]";
    for unit in ["", "unit = \"mm\"\n"] {
        let text = format!(
            "[[projector]]\nname = \"left\"\nresolution_px = [1280, 800]\n[projector.calibration]\nfile = {path:?}\nformat = \"opencv\"\n{unit}view = {view}\n"
        );
        let words = "wrong units: it stands 1,800 m from the nearest prop; hint: it looks like millimetres that are read as \
                     metres: multiply the translation of `view` by 0.001";
        says(&findings(&projector(&text), Some(&PROPS))[0], Ailment::WrongUnits, true, "view", words);
    }
}

/// Files that say their unit themselves are scaled in their frame.
#[test]
fn wrong_units_of_a_file_that_says_its_own() {
    let far_off = projector(&GOOD.replace("-2.23606797749979", "-2236.06797749979"));
    let calibration = Calibration::from_config(&far_off).unwrap();
    for (format, looks) in [
        ("mpcdi", "its lengths look 1000 times too large"),
        ("roomalive", "it looks like millimetres that are read as metres"),
    ] {
        let text = format!(
            "[[projector]]\nname = \"left\"\nresolution_px = [1280, 800]\n[projector.calibration]\nfile = \"left\"\nformat = {format:?}\n"
        );
        let found = examine(&projector(&text).calibration, &calibration, Some(&PROPS));
        let words = format!(
            "wrong units: it stands 2,235 m from the nearest prop; hint: {looks}: scale it by 0.001 in world_from_file"
        );
        says(&found[0], Ailment::WrongUnits, true, "file", &words);
    }
}

/// A projector that stands in a room of props, some of them behind it, says so in whatever unit it likes.
#[test]
fn a_projector_in_a_room_of_props_is_well() {
    let room = Props { low_m: DVec3::new(-3.0, -0.1, -4.0), high_m: DVec3::new(3.0, 2.8, 4.0) };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stage.json");
    for (unit, metre) in [("mm", 1000.0), ("cm", 100.0), ("dm", 10.0), ("m", 1.0)] {
        for eye in [[1.5, 2.0, 2.0], [-0.4, 2.2, 0.3], [0.1, 1.0, -0.5]] {
            let eye = eye.map(|coordinate: f64| coordinate * metre);
            let stage = serde_json::json!({"c": {"type": "camera", "eye": eye, "target": [0.0, 0.5 * metre, -3.0 * metre], "up": [0, 1, 0], "fov": 40}});
            std::fs::write(&path, stage.to_string()).unwrap();
            let text = format!(
                "[[projector]]\nname = \"left\"\nresolution_px = [1280, 800]\n[projector.calibration]\nfile = {path:?}\nformat = \"splash\"\nunit = {unit:?}\n"
            );
            assert_eq!(findings(&projector(&text), Some(&room)), [], "{unit} {eye:?}");
        }
    }
}

#[test]
fn wrong_resolution() {
    // Made for 16:9, used at 16:10.
    let words = "wrong resolution: at 1280 × 800 its pixels are 1.11 times as wide as high, as those of a calibration for 1920 × \
                 1080 are; hint: set resolution_px to the resolution that was calibrated, or calibrate at this one";
    let finding = one(&[("0, 3.2, 0.2, 0", "0, 3.5555, 0.2, 0")]);
    says(&finding, Ailment::WrongResolution, false, "projection", words);
}

#[test]
fn an_axis_in_the_middle_of_another_image() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("left.json");
    let matrix = |rows: usize, cols: usize, data: &[f64]| serde_json::json!({"type_id": "opencv-matrix", "rows": rows, "cols": cols, "dt": "d", "data": data});
    let storage = serde_json::json!({
        "camera_matrix": matrix(3, 3, &[1900.0, 0.0, 962.0, 0.0, 1900.0, 538.0, 0.0, 0.0, 1.0]),
        "R": matrix(3, 3, &[1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0]),
        "T": matrix(3, 1, &[0.0, 0.0, 2.0]),
    });
    std::fs::write(&path, storage.to_string()).unwrap();
    let of = |size: &str, more: &str| {
        let text = format!(
            "[[projector]]\nname = \"left\"\nresolution_px = {size}\n[projector.calibration]\nfile = {path:?}\nformat = \"opencv\"\nunit = \"m\"\n{more}"
        );
        findings(&projector(&text), Some(&PROPS))
    };
    let words = "wrong resolution: its axis is at (962, 538) px, which is the middle of 1920 × 1080 and not of 1280 × 720; hint: \
                 if it was made for that image, set resolution_px = [1920, 1080] beside `file`";
    says(&of("[1280, 720]", "")[0], Ailment::WrongResolution, false, "file", words);
    assert_eq!(of("[1280, 720]", "resolution_px = [1920, 1080]"), []);
    // Beside `file` another shape is refused: then the projector or the file is to change.
    let words = "wrong resolution: its axis is at (962, 538) px, which is the middle of 1920 × 1080 and not of 1280 × 800; hint: \
                 set resolution_px to the resolution that was calibrated, or calibrate at this one";
    says(&of("[1280, 800]", "")[0], Ailment::WrongResolution, false, "file", words);
    assert_eq!(of("[1920, 1080]", ""), []);
}

#[test]
fn principal_point_outside() {
    // cx and cy of 1920 and 540 for an image of 1280 × 800: the projection that they make.
    let words = "principal point outside: the axis is at (1920, 540) px of an image of 1280 × 800; hint: look whether cx and cy \
                 are in pixels of this resolution, and not swapped";
    let far_off = [("[[2, 0, 0, 0]", "[[2, 0, -2, 0]"), ("3.2, 0.2, 0]", "3.2, 0.35, 0]")];
    let found: Vec<_> = {
        let text = far_off.iter().fold(GOOD.to_owned(), |text, (old, new)| text.replace(old, new));
        findings(&projector(&text), Some(&PROPS))
    };
    says(&found[0], Ailment::PrincipalPointOutside, false, "projection", words);
}

#[test]
fn near_plane_behind_props() {
    let words = "near plane behind the props: it is 5.00 m away, and the farthest of them 2.91 m; hint: make `projection` with a \
                 near plane of less than 2.91 m; look as well whether its unit is that of `view`";
    let finding = one(&[("-1.01, -0.201", "-1, -10")]);
    says(&finding, Ailment::NearPlaneBehindProps, false, "projection", words);
}

#[test]
fn nothing_in_view_and_what_may_be_the_reason() {
    // A pose where the view belongs: it looks away from the props.
    let pose = "view = [[1, 0, 0, 0], [0, 0.8944271909999159, 0.4472135954999579, 1], [0, -0.4472135954999579, 0.8944271909999159, 2], [0, 0, 0, 1]]";
    let words = "nothing in view: it sees no prop and will stay black; hint: its inverse would see the props: `view` is eye from \
                 world, and a pose is world from eye";
    says(&one(&[(VIEW, pose)]), Ailment::NothingInView, false, "view", words);
    // OpenCV's axes under OpenGL's projection.
    let opencv = "view = [[1, 0, 0, 0], [0, -0.8944271909999159, 0.4472135954999579, 0], [0, -0.4472135954999579, -0.8944271909999159, 2.23606797749979], [0, 0, 0, 1]]";
    let words = "nothing in view: it sees no prop and will stay black; hint: it looks the other way: OpenCV's eye looks along +z \
                 with y down, OpenGL's along -z with y up; negate the second and third row of `view`";
    says(&one(&[(VIEW, opencv)]), Ailment::NothingInView, false, "view", words);
    let aside = VIEW.replace("[[1, 0, 0, 0]", "[[1, 0, 0, 40]");
    let words = "nothing in view: it sees no prop and will stay black; hint: compare its position and direction, as `lanternd \
                 check` tells them, with where the props stand";
    says(&one(&[(VIEW, &aside)]), Ailment::NothingInView, false, "", words);
    let good = projector(GOOD);
    let finding = nothing_in_view(&good.calibration, &Calibration::from_config(&good).unwrap(), None);
    says(&finding, Ailment::NothingInView, false, "", words);
}

#[test]
fn a_file_whose_world_has_another_way_up() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stage.json");
    // Before the props and above, in a world whose z is up.
    std::fs::write(
        &path,
        r#"{"c": {"type": "camera", "eye": [0, -9, 3], "target": [0, 0, 0], "up": [0, 0, 1], "fov": 20}}"#,
    )
    .unwrap();
    let of = |more: &str| {
        let text = format!(
            "[[projector]]\nname = \"left\"\nresolution_px = [1280, 800]\n[projector.calibration]\nfile = {path:?}\nformat = \"splash\"\nunit = \"m\"\n{more}"
        );
        findings(
            &projector(&text),
            Some(&Props { low_m: DVec3::new(-0.2, 2.0, 3.0), high_m: DVec3::new(0.2, 2.2, 4.0) }),
        )
    };
    let words = "nothing in view: it sees no prop and will stay black; hint: it would see the props if its world had z up: set \
                 world_from_file = [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]";
    let found = of("");
    says(&found[0], Ailment::NothingInView, false, "world_from_file", words);
    assert_eq!(of("world_from_file = [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]"), []);
}

fn rows(m: DMat4) -> Matrix4 {
    std::array::from_fn(|i| m.row(i).to_array())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, rng_seed: RngSeed::Fixed(4), ..ProptestConfig::default() })]

    /// Projectors that are well: anywhere in a hall, looking at the props, their lens shifted as lenses are, in either clip
    /// space, with standard, reversed and infinite depth, looking along −z or +z, keystoned or not, hanging upside down or not.
    #[test]
    fn good_calibrations_alarm_nobody(
        direction in prop::array::uniform3(-1.0..1.0f64),
        distance_m in 1.5..30.0f64,
        roll in prop_oneof![Just(0.0), Just(std::f64::consts::PI), -3.2..3.2f64],
        focal in 0.8..6.0f64,
        shift in (-0.5..0.5f64, -1.2..1.2f64),
        near_m in 0.01..0.4f64,
        far in prop_oneof![Just(f64::INFINITY), 100.0..5000.0f64],
        reversed in any::<bool>(),
        opengl in any::<bool>(),
        looks_along_z in any::<bool>(),
        size in prop::sample::select(vec![[1920, 1080], [1280, 800], [1024, 768], [4096, 2160], [1080, 1920]]),
        keystone in prop_oneof![Just([0.0; 4]), prop::array::uniform4(-0.1..0.1f64)],
        scale in prop_oneof![Just(1.0), 0.1..9.0f64, Just(-1.0)],
        in_projection in any::<bool>(),
    ) {
        let size_px = UVec2::from(size);
        let stands_m = DVec3::from(direction).normalize_or(DVec3::Z) * distance_m;
        // What the middle of the shifted image looks at are the props.
        let aspect = f64::from(size[0]) / f64::from(size[1]);
        let ahead = -stands_m.normalize();
        let right = ahead.cross(DVec3::Y).normalize_or(DVec3::X);
        let looks = DMat4::from_cols(right.extend(0.0), right.cross(ahead).extend(0.0), (-ahead).extend(0.0), DVec4::W);
        let off_axis = DQuat::from_rotation_arc(DVec3::new(-2.0 * shift.0 / focal, -2.0 * shift.1 / (focal * aspect), -1.0).normalize(), DVec3::NEG_Z);
        let turned = looks * DMat4::from_quat(off_axis.inverse()) * DMat4::from_rotation_z(0.0);
        let spun = DMat4::from_axis_angle(ahead, roll) * turned;
        let mut view = spun.inverse() * DMat4::from_translation(-stands_m);

        let (first, second) = if opengl { (-1.0, 1.0) } else { (0.0, 1.0) };
        let (at_near, at_far) = if reversed { (second, first) } else { (first, second) };
        let (a, b) = if far.is_infinite() { (-at_far, (at_near - at_far) * near_m) } else {
            let b = (at_near - at_far) * near_m * far / (far - near_m);
            (b / far - at_far, b)
        };
        let up = if opengl { 1.0 } else { -1.0 };
        let mut projection = DMat4::from_cols(
            DVec4::new(focal, 0.0, 0.0, 0.0), DVec4::new(0.0, up * focal * aspect, 0.0, 0.0),
            DVec4::new(2.0 * shift.0, up * 2.0 * shift.1, a, -1.0), DVec4::new(0.0, 0.0, b, 0.0),
        );
        if looks_along_z {
            let turn = DMat4::from_diagonal(DVec4::new(1.0, -1.0, -1.0, 1.0));
            (projection, view) = (projection * turn, turn * view);
        }
        let [kx, ky, kz, kw] = keystone;
        let homography = DMat4::from_cols(
            DVec4::new(1.0, ky, 0.0, kz), DVec4::new(kx, 1.0, 0.0, kw), DVec4::Z, DVec4::W,
        );
        // A matrix and its negative are told apart by what they see, which a homography of an infinite far plane hides.
        let scale = if keystone == [0.0; 4] { scale } else { scale.abs() };
        projection = homography * projection * scale;
        if in_projection {
            (projection, view) = (projection * view, DMat4::IDENTITY);
        }
        let text = format!(
            "[[projector]]\nname = \"left\"\nresolution_px = {size:?}\n[projector.calibration]\nconvention = {:?}\nprojection = {:?}\nview = {:?}\n",
            if opengl { "opengl" } else { "vulkan" }, rows(projection), rows(view),
        );
        let good = projector(&text);
        prop_assert!(matches!(good.calibration, Configured::Matrices(_)) && size_px.x > 0);
        let calibration = Calibration::from_config(&good).unwrap();
        let found = examine(&good.calibration, &calibration, Some(&PROPS));
        prop_assert_eq!(&found, &[], "{}", text);
    }
}
