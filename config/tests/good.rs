//! What must be read: the demo, the examples and the contract's example.

use glam::{DMat4, DVec3, DVec4};
use lantern_config::{
    Calibration, Config, Convention, DEMO_TOML, Drives, Environment, Format, Fullscreen, Limits, Matrices, Order,
    Output, OutputKind, Pixels, Projector, RasterOrder, RayTracing, Role, Unit,
};
use std::path::{Path, PathBuf};

fn parse(text: &str) -> Config {
    match Config::parse(text, "test.toml", Path::new("/base")) {
        Ok(config) => config,
        Err(problems) => panic!("{}", problems.iter().map(|p| format!("{p}\n")).collect::<String>()),
    }
}

/// The contract's example, to the letter but for its matrices and the car's node, which it draws as dots and comments.
const CONTRACT: &str = r##"
[daemon]
socket      = "/run/lantern/lanternd.sock"
state_dir   = "/var/lib/lantern"            # omit: nothing is kept
asset_roots = ["/srv/sar"]                  # the only folders from which a client may have files read

[device]
select = "llvmpipe"                         # part of a name, a UUID, or an index; omit: the best there is

[render]
samples   = 4                               # jittered grid per pixel: 4, 9, 16, …; 1 = the pixel's centre, unjittered
max_depth = 8                               # secondary rays deep
raster    = "after"                         # or "before": when raster nodes are drawn
blend     = true

[scene]
environment = "studio.hdr"                  # equirectangular .hdr, .exr or .png, or "#rrggbb"; what a miss sees
[[scene.node]]
name = "car"
uri  = "car.glb"                            # relative to this file
role = "prop"                               # "prop" | "virtual" | "raster" | "mask"
translation_m = [0, 0, 0]
rotation      = [0, 0, 0, 1]
scale         = [1, 1, 1]

[[body]]                                    # whatever a tracker can move
name = "head"
drives = "viewer"                           # or "node:car"
position_m = [0, 1.7, 2.5]                  # until a tracker speaks
offset_m   = [0, 0, 0]                      # from the tracked point to the eye, in the body's frame

[[tracker]]
name     = "optitrack"
protocol = "lantern"                        # "lantern" | "osc" | "natnet" | "freed" | "psn" | "opentrack" | "dtrack"
listen   = "127.0.0.1:7000"
allow    = ["127.0.0.1"]                    # source addresses; default: loopback only
bodies   = { "1" = "head" }                 # the tracker's id = our body
world_from_tracker = [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]
predict_ms = 0                              # 0 = the tracker predicts already

[[projector]]
name          = "left"
resolution_px = [1280, 800]
output        = { kind = "headless", refresh_hz = 60 }   # | { kind = "window" } | { kind = "display", connector = "DP-1" }
[projector.calibration]
convention = "opengl"                       # "opengl" | "vulkan": clip space; required
projection = [[1,0,0,0],[0,1.6,0,0],[0,0,-1.01,-0.2],[0,0,-1,0]]
view       = [[1,0,0,0],[0,1,0,-1],[0,0,1,-2],[0,0,0,1]]
"##;

