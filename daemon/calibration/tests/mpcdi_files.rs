//! Files of MPCDI: where their projectors stand, what their maps bend, and what is refused.
#![expect(clippy::unwrap_used, reason = "tests' helpers: what is given to them must be taken")]

mod common;

use std::io::{Cursor, Write};

use common::{file, load, refused, shared};
use glam::{DQuat, DVec2, DVec3, UVec2, Vec3};
use image::{ImageBuffer, ImageFormat, Luma, Rgb};
use lantern_calibration::Frustum;
use lantern_calibration::describe::Description;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

const SIZE_PX: UVec2 = UVec2::new(64, 48);

const UPRIGHT: &str = "<posx>0</posx><posy>0</posy><posz>0</posz><yawx>0</yawx><yawy>-1</yawy><yawz>0</yawz>\
    <pitchx>1</pitchx><pitchy>0</pitchy><pitchz>0</pitchz><rollx>0</rollx><rolly>0</rolly><rollz>-1</rollz>";

/// A region: its id, yaw, pitch and roll, left, right, up and down angles, and what its coordinate frame holds.
fn region(id: &str, turn: [f64; 3], angles: [f64; 4], frame: &str) -> String {
    let [yaw, pitch, roll] = turn;
    let [left, right, up, down] = angles;
    format!(
        "<region id=\"{id}\" xResolution=\"{}\" yResolution=\"{}\" x=\"0\" y=\"0\" xsize=\"1\" ysize=\"1\"><frustum>\
         <yaw>{yaw}</yaw><pitch>{pitch}</pitch><roll>{roll}</roll><leftAngle>{left}</leftAngle>\
         <rightAngle>{right}</rightAngle><upAngle>{up}</upAngle><downAngle>{down}</downAngle></frustum>\
         <coordinateFrame>{frame}</coordinateFrame></region>",
        SIZE_PX.x, SIZE_PX.y
    )
}

fn document(profile: &str, regions: &str, files: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?>\n<MPCDI profile=\"{profile}\" geometry=\"1\" version=\"2.0\"><display>\
         <buffer id=\"0\">{regions}</buffer></display>{files}</MPCDI>"
    )
}