#[test]
fn the_contracts_example() {
    let config = parse(CONTRACT);
    assert_eq!(config.daemon.socket.as_deref(), Some(Path::new("/run/lantern/lanternd.sock")));
    assert_eq!(config.daemon.state_dir.as_deref(), Some(Path::new("/var/lib/lantern")));
    assert_eq!(config.daemon.asset_roots, [PathBuf::from("/srv/sar")]);
    assert_eq!(config.device.select.as_deref(), Some("llvmpipe"));
    assert_eq!((config.render.samples, config.render.max_depth), (4, 8));
    assert_eq!((config.render.raster, config.render.blend), (RasterOrder::After, true));
    assert_eq!(config.scene.environment, Some(Environment::Uri("studio.hdr".into())));
    let node = &config.scene.nodes[0];
    assert_eq!((node.name.as_str(), node.uri.as_str(), node.role), ("car", "car.glb", Some(Role::Prop)));
    assert_eq!(node.rotation, Some([0.0, 0.0, 0.0, 1.0]));
    assert_eq!(config.viewer().unwrap().position_m, [0.0, 1.7, 2.5]);
    let tracker = &config.trackers[0];
    assert_eq!((tracker.name.as_str(), tracker.listen.to_string().as_str()), ("optitrack", "127.0.0.1:7000"));
    assert_eq!(tracker.bodies.iter().collect::<Vec<_>>(), [(&"1".to_owned(), &"head".to_owned())]);
    assert_eq!(tracker.predict_lead_ms, None);
    let projector = &config.projectors[0];
    assert_eq!(projector.resolution_px, [1280, 800]);
    assert_eq!(projector.output, Output { refresh_hz: Some(60.0), ..Output::default() });
    assert_eq!(matrices(projector).convention, Convention::OpenGl);
    assert_eq!(matrices(projector).view[1], [0.0, 1.0, 0.0, -1.0]);
    assert_eq!(config.limits, Limits::default());
}

#[test]
fn what_is_left_out_has_its_default() {
    let start = CONTRACT.find("[[projector]]").unwrap();
    let config = parse(&CONTRACT[start..]);
    assert_eq!(config.render, lantern_config::Render::default());
    assert_eq!((config.daemon.socket, config.device.select), (None, None));
    assert!(config.bodies.is_empty() && config.trackers.is_empty() && config.scene.nodes.is_empty());

    let tracker = "[[body]]\nname = \"a\"\n[[tracker]]\nname = \"t\"\nprotocol = \"lantern\"\nlisten = \"[::1]:7000\"\n\
                   bodies = { \"65535\" = \"a\" }\n";
    let config = parse(&format!("{tracker}{}", &CONTRACT[start..]));
    assert!(config.trackers[0].allow.iter().all(|address| address.is_loopback()));
    assert_eq!(config.bodies[0].drives, None);
}

#[test]
fn poses_are_predicted_from_when_the_configuration_says() {
    for (value, lead_ms) in
        [("0", None), ("0.0", None), ("\"auto\"", Some(0.0)), ("30", Some(30.0)), ("0.5", Some(0.5))]
    {
        let config = parse(&CONTRACT.replace("predict_ms = 0 ", &format!("predict_ms = {value} ")));
        assert_eq!(config.trackers[0].predict_lead_ms, lead_ms, "{value}");
    }
    let config = parse(&CONTRACT.replace("refresh_hz = 60", "refresh_hz = 60, latency_ms = 33.4"));
    assert_eq!(config.projectors[0].output.latency_ms, 33.4);
}

#[test]
fn a_picture_goes_where_the_configuration_says() {
    let of = |output: &str| {
        let config = parse(&CONTRACT.replace("{ kind = \"headless\", refresh_hz = 60 }", output));
        config.projectors[0].output.clone()
    };
    let window =
        |server: Option<&str>, fullscreen| OutputKind::Window { server: server.map(str::to_owned), fullscreen };
    assert_eq!(of("{ kind = \"window\" }"), Output { kind: window(None, Fullscreen::No), ..Output::default() });
    assert_eq!(of("{ kind = \"export\" }"), Output { kind: OutputKind::Export, ..Output::default() });
    assert_eq!(of("{ kind = \"window\", fullscreen = true }").kind, window(None, Fullscreen::Any));
    assert_eq!(
        of("{ kind = \"window\", fullscreen = false, server = \":1\" }").kind,
        window(Some(":1"), Fullscreen::No)
    );
    assert_eq!(
        of("{ kind = \"window\", fullscreen = \"HDMI-1\" }").kind,
        window(None, Fullscreen::On("HDMI-1".into()))
    );
    let display = |connector: Option<&str>, edid: Option<&str>| OutputKind::Display {
        connector: connector.map(str::to_owned),
        edid: edid.map(str::to_owned),
    };
    assert_eq!(of("{ kind = \"display\", connector = \"DP-1\" }").kind, display(Some("DP-1"), None));
    let hdr =
        of("{ kind = \"display\", edid = \"EPS-0123\", pixels = \"hdr10\", white_nits = 400, refresh_hz = 59.94 }");
    assert_eq!(hdr.kind, display(None, Some("EPS-0123")));
    assert_eq!((hdr.pixels, hdr.white_nits, hdr.refresh_hz), (Pixels::Hdr10, 400.0, Some(59.94)));
}