fn zip(members: &[(&str, &[u8])]) -> Vec<u8> {
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in members {
        writer.start_file(*name, SimpleFileOptions::default()).unwrap();
        writer.write_all(bytes).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

fn pfm(size: UVec2, pixel: impl Fn(u32, u32) -> Vec3) -> Vec<u8> {
    let mut bytes = format!("PF\n{} {}\n-1.0\n", size.x, size.y).into_bytes();
    for (row, column) in (0..size.y).flat_map(|row| (0..size.x).map(move |column| (row, column))) {
        bytes.extend(pixel(column, row).to_array().into_iter().flat_map(f32::to_le_bytes));
    }
    bytes
}

fn centre_px(column: u32, row: u32) -> DVec2 {
    DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5)
}

/// Whether a point is in the image, and how far from its edges in shares of its sides; below 0 outside.
fn inside(frustum: &Frustum, at_m: DVec3) -> f64 {
    let size_px = frustum.calibration().resolution_px().as_dvec2();
    frustum.project(at_m).map_or(-1.0, |found| {
        let share = found.place_px / size_px;
        share.min(1.0 - share).min_element()
    })
}

/// A few thousand directions, evenly (a spiral).
fn directions() -> impl Iterator<Item = DVec3> {
    const COUNT: u32 = 5000;
    (0..COUNT).map(|i| {
        let (z, angle) = (1.0 - 2.0 * (f64::from(i) + 0.5) / f64::from(COUNT), f64::from(i) * 2.399_963_229_728_653);
        DVec3::new((1.0 - z * z).sqrt() * angle.cos(), (1.0 - z * z).sqrt() * angle.sin(), z)
    })
}

#[test]
fn six_frusta_of_a_right_angle_tile_all_directions() {
    let turns = [[0, 0], [90, 0], [180, 0], [-90, 0], [180, 90], [180, -90]];
    let names = ["front", "right", "back", "left", "top", "bottom"];
    let regions: String = turns
        .iter()
        .zip(names)
        .map(|([yaw, pitch], name)| {
            region(name, [f64::from(*yaw), f64::from(*pitch), 0.0], [-45.0, 45.0, 45.0, -45.0], UPRIGHT)
        })
        .collect();
    let (_folder, path) = file(document("3d", &regions, ""));
    let frusta: Vec<_> = names.iter().map(|name| load(&path, "mpcdi", SIZE_PX, &format!("entry = {name:?}"))).collect();

    // Yaw turns to the right, and pitch up.
    for (frustum, axis) in frusta.iter().zip([DVec3::NEG_Z, DVec3::X, DVec3::Z, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y]) {
        assert!((Description::of(frustum).axis - axis).length() < 1e-12);
    }
    for direction in directions() {
        let seen: Vec<_> = frusta.iter().filter(|frustum| inside(frustum, direction * 2.0) > 0.0).collect();
        assert_eq!(seen.len(), 1, "{direction}");
    }
    // Edges are shared by two, corners by three, each to the last digits.
    for (at, expected) in
        [(DVec3::new(1.0, 0.3, 1.0), 2), (DVec3::new(-0.4, 1.0, -1.0), 2), (DVec3::new(1.0, -1.0, 1.0), 3)]
    {
        let on_edge = frusta.iter().filter(|frustum| inside(frustum, at).abs() < 1e-12).count();
        assert_eq!(on_edge, expected, "{at}");
    }
}

#[test]
fn the_six_frusta_of_a_real_file_tile_a_cube() {
    let Some(path) = shared("cube.mpcdi.xml") else { return };
    let names = ["Rear", "Front", "Left", "Right", "Top", "Bottom"];
    let size_px = UVec2::new(1920, 1080);
    let frusta = names.map(|name| load(&path, "mpcdi", size_px, &format!("unit = \"m\"\nentry = {name:?}")));
    for (frustum, (stands, looks)) in frusta.iter().zip([
        (DVec3::new(0.0, 0.5, 3.0), DVec3::NEG_Z),
        (DVec3::new(0.0, 0.5, -3.0), DVec3::Z),
        (DVec3::new(3.0, 0.5, 0.0), DVec3::NEG_X),
        (DVec3::new(-3.0, 0.5, 0.0), DVec3::X),
        (DVec3::new(0.0, 3.0, 0.0), DVec3::NEG_Y),
        (DVec3::new(0.0, -3.0, 0.0), DVec3::Y),
    ]) {
        let seen = Description::of(frustum);
        assert!(seen.position_m.unwrap().distance(stands) < 1e-6 && seen.axis.distance(looks) < 1e-6, "{seen}");
    }

    // A cube of 0.9 m around (0, ½, 0): whatever point of its sides one takes, exactly one projector is before that side
    // and has it in its image; on an edge there are two, at a corner three.
    let half_m = 0.45;
    let mut edges = 0;
    for across in 0..=20 {
        for along in 0..=20 {
            let [s, t] = [across, along].map(|i| f64::from(i) / 10.0 - 1.0);
            for (normal, other, third) in
                [(DVec3::X, DVec3::Y, DVec3::Z), (DVec3::Y, DVec3::Z, DVec3::X), (DVec3::Z, DVec3::X, DVec3::Y)]
            {
                for side in [1.0, -1.0] {
                    let offset = (normal * side + other * s + third * t) * half_m;
                    let at_m = DVec3::new(0.0, 0.5, 0.0) + offset;
                    // The sides that meet here: one, or on an edge two.
                    let sides: Vec<DVec3> = [DVec3::X, DVec3::Y, DVec3::Z]
                        .into_iter()
                        .flat_map(|axis| [axis, -axis])
                        .filter(|normal| (offset.dot(*normal) - half_m).abs() < 1e-9)
                        .collect();
                    edges += usize::from(sides.len() > 1);
                    let lights = frusta.iter().filter(|frustum| {
                        let stands = Description::of(frustum).position_m.unwrap();
                        let faces = sides.iter().any(|normal| (stands - at_m).dot(*normal) > 1e-6);
                        faces && inside(frustum, at_m) > 0.0
                    });
                    assert_eq!(lights.count(), sides.len(), "{at_m}");
                }
            }
        }
    }
    assert!(edges > 100);
}

/// By another way than the formula: a frame is turned about its own axes, first to the right, then up, then clockwise.
#[test]
fn angles_turn_the_frame_about_its_own_axes() {
    for turn in [[30.0, 0.0, 0.0], [0.0, 20.0, 0.0], [0.0, 0.0, 10.0], [-130.0, 35.0, -80.0], [200.0, -70.0, 15.0]] {
        let angles = [-30.0, 20.0, 10.0, -25.0];
        let frame = UPRIGHT.replace("<posx>0<", "<posx>1200<").replace("<posz>0<", "<posz>-300<");
        let (_folder, path) = file(document("3D", &region("only", turn, angles, &frame), ""));
        let frustum = load(&path, "mpcdi", SIZE_PX, "unit = \"mm\"");

        let [mut right, mut up, mut ahead] = [DVec3::X, DVec3::Y, DVec3::NEG_Z];
        let mut spin = |about: fn(DVec3, DVec3, DVec3) -> DVec3, degrees: f64| {
            let spin = DQuat::from_axis_angle(about(right, up, ahead), degrees.to_radians());
            (right, up, ahead) = (spin * right, spin * up, spin * ahead);
        };
        spin(|_, up, _| -up, turn[0]);
        spin(|right, _, _| right, turn[1]);
        spin(|_, _, ahead| ahead, turn[2]);

        let size_px = SIZE_PX.as_dvec2();
        let origin_m = DVec3::new(1.2, 0.0, -0.3);
        for (at, across, upward) in [
            (DVec2::ZERO, angles[0], angles[2]),
            (DVec2::X, angles[1], angles[2]),
            (DVec2::Y, angles[0], angles[3]),
            (DVec2::ONE, angles[1], angles[3]),
        ] {
            let ray = frustum.ray(at * size_px).unwrap();
            let tangent = |degrees: f64| degrees.to_radians().tan();
            let expected = (ahead + right * tangent(across) + up * tangent(upward)).normalize();
            assert!((ray.direction - expected).length() < 1e-12, "{turn:?} at {at}: {} {expected}", ray.direction);
            assert!((origin_m - ray.origin_m).cross(ray.direction).length() < 1e-12);
        }
    }
}

#[test]
fn a_frame_may_have_any_axis_up() {
    // z up, looking along y: right is x, and the yaw and roll axes are stored the other way.
    let frame = "<posx>0</posx><posy>-2</posy><posz>1</posz><yawx>0</yawx><yawy>0</yawy><yawz>-1</yawz>\
                 <pitchx>1</pitchx><pitchy>0</pitchy><pitchz>0</pitchz><rollx>0</rollx><rolly>1</rolly><rollz>0</rollz>";
    let (_folder, path) = file(document("sl", &region("a", [0.0; 3], [-20.0, 20.0, 15.0, -15.0], frame), ""));
    let seen = Description::of(&load(&path, "mpcdi", SIZE_PX, "unit = \"m\""));
    let middle = seen.middle.unwrap();
    assert!(seen.axis.distance(DVec3::Y) < 1e-12 && middle.up.distance(DVec3::Z) < 1e-12 && !middle.mirrored);
    // And ours, with y up.
    let keys = "unit = \"m\"\nworld_from_file = [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]";
    let seen = Description::of(&load(&path, "mpcdi", SIZE_PX, keys));
    assert!(seen.position_m.unwrap().distance(DVec3::new(0.0, 1.0, 2.0)) < 1e-12);
    assert!(seen.axis.distance(DVec3::NEG_Z) < 1e-12);

    let mirrored = frame.replace("<rolly>1<", "<rolly>-1<");
    let (_folder, path) = file(document("sl", &region("a", [0.0; 3], [-20.0, 20.0, 15.0, -15.0], &mirrored), ""));
    assert!(refused(&path, "mpcdi", SIZE_PX, "unit = \"m\"").contains("left-handed"));
    let bent = frame.replace("<rolly>1<", "<rolly>0.9<");
    let (_folder, path) = file(document("sl", &region("a", [0.0; 3], [-20.0, 20.0, 15.0, -15.0], &bent), ""));
    assert!(refused(&path, "mpcdi", SIZE_PX, "unit = \"m\"").contains("its rotation is none"));
    let flat = frame.replace("<rolly>1<", "<rolly>0<");
    let (_folder, path) = file(document("sl", &region("a", [0.0; 3], [-20.0, 20.0, 15.0, -15.0], &flat), ""));
    assert!(refused(&path, "mpcdi", SIZE_PX, "unit = \"m\"").contains("not independent"));
}

const ANGLES: [f64; 4] = [-25.0, 20.0, 18.0, -12.0];

/// The projector of the tests with maps, and its XML with a file set.
fn mapped(profile: &str, files: &str) -> String {
    let frame = UPRIGHT.replace("<posy>0<", "<posy>2<");
    let files = format!("<files><fileset region=\"Left\">{files}</fileset></files>");
    document(profile, &region("Left", [15.0, -30.0, 4.0], ANGLES, &frame), &files)
}

fn plain() -> Frustum {
    let (_folder, path) = file(mapped("3d", ""));
    load(&path, "mpcdi", SIZE_PX, "unit = \"m\"")
}

const WARP: &str =
    "<geometryWarpFile><path>maps/Left.PFM</path><interpolation>linear</interpolation></geometryWarpFile>";

#[test]
fn a_warp_says_where_in_the_frustum_each_pixel_is() {
    let share = |column: u32, row: u32| {
        let at = centre_px(column, row) / SIZE_PX.as_dvec2();
        DVec2::new(at.x * 0.9 + 0.04 + 0.01 * at.y, at.y * 0.95 + 0.02)
    };
    let map = pfm(SIZE_PX, |column, row| match (column, row) {
        (5, 7) => Vec3::NAN,
        _ => share(column, row).extend(0.0).as_vec3(),
    });
    // Names in whatever case, behind whatever slashes.
    for (profile, files) in [
        ("3d", WARP.to_owned()),
        ("sl", WARP.replace("geometryWarpFile", "distortionMap").replace("maps/", "maps\\")),
        ("SL", WARP.replace("geometryWarpFile", "DISTORTIONMAP").replace("maps/Left.PFM", "LEFT.pfm")),
    ] {
        let archive = zip(&[("MPCDI.XML", mapped(profile, &files).as_bytes()), ("Maps/left.pfm", &map)]);
        let (_folder, path) = file(archive);
        let (bent, plain) = (load(&path, "mpcdi", SIZE_PX, "unit = \"m\""), plain());
        for (column, row) in [(0, 0), (63, 0), (0, 47), (63, 47), (31, 20), (12, 40)] {
            let found = bent.ray(centre_px(column, row)).unwrap();
            let expected = plain.ray(share(column, row) * SIZE_PX.as_dvec2()).unwrap();
            assert!(found.direction.distance(expected.direction) < 1e-6, "{profile}: {column} {row}");
            assert!(found.origin_m.distance(expected.origin_m) < 1e-6);
        }
        assert!(bent.ray(centre_px(5, 7)).is_none(), "no light goes there");
    }
}

#[test]
fn a_warp_may_hold_the_points_that_pixels_land_on() {
    // On a floor, by the rays of a lens that bends: in millimetres, which is then the unit of the whole file.
    let plain = plain();
    let bend = |column: u32, row: u32| {
        let at = centre_px(column, row) / SIZE_PX.as_dvec2() - 0.5;
        (at * (0.9 + 0.1 * at.length_squared()) + 0.5) * SIZE_PX.as_dvec2()
    };
    let on_floor = |column, row| {
        let ray = plain.ray(bend(column, row)).unwrap();
        ray.at(-ray.origin_m.y / ray.direction.y)
    };
    let map = pfm(SIZE_PX, |column, row| (on_floor(column, row) * 1000.0).as_vec3());
    let millimetres =
        "<geometricUnit>mm</geometricUnit><originOf3DData>floorCenter</originOf3DData></geometryWarpFile>";
    let warp = WARP.replace("</geometryWarpFile>", millimetres);
    for profile in ["sl", "3d"] {
        let xml = mapped(profile, &warp).replace("<posy>2<", "<posy>2000<");
        let (_folder, path) = file(zip(&[("mpcdi.xml", xml.as_bytes()), ("maps/Left.PFM", &map)]));
        for keys in ["", "unit = \"mm\""] {
            let bent = load(&path, "mpcdi", SIZE_PX, keys);
            for (column, row) in [(0, 0), (63, 0), (0, 47), (63, 47), (31, 20), (12, 40)] {
                let ray = bent.ray(centre_px(column, row)).unwrap();
                let off_m = (on_floor(column, row) - ray.origin_m).reject_from_normalized(ray.direction).length();
                assert!(off_m < 1e-5, "{profile}: {column} {row} is off by {off_m} m");
            }
        }
        let said = refused(&path, "mpcdi", SIZE_PX, "unit = \"m\"");
        assert!(said.contains("says \"mm\", and `unit` says \"m\"; hint: remove `unit`"), "{said}");
        let eye = xml.replace("floorCenter", "idealEyePoint");
        let (_folder, path) = file(zip(&[("mpcdi.xml", eye.as_bytes()), ("maps/Left.PFM", &map)]));
        assert!(refused(&path, "mpcdi", SIZE_PX, "").contains("seen from an eye, which is not built"));
    }
}

#[test]
fn points_without_a_unit_are_no_shares_of_an_image() {
    let floor = pfm(SIZE_PX, |column, row| Vec3::new(column as f32, 0.0, row as f32 * 10.0 - 900.0));
    let said = |files: &str, map: &[u8]| {
        let (_folder, path) = file(zip(&[("mpcdi.xml", mapped("3d", files).as_bytes()), ("maps/Left.PFM", map)]));
        refused(&path, "mpcdi", SIZE_PX, "unit = \"m\"")
    };
    let unknown = WARP.replace("</geo", "<geometricUnit>unknown</geometricUnit></geo");
    for warp in [WARP, unknown.as_str()] {
        let said = said(warp, &floor);
        let expected = "its <geometryWarpFile> holds points and says no unit: its third numbers are not 0, as those of a map of the \
                        image are; hint: write <geometricUnit> beside its <path>, or export it as a map of the image";
        assert!(said.ends_with(expected), "{said}");
    }
    let said = said(&WARP.replace("geometryWarpFile", "distortionMap"), &floor);
    let expected = "its <distortionMap> holds points: its third numbers are not 0, as those of a map of the image are; hint: \
                    export it as a map of the image, or its points as a <geometryWarpFile> with a <geometricUnit>";
    assert!(said.ends_with(expected), "{said}");

    // What is unknown is unknown in all three, whatever stands there.
    let at = |column, row| (centre_px(column, row) / SIZE_PX.as_dvec2()).as_vec2();
    for third in [f32::NAN, f32::INFINITY, -0.0] {
        let map = pfm(SIZE_PX, |column, row| at(column, row).extend(third));
        let (_folder, path) = file(zip(&[("mpcdi.xml", mapped("3d", WARP).as_bytes()), ("maps/Left.PFM", &map)]));
        assert!(load(&path, "mpcdi", SIZE_PX, "unit = \"m\"").ray(centre_px(3, 4)).is_some(), "{third}");
    }
}

#[test]
fn alpha_and_beta_are_linear_values() {
    let png = |format: ImageFormat, grey: bool| {
        let mut bytes = Cursor::new(Vec::new());
        if grey {
            ImageBuffer::from_fn(4, 2, |x, y| Luma([(40 * x + 30 * y) as u8])).write_to(&mut bytes, format).unwrap();
        } else {
            ImageBuffer::from_fn(4, 2, |x, y| Rgb([(9000 * x) as u16, (7000 * y) as u16, 65_535]))
                .write_to(&mut bytes, format)
                .unwrap();
        }
        bytes.into_inner()
    };
    let files = "<alphaMap><path>a.png</path><componentDepth>3</componentDepth><bitdepth>16</bitdepth>\
                 <gammaEmbedded>2.2</gammaEmbedded></alphaMap><betaMap><path>b.png</path>\
                 <gammaEmbedded>1</gammaEmbedded></betaMap>";
    let (alpha, beta) = (png(ImageFormat::Png, false), png(ImageFormat::Png, true));
    let xml = mapped("3d", files);
    let (_folder, path) = file(zip(&[("mpcdi.xml", xml.as_bytes()), ("a.png", &alpha), ("b.png", &beta)]));
    let frustum = load(&path, "mpcdi", SIZE_PX, "unit = \"m\"");
    let maps = frustum.calibration().maps();
    let (alpha, beta) = (maps.alpha.as_ref().unwrap(), maps.beta.as_ref().unwrap());
    assert_eq!((alpha.size, beta.size), (UVec2::new(4, 2), UVec2::new(4, 2)));
    let expected = Vec3::new((27_000.0f32 / 65_535.0).powf(2.2), (7000.0f32 / 65_535.0).powf(2.2), 1.0);
    assert!((alpha.values[7] - expected).abs().max_element() < 1e-6, "{}", alpha.values[7]);
    assert!((beta.values[6] - Vec3::splat(110.0 / 255.0)).abs().max_element() < 1e-6, "{}", beta.values[6]);

    let said = |xml: String, alpha: &[u8]| {
        let (_folder, path) = file(zip(&[("mpcdi.xml", xml.as_bytes()), ("a.png", alpha), ("b.png", b"")]));
        refused(&path, "mpcdi", SIZE_PX, "unit = \"m\"")
    };
    assert!(said(xml.clone(), &png(ImageFormat::Png, false)[..40]).contains("not readable as a PNG map"));
    assert!(said(xml.replacen("<gammaEmbedded>2.2</gammaEmbedded>", "", 1), b"").contains("has no <gammaEmbedded>"));
    let alpha_picture = png(ImageFormat::Png, false);
    let beta_of_gamma_0 = xml.replacen("<gammaEmbedded>1<", "<gammaEmbedded>0<", 1);
    assert!(said(beta_of_gamma_0, &alpha_picture).contains("gammaEmbedded of <betaMap> is 0"));
    assert!(said(xml.replacen("2.2", "0", 1), b"").contains("gammaEmbedded of <alphaMap> is 0"));
    assert!(said(xml.replacen("a.png", "c.png", 1), b"").contains("there is no \"c.png\" in it"));
    let (_folder, path) = file(xml);
    let said = refused(&path, "mpcdi", SIZE_PX, "unit = \"m\"");
    assert!(said.contains("names \"a.png\", and an XML alone holds no maps"), "{said}");
}

#[test]
fn a_beta_map_may_be_a_path_alone() {
    let mut picture = Cursor::new(Vec::new());
    ImageBuffer::from_fn(4, 2, |x, y| Luma([(40 * x + 30 * y) as u8]))
        .write_to(&mut picture, ImageFormat::Png)
        .unwrap();
    let xml = mapped("3d", "<betaMap><path>b.png</path></betaMap>");
    let (_folder, path) = file(zip(&[("mpcdi.xml", xml.as_bytes()), ("b.png", &picture.into_inner())]));
    let frustum = load(&path, "mpcdi", SIZE_PX, "unit = \"m\"");
    let beta = frustum.calibration().maps().beta.clone().unwrap();
    assert!((beta.values[6] - Vec3::splat(110.0 / 255.0)).abs().max_element() < 1e-6, "{}", beta.values[6]);
}

#[test]
fn what_it_is_no_calibration_for_is_said() {
    let good = mapped("3d", "");
    let said = |old: &str, new: &str, keys: &str| {
        assert!(good.contains(old), "{old}");
        let (_folder, path) = file(good.replacen(old, new, 1));
        refused(&path, "mpcdi", SIZE_PX, keys)
    };
    let metres = "unit = \"m\"";
    for (old, new, words) in [
        (
            "\"3d\"",
            "\"2d\"",
            "its profile is \"2d\", which bends a flat picture and does not say where the projector stands; hint: export it with profile \"3d\" or \"sl\"",
        ),
        (
            "\"3d\"",
            "\"a3\"",
            "\"a3\", which says where each pixel lands and not where the projector stands; it is not built",
        ),
        ("\"3d\"", "\"4d\"", "\"4d\", which there is none of"),
        ("profile=", "pofile=", "its profile is not said"),
        ("<MPCDI", "<!DOCTYPE a [<!ENTITY b \"c\">]><MPCDI", "DTD"),
        ("-25", "25", "its frustum is empty"),
        ("-25", "-90", "leftAngle is -90 degrees"),
        ("-25", "left", "leftAngle is \"left\", which is no finite number"),
        ("<yaw>", "<jaw>", "MPCDI"),
        ("\"64\"", "\"64.5\"", "xResolution is 64.5"),
        ("\"64\"", "\"80\"", "it was made for 80 × 48 pixels, and the projector has 64 × 48"),
        ("<coordinateFrame>", "<coordinates>", "MPCDI"),
    ] {
        let said = said(old, new, metres);
        assert!(said.contains(words), "{said} does not say {words}");
    }
    assert!(said("3d", "3d", "").contains("does not say in what unit"));
    assert!(said("3d", "3d", "entry = \"Right\"").contains("has no region \"Right\"; hint: there are \"Left\""));
    let two = document("3d", &(region("a", [0.0; 3], ANGLES, UPRIGHT) + &region("a", [0.0; 3], ANGLES, UPRIGHT)), "");
    let (_folder, path) = file(&two);
    assert!(refused(&path, "mpcdi", SIZE_PX, "entry = \"a\"").contains("has several regions \"a\""));
    let frame = good[good.find("<coordinateFrame>").unwrap()..].split_inclusive("</coordinateFrame>").next().unwrap();
    let bare = good.replace(frame, "");
    let (_folder, path) = file(&bare);
    // Profile 3d may leave its frame out, and then has no length that a unit is needed for.
    assert!(Description::of(&load(&path, "mpcdi", SIZE_PX, "")).position_m.unwrap().length() < 1e-12);
    let (_folder, path) = file(bare.replace("\"3d\"", "\"sl\""));
    assert!(refused(&path, "mpcdi", SIZE_PX, "").contains("profile sl has no <coordinateFrame>"));
    let smooth = WARP.replace("linear", "Smooth");
    let (_folder, path) = file(zip(&[("mpcdi.xml", mapped("3d", &smooth).as_bytes())]));
    assert!(refused(&path, "mpcdi", SIZE_PX, metres).contains("interpolated by \"Smooth\", which is not built"));
}

#[test]
fn archives_are_read_up_to_a_bound() {
    let said = |archive: Vec<u8>| {
        let (_folder, path) = file(archive);
        refused(&path, "mpcdi", SIZE_PX, "unit = \"m\"")
    };
    // 300 MiB of blanks are 300 KiB of zip.
    let blanks = vec![b' '; 300 << 20];
    let bomb = zip(&[("mpcdi.xml", &blanks)]);
    assert!(bomb.len() < 1 << 20);
    assert!(said(bomb).contains("\"mpcdi.xml\" in it is larger than 8192 KiB"));
    let mut map = b"PF\n64 48\n-1\n".to_vec();
    map.resize(300 << 20, 0);
    let xml = mapped("3d", WARP);
    assert!(said(zip(&[("mpcdi.xml", xml.as_bytes()), ("maps/Left.PFM", &map)])).contains("is larger than 196608 KiB"));

    let many: Vec<String> = (0..5000).map(|i| format!("{i}")).collect();
    let many: Vec<(&str, &[u8])> = many.iter().map(|name| (name.as_str(), b"".as_slice())).collect();
    assert!(said(zip(&many)).contains("it has more than 4096 files"));
    assert!(said(zip(&[("other.xml", b"<a/>")])).contains("there is no \"mpcdi.xml\" in it"));
    let good = zip(&[("mpcdi.xml", xml.as_bytes())]);
    for end in [4, 20, good.len() / 2, good.len() - 1] {
        assert!(said(good[..end].to_vec()).contains("not readable as an MPCDI archive"), "{end}");
    }
    let mut damaged = good;
    damaged[60] ^= 0x10;
    assert!(said(damaged).contains("hint:"));
}