#[test]
fn relative_paths_start_from_the_files_folder() {
    let start = CONTRACT.find("[[projector]]").unwrap();
    let config = parse(&format!("[daemon]\nstate_dir = \"state\"\nasset_roots = [\"../a\"]\n{}", &CONTRACT[start..]));
    assert_eq!(config.daemon.state_dir.as_deref(), Some(Path::new("/base/state")));
    assert_eq!(config.daemon.asset_roots, [PathBuf::from("/base/../a")]);
    assert_eq!(config.base_dir, Path::new("/base"));
}

#[test]
fn a_calibration_may_be_a_file() {
    let start = CONTRACT.find("convention =").unwrap();
    let of = |keys: &str| {
        let config = parse(&format!("{}{keys}", &CONTRACT[CONTRACT.find("[[projector]]").unwrap()..start]));
        match config.projectors[0].calibration.clone() {
            Calibration::File(file) => file,
            Calibration::Matrices(matrices) => panic!("{matrices:?}"),
        }
    };
    let bare = of("file = \"left.yml\"\nformat = \"opencv\"");
    assert_eq!((bare.path.as_path(), bare.format), (Path::new("/base/left.yml"), Format::OpenCv));
    assert_eq!((bare.entry, bare.unit, bare.resolution_px, bare.near_m, bare.far_m, bare.view), Default::default());
    assert_eq!((bare.convention, bare.order), (Convention::Vulkan, Order::Row));
    assert_eq!(DMat4::from_cols_array_2d(&bare.world_from_file), DMat4::IDENTITY);

    let full = of(
        "file = \"/srv/all.json\"\nformat = \"opencv\"\nentry = \"left\"\nunit = \"in\"\nresolution_px = [1920, 1080]\n\
                   near_m = 0.05\nfar_m = 30\nconvention = \"opengl\"\norder = \"column\"\n\
                   view = [[1,0,0,0],[0,1,0,0],[0,0,1,0],[1,2,3,1]]\n\
                   world_from_file = [[0,2,0,1],[2,0,0,2],[0,0,2,3],[0,0,0,1]]",
    );
    assert_eq!(
        (full.path.as_path(), full.entry.as_deref(), full.unit),
        (Path::new("/srv/all.json"), Some("left"), Some(Unit::Inch))
    );
    assert_eq!((full.resolution_px, full.near_m, full.far_m), (Some([1920, 1080]), Some(0.05), Some(30.0)));
    assert_eq!((full.convention, full.order), (Convention::OpenGl, Order::Column));
    assert_eq!(full.view.unwrap()[1], [0.0, 1.0, 0.0, 2.0], "by columns");
    // A mirroring is allowed: the worlds of some are left-handed.
    assert_eq!(full.world_from_file[0], [0.0, 2.0, 0.0, 1.0]);
    for format in Format::ALL {
        assert_eq!(of(&format!("file = \"f\"\nformat = {:?}", format.as_str())).format, format);
    }
    for unit in Unit::ALL {
        assert_eq!(of(&format!("file = \"f\"\nformat = \"splash\"\nunit = {:?}", unit.as_str())).unit, Some(unit));
    }
}

#[test]
fn matrices_may_be_stored_by_columns() {
    let columns = CONTRACT
        .replace(
            "[[1,0,0,0],[0,1.6,0,0],[0,0,-1.01,-0.2],[0,0,-1,0]]",
            "[[1,0,0,0],[0,1.6,0,0],[0,0,-1.01,-1],[0,0,-0.2,0]]",
        )
        .replace(
            "[[1,0,0,0],[0,1,0,-1],[0,0,1,-2],[0,0,0,1]]",
            "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,-1,-2,1]]\norder = \"column\"",
        );
    let (rows, columns) = (parse(CONTRACT), parse(&columns));
    let [rows, columns] = [&rows, &columns].map(|config| matrices(&config.projectors[0]));
    assert_eq!((rows.projection, rows.view), (columns.projection, columns.view));
    assert_eq!((rows.order, columns.order), (Order::Row, Order::Column));
}

#[test]
fn a_device_may_be_a_bare_index() {
    let start = CONTRACT.find("[[projector]]").unwrap();
    let config = parse(&format!("[device]\nselect = 1\n{}", &CONTRACT[start..]));
    assert_eq!(config.device.select.as_deref(), Some("1"));
}

#[test]
fn a_device_traces_by_what_the_configuration_says() {
    let start = CONTRACT.find("[render]").unwrap();
    for (key, expected) in [
        ("", RayTracing::Auto),
        ("ray_tracing = \"auto\"", RayTracing::Auto),
        ("ray_tracing = \"bvh\"", RayTracing::Bvh),
        ("ray_tracing = \"ray-query\"", RayTracing::RayQuery),
    ] {
        let config = parse(&format!("[device]\n{key}\n{}", &CONTRACT[start..]));
        assert_eq!(config.device.ray_tracing, expected, "{key}");
    }
}

fn matrices(projector: &Projector) -> &Matrices {
    match &projector.calibration {
        Calibration::Matrices(matrices) => matrices,
        Calibration::File(file) => panic!("a file: {file:?}"),
    }
}

fn clip_from_world(projector: &Projector) -> DMat4 {
    let rows = |rows| DMat4::from_cols_array_2d(&rows).transpose();
    rows(matrices(projector).projection) * rows(matrices(projector).view)
}

/// Where a point of the world is in the image, each side from −1 to 1, with +1 to the right and on top.
fn image_from_world(projector: &Projector, point_m: DVec3) -> Option<[f64; 2]> {
    let clip: DVec4 = clip_from_world(projector) * point_m.extend(1.0);
    let up = if matrices(projector).convention == Convention::OpenGl { 1.0 } else { -1.0 };
    (clip.w > 0.0).then(|| [clip.x / clip.w, up * clip.y / clip.w])
}

#[test]
fn the_demos_projectors_look_at_the_same_scene() {
    let config = parse(DEMO_TOML);
    assert_eq!(config.limits, Limits::default(), "the demo says that it shows the defaults");
    assert_eq!(config.render, lantern_config::Render::default());
    assert_eq!(config.viewer().unwrap().drives, Some(Drives::Viewer));
    let names: Vec<_> = config.projectors.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["left", "right"]);
    assert_ne!(matrices(&config.projectors[0]).convention, matrices(&config.projectors[1]).convention);

    for projector in &config.projectors {
        // The middle of the picture is the middle of the scene, and what is higher in the world is higher in it.
        let [x, y] = image_from_world(projector, DVec3::new(0.0, 0.2, 0.0)).unwrap();
        assert!(x.abs() < 1e-6 && y.abs() < 1e-6, "{}: {x} {y}", projector.name);
        assert!(image_from_world(projector, DVec3::new(0.0, 0.3, 0.0)).unwrap()[1] > 0.01);
        assert!(image_from_world(projector, DVec3::new(0.1, 0.2, 0.0)).unwrap()[0] > 0.01);
        // Both reach every thing on the table, so their light overlaps there.
        for node in config.scene.nodes.iter().filter(|node| node.name != "floor") {
            let place = DVec3::from_array(node.translation_m.unwrap());
            let [x, y] = image_from_world(projector, place).unwrap();
            assert!(x.abs() < 0.8 && y.abs() < 0.8, "{} sees {} at {x} {y}", projector.name, node.name);
        }
        // Depth grows away from the projector, between the limits of its convention.
        let near = if matrices(projector).convention == Convention::OpenGl { -1.0 } else { 0.0 };
        let clip = clip_from_world(projector) * DVec4::new(0.0, 0.2, 0.0, 1.0);
        assert!((near..1.0).contains(&(clip.z / clip.w)));
    }
    let [left, right] = [0, 1].map(|i| clip_from_world(&config.projectors[i]).inverse());
    for (world_from_clip, x) in [(left, -1.1), (right, 1.1)] {
        // The centre of projection is where clip x, y and w vanish.
        let eye = world_from_clip * DVec4::new(0.0, 0.0, -1.0, 0.0);
        let eye = eye.truncate() / eye.w;
        assert!((eye - DVec3::new(x, 1.5, 1.5)).length() < 1e-4, "{eye}");
    }
}

#[test]
fn every_example_is_read_from_its_file() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples");
    let mut count = 0;
    for entry in std::fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        if let Err(problems) = Config::load(&path) {
            panic!("{}", problems.iter().map(|p| format!("{p}\n")).collect::<String>());
        }
        count += 1;
    }
    assert!(count >= 2);
}

#[test]
fn fingerprints_tell_scenes_apart_and_nothing_else() {
    let a = parse(DEMO_TOML).scene;
    assert_eq!(a.fingerprint(), parse(DEMO_TOML).scene.fingerprint());
    assert_eq!(a.fingerprint().len(), 64);
    // Comments, spelling and other sections are not the scene.
    let respelled = DEMO_TOML.replace("metallic   = 1.0", "metallic = 1").replace("max_depth = 8", "max_depth = 3");
    assert!(respelled != DEMO_TOML);
    assert_eq!(parse(&respelled).scene.fingerprint(), a.fingerprint());
    for change in [("ior          = 1.5", "ior = 1.6"), ("name  = \"floor\"", "name = \"ground\"")] {
        let changed = DEMO_TOML.replace(change.0, change.1);
        assert!(changed != DEMO_TOML);
        assert_ne!(parse(&changed).scene.fingerprint(), a.fingerprint());
    }
    // Kept beside stored states, so it may not change between releases without notice. What nobody has written does not count,
    // but for the fingerprint of states that were kept by the first releases.
    let nothing = lantern_config::Scene::default();
    let sha256_of_no_keys = "44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a";
    assert_eq!(nothing.fingerprint(), sha256_of_no_keys);
    assert_eq!(nothing.fingerprint_with_nulls(), "08b01e9ea9271d35cbad8529daa830ccbcc50b4c7893ec6b329211161e16db11");
}

#[test]
fn places_of_entries_are_known() {
    let config = parse(CONTRACT);
    let line_of = |text: &str| CONTRACT.lines().position(|line| line.starts_with(text)).unwrap() + 1;
    let place = |name: &str| config.places.of(name).unwrap();
    assert_eq!(place("scene.node \"car\""), (line_of("[[scene.node]]"), 1));
    assert_eq!(place("scene.node \"car\".uri"), (line_of("uri"), 8));
    assert_eq!(place("scene.environment.uri"), (line_of("environment"), 15));
    assert_eq!(place("tracker \"optitrack\".listen").0, line_of("listen"));
    assert_eq!(place("projector \"left\".calibration.view").0, line_of("view"));
    // What is not written is where its table is.
    assert_eq!(place("scene.node \"car\".visible"), place("scene.node \"car\""));
    assert_eq!(config.places.of("projector \"right\".output"), None);
}
