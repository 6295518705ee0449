//! What must be refused, and how: place, cause and remedy, and everything at once.

use lantern_config::{Config, Problem};
use std::path::Path;

const GOOD: &str = r#"
[scene]
[[scene.node]]
name = "car"
uri = "car.glb"
[[body]]
name = "head"
drives = "viewer"
[[tracker]]
name = "t"
protocol = "lantern"
listen = "127.0.0.1:7000"
bodies = { "1" = "head" }
[[projector]]
name = "left"
resolution_px = [1280, 800]
[projector.calibration]
convention = "opengl"
projection = [[1,0,0,0],[0,1.6,0,0],[0,0,-1.01,-0.2],[0,0,-1,0]]
view = [[1,0,0,0],[0,1,0,-1],[0,0,1,-2],[0,0,0,1]]
"#;

fn problems(text: &str) -> Vec<Problem> {
    match Config::parse(text, "lab.toml", Path::new("/base")) {
        Ok(_) => panic!("accepted:\n{text}"),
        Err(problems) => {
            assert!(!problems.is_empty());
            for problem in &problems {
                assert!(!problem.hint.is_empty() && !problem.message.is_empty(), "{problem}");
            }
            problems
        }
    }
}

/// The one problem after `old` became `new`; it must say `says` and stand on the line of the change, or on `line`.
#[track_caller]
fn one(old: &str, new: &str, says: &str) -> Problem {
    let Some(at) = GOOD.find(old) else { panic!("`{old}` is not there to change") };
    let text = GOOD.replacen(old, new, 1);
    let found = problems(&text);
    let [problem] = found.as_slice() else { panic!("not one problem: {found:#?}") };
    assert!(problem.to_string().contains(says), "`{problem}` does not say `{says}`");
    // Not before the change, and not after its last line.
    let (first, last) = (GOOD[..at].matches('\n').count() + 1, text[..at + new.len()].matches('\n').count() + 1);
    assert!((first..=last).contains(&problem.line), "{problem}: line {first} to {last} was changed");
    problem.clone()
}

#[test]
fn the_text_that_the_others_change_is_good() {
    Config::parse(GOOD, "lab.toml", Path::new("/base")).unwrap();
}

#[test]
fn places_are_exact() {
    let problem = one("drives = \"viewer\"", "drive = \"viewer\"", "did you mean `drives`?");
    assert_eq!((problem.file.as_str(), problem.line, problem.column), ("lab.toml", 8, 1));
    let problem = one("[1280, 800]", "[1280, 0]", "1 to 16384");
    assert_eq!((problem.line, problem.column), (16, 24));
    assert_eq!(
        problem.to_string(),
        "lab.toml:16:24: `projector.resolution_px` holds 0; hint: take a number that is whole, from 1 to 16384"
    );
    // Columns count characters, not bytes.
    let problem = one(
        "name = \"car\"\nuri = \"car.glb\"",
        "name = \"é\"\nuri = \"é\" # ü\nrole = \"pro\"",
        "did you mean \"prop\"?",
    );
    assert_eq!((problem.line, problem.column), (6, 8));
}

#[test]
fn unknown_keys_name_the_nearest() {
    one("[scene]", "[scene]\nenviroment = \"#000000\"", "did you mean `environment`?");
    one("[scene]", "[render]\nsample = 4\n[scene]", "did you mean `samples`?");
    one("[scene]", "[deamon]\n[scene]", "did you mean `daemon`?");
    one("convention =", "conventoin = \"x\"\nconvention =", "did you mean `convention`?");
    one("resolution_px", "outptu = 1\nresolution_px", "did you mean `output`?");
    one("uri =", "translation = [0, 0, 0]\nuri =", "did you mean `translation_m`?");
    one("[scene]", "[limits]\nmax_client = 3\n[scene]", "did you mean `max_clients`?");
}

#[test]
fn missing_keys_are_named() {
    // Where nothing stands there is no place to point at but the table that should have it.
    let missing = |line: &str, says: &str, header: &str| {
        let found = problems(&GOOD.replacen(line, "", 1));
        assert_eq!(found.len(), 1, "{found:#?}");
        assert!(found[0].message.contains(says), "{}", found[0]);
        let at = GOOD.find(header).unwrap();
        assert_eq!(found[0].line, GOOD[..at].matches('\n').count() + 1, "{}", found[0]);
        found[0].hint.clone()
    };
    missing("uri = \"car.glb\"\n", "[scene.node] has no `uri`", "[[scene.node]]");
    missing("protocol = \"lantern\"\n", "[tracker] has no `protocol`", "[[tracker]]");
    missing("listen = \"127.0.0.1:7000\"\n", "has no `listen`", "[[tracker]]");
    missing("bodies = { \"1\" = \"head\" }\n", "has no `bodies`", "[[tracker]]");
    missing("resolution_px = [1280, 800]\n", "has no `resolution_px`", "[[projector]]");
    missing("view = [[1,0,0,0],[0,1,0,-1],[0,0,1,-2],[0,0,0,1]]\n", "has no `view`", "[projector.calibration]");
    let hint = missing("convention = \"opengl\"\n", "no `convention`", "[projector.calibration]");
    assert!(hint.contains("\"opengl\"") && hint.contains("\"vulkan\""), "{hint}");
    assert!(problems("")[0].message.contains("no projector"));
}

#[test]
fn types_say_what_was_expected() {
    one("\"car.glb\"", "3", "is an integer; hint: a string");
    one("[1280, 800]", "\"1280x800\"", "is a string; hint: an array of 2 numbers");
    one("[1280, 800]", "[1280]", "1 entries instead of 2");
    one("[1280, 800]", "[1280, 800, 3]", "3 entries instead of 2");
    one("[1280, 800]", "[1280.5, 800]", "whole");
    one("[1280, 800]", "[1280, 16385]", "1 to 16384");
    one("[1280, 800]", "[1280, -800]", "1 to 16384");
    one("[scene]", "[render]\nblend = 1\n[scene]", "true or false");
    one("[scene]", "render = 4\n[scene]", "a table is expected");
    one("{ \"1\" = \"head\" }", "[\"head\"]", "a table is expected");
    one("[[body]]\nname", "[body]\nname", "[[body]]");
}

#[test]
fn names_must_resolve_and_be_unique() {
    one("[[body]]", "[[scene.node]]\nname = \"car\"\nuri = \"b.glb\"\n[[body]]", "`car` is taken");
    one("[[tracker]]", "[[body]]\nname = \"head\"\n[[tracker]]", "`head` is taken");
    one("\"viewer\"", "\"node:cra\"", "no node `cra`; hint: there are `car`");
    one("\"viewer\"", "\"camera\"", "nothing that a body can drive");
    one("[[tracker]]", "[[body]]\nname = \"b\"\ndrives = \"viewer\"\n[[tracker]]", "several viewers are not built yet");
    one("\"1\" = \"head\"", "\"1\" = \"haed\"", "no body `haed`; hint: there are `head`");
    one("\"1\" = \"head\"", "\"one\" = \"head\"", "`one` is no id");
    one("\"1\" = \"head\"", "\"65536\" = \"head\"", "0 to 65535");
    one("name = \"left\"", "name = \"\"", "no usable name");
    one("name = \"car\"", "name = \"car/door\"", "`/`");
}

#[test]
fn numbers_must_be_in_range() {
    let render = |line: &str| format!("[render]\n{line}\n[scene]");
    one("[scene]", &render("samples = 5"), "take 4 or 9");
    one("[scene]", &render("samples = 0"), "1 to 256");
    one("[scene]", &render("samples = 99999999999999999999"), "1 to 256");
    one("[scene]", &render("max_depth = -1"), "0 to 64");
    for key in ["position_m", "offset_m"] {
        for value in ["1.1e8", "-1e9", "nan", "-inf"] {
            one(
                "drives =",
                &format!("{key} = [0, {value}, 0]\ndrives ="),
                if value.contains('e') { "1e8" } else { "finite" },
            );
        }
    }
    for hz in ["0", "0.5", "-60", "1001", "nan"] {
        let output = format!("output = {{ kind = \"headless\", refresh_hz = {hz} }}\nresolution_px");
        one("resolution_px", &output, if hz == "nan" { "finite" } else { "from 1 to 1000" });
    }
    one("[scene]", "[limits]\nmax_lights = 0\n[scene]", "1 to 32");
    one("[scene]", "[limits]\nmax_lights = 33\n[scene]", "1 to 32");
    one("[scene]", &render("raster = \"later\""), "did you mean \"after\"?");
    one("[scene]", "[device]\nray_tracing = \"ray-queries\"\n[scene]", "did you mean \"ray-query\"?");
    one("uri =", "rotation = [0, 0, 0, 2]\nuri =", "norm 2");
    one("uri =", "scale = [1, 0, 1]\nuri =", "not 0");
    one("uri =", "translation_m = [0, nan, 1]\nuri =", "finite");
    one("uri =", "translation_m = [0, 1e999, 1]\nuri =", "finite");
    one("[scene]", "[scene]\nenvironment = \"#12345\"", "six hexadecimal digits");
    one("[scene]", "[scene]\nenvironment = \"sky.jpg\"", ".hdr, .exr or .png");
    let node = "[[scene.node]]";
    one(node, "[[scene.material]]\nname = \"m\"\nmetallic = 1.5\n[[scene.node]]", "from 0 to 1");
    one(node, "[[scene.material]]\nname = \"m\"\nior = 0.5\n[[scene.node]]", "at least 1");
    one(node, "[[scene.material]]\nname = \"m\"\nbase_color = [1, 1]\n[[scene.node]]", "2 entries");
    one(
        node,
        "[[scene.light]]\nname = \"l\"\nkind = \"spot\"\ndirection = [0, 1, 0]\n[[scene.node]]",
        "has no `position_m`",
    );
    one(
        node,
        "[[scene.light]]\nname = \"l\"\nkind = \"directional\"\ndirection = [0, 0, 0]\n[[scene.node]]",
        "is zero",
    );
    one(node, "[[scene.light]]\nname = \"l\"\nkind = \"sun\"\n[[scene.node]]", "there are \"directional\"");
}

#[test]
fn matrices_must_be_whole() {
    let view = "[[1,0,0,0],[0,1,0,-1],[0,0,1,-2],[0,0,0,1]]";
    one(view, "[[1,0,0,0],[0,1,0,-1],[0,0,1,-2]]", "3 rows instead of 4");
    one(view, "[[1,0,0,0],[0,1,0],[0,0,1,-2],[0,0,0,1]]", "3 entries instead of 4");
    one(view, "[[1,0,0,0],[0,1,0,-1],[0,0,1,-2],[0,0,0,0]]", "singular");
    one(view, "[[1,0,0,0],[0,1,0,-1],[2,3,0,-3],[0,0,0,1]]", "singular");
    one(view, "[[1,0,0,0],[0,1,0,inf],[0,0,1,-2],[0,0,0,1]]", "finite");
    one(view, "\"identity\"", "an array of 4 rows");
    let tracker = |matrix: &str| format!("world_from_tracker = {matrix}\nlisten =");
    one("listen =", &tracker("[[-1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"), "mirrors");
    one("listen =", &tracker("[[2,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"), "stretches");
    one("listen =", &tracker("[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,1,1]]"), "bends");
    // A steep but honest frustum seen from afar is no singular matrix.
    let far = "projection = [[9,0,0,0],[0,9,0,0],[0,0,-1.000002,-0.002],[0,0,-1,0]]\n\
               view = [[1,0,0,2000],[0,1,0,-900],[0,0,1,-2000],[0,0,0,1]]\n";
    let start = GOOD.find("projection =").unwrap();
    Config::parse(&format!("{}{far}", &GOOD[..start]), "lab.toml", Path::new("/base")).unwrap();
}

#[test]
fn addresses_must_parse() {
    for address in ["localhost:7000", "127.0.0.1", "127.0.0.1:70000", "::1:7000x", ""] {
        one("127.0.0.1:7000", address, "no address to listen at");
    }
    one("listen =", "allow = [\"127.0.0.1:7000\"]\nlisten =", "no IP address");
    let second =
        "[[tracker]]\nname = \"u\"\nprotocol = \"lantern\"\nlisten = \"127.0.0.1:7000\"\nbodies = {}\n[[projector]]";
    one("[[projector]]", second, "another tracker listens");
}

/// The one problem of a tracker of these keys, beside what each has.
#[track_caller]
fn tracker(keys: &str, says: &str) -> Problem {
    one("protocol = \"lantern\"\nlisten = \"127.0.0.1:7000\"\nbodies = { \"1\" = \"head\" }", keys, says)
}

#[test]
fn protocols_say_what_they_want() {
    let with = |protocol: &str, bodies: &str, more: &str| {
        format!("protocol = \"{protocol}\"\nlisten = \"127.0.0.1:7000\"\nbodies = {bodies}\n{more}")
    };
    let (head, osc) = ("{ \"1\" = \"head\" }", |more: &str| with("osc", "{ \"1\" = \"head\" }", more));
    one("protocol = \"lantern\"", "protocol = \"vrpn\"", "there are \"lantern\", \"osc\"");

    // Keys of another protocol.
    one("listen =", "preset = \"vmc\"\nlisten =", "`tracker.preset` belongs to protocol \"osc\"");
    tracker(&osc("preset = \"vmc\"\nversion = \"4.1\""), "`tracker.version` belongs to protocol \"natnet\"");
    tracker(&with("freed", head, "up = \"z\""), "belongs to protocol \"dtrack\"");
    tracker(&with("natnet", head, "signs = [1, 1, 1, 1, 1, 1]"), "belongs to protocol \"opentrack\"");

    // OSC.
    tracker(&osc(""), "neither `preset` nor `address`");
    tracker(&osc("preset = \"vmcc\""), "did you mean \"vmc\"?");
    tracker(&osc("preset = \"vmc\"\naddress = \"/a\""), "twice");
    tracker(&osc("address = \"/a\""), "no `arguments`");
    for address in ["a", "/", "/a//b", "/a?", "/a{id}", "/{id}/{id}", "/#bundle"] {
        tracker(&osc(&format!("address = \"{address}\"\narguments = [\"x\", \"y\", \"z\"]")), "no address");
    }
    let arguments = |words: &str| osc(&format!("address = \"/{{id}}\"\narguments = [{words}]"));
    tracker(&arguments("\"x\", \"y\", \"w\""), "there are \"id\", \"x\"");
    for words in
        ["", "\"x\"", "\"_\"", "\"x\", \"y\", \"z\", \"x\"", "\"qx\", \"qy\", \"qz\"", "\"x\", \"y\", \"z\", \"rx\""]
    {
        tracker(&arguments(words), "describes no pose");
    }
    let turned_twice = "\"qx\", \"qy\", \"qz\", \"qw\", \"rx\", \"ry\", \"rz\"";
    tracker(&arguments(turned_twice), "describes no pose");
    tracker(&arguments("\"id\", \"x\", \"y\", \"z\""), "two places");
    let pattern = "address = \"/{id}\"\narguments = [\"x\", \"y\", \"z\"]\n";
    tracker(&osc(&format!("{pattern}axes = \"x-up\"")), "\"y-up\", \"y-up-left\"");
    tracker(&osc(&format!("{pattern}units = \"km\"")), "\"m\", \"cm\"");

    // The others.
    for version in ["\"2.9\"", "5", "4", "\"four\"", "\"3.2\""] {
        tracker(&with("natnet", head, &format!("version = {version}")), "no known version");
    }
    for server in ["motive", "0.0.0.0", "239.255.42.99", "10.0.0.1:0"] {
        tracker(&with("natnet", head, &format!("server = \"{server}\"")), "no server's address");
    }
    let refused = with("natnet", head, "server = \"10.0.0.1\"\nallow = [\"10.0.0.2\"]");
    tracker(&refused, "`allow` does not have 10.0.0.1");
    tracker(&with("opentrack", head, "signs = [1, 1, 1, 1, 1]"), "5 entries instead of 6");
    tracker(&with("opentrack", head, "signs = [1, 1, 1, 1, 1, 2]"), "1 or -1");
    tracker(&with("dtrack", head, "up = \"x\""), "\"y\", \"z\"");
}

#[test]
fn ids_are_those_of_the_protocol() {
    let with = |protocol: &str, id: &str| {
        format!("protocol = \"{protocol}\"\nlisten = \"127.0.0.1:7000\"\nbodies = {{ \"{id}\" = \"head\" }}")
    };
    for (protocol, id) in [
        ("lantern", "65536"),
        ("lantern", "head"),
        ("freed", "256"),
        ("natnet", "head"),
        ("natnet", "-1"),
        ("dtrack", "head"),
        ("dtrack", "flystick x"),
        ("osc\"\npreset = \"vrchat", "9"),
        ("osc\"\npreset = \"vrchat", "hip"),
        ("osc\"\npreset = \"optitrack", "hip"),
    ] {
        tracker(&with(protocol, id), "no id of a body");
    }
    for (protocol, id) in [
        ("freed", "255"),
        ("natnet", "1"),
        ("psn", "3"),
        ("psn", "Tracker 1"),
        ("dtrack", "0"),
        ("dtrack", "flystick 1"),
        ("opentrack", "face"),
        ("osc\"\npreset = \"vmc", "LHR-01234567"),
        ("osc\"\npreset = \"vrchat", "head"),
        ("osc\"\npreset = \"optitrack", "12"),
        ("osc\"\naddress = \"/*/pose\"\narguments = [\"x\", \"y\", \"z\"]\naxes = \"z-up", "/head/pose"),
    ] {
        let keys = with(protocol, id);
        let text = GOOD.replacen(
            "protocol = \"lantern\"\nlisten = \"127.0.0.1:7000\"\nbodies = { \"1\" = \"head\" }",
            &keys,
            1,
        );
        let config =
            Config::parse(&text, "lab.toml", Path::new("/base")).unwrap_or_else(|problems| panic!("{problems:?}"));
        assert_eq!(config.trackers[0].bodies.keys().collect::<Vec<_>>(), [id]);
    }
    // The same number written twice, and two bodies where there is one.
    let two = |protocol: &str| {
        format!(
            "protocol = \"{protocol}\"\nlisten = \"127.0.0.1:7000\"\nbodies = {{ \"1\" = \"head\", \"01\" = \"head\" }}"
        )
    };
    tracker(&two("lantern"), "there twice");
    let two = two("opentrack").replace("\"01\"", "\"2\"");
    tracker(&two, "mean one body");
}

#[test]
fn groups_have_an_interface_and_addresses_have_none() {
    one("127.0.0.1:7000", "239.255.42.99:1511", "no `interface` says where");
    one("127.0.0.1:7000", "[ff02::1]:1511", "no `interface` says where");
    one("listen =", "interface = \"lo\"\nlisten =", "which 127.0.0.1 is not");
    one("listen = \"127.0.0.1:7000\"", "interface = \"lo\"\nlisten = \"239.255.42.99:0\"", "not 0");
    // Whoever listens everywhere listens there too.
    for (first, second) in [("127.0.0.1", "0.0.0.0"), ("0.0.0.0", "127.0.0.1"), ("0.0.0.0", "0.0.0.0")] {
        let second = format!(
            "[[tracker]]\nname = \"u\"\nprotocol = \"lantern\"\nlisten = \"{second}:7000\"\nbodies = {{}}\n[[projector]]"
        );
        let text = GOOD.replacen("127.0.0.1", first, 1).replacen("[[projector]]", &second, 1);
        let found = problems(&text);
        assert!(found.len() == 1 && found[0].message.contains("another tracker listens at"), "{found:#?}");
    }
}

#[test]
fn predictions_have_a_bound() {
    one("listen =", "predict_ms = -1\nlisten =", "from 0 to 150");
    one("listen =", "predict_ms = 151\nlisten =", "from 0 to 150");
    one("listen =", "predict_ms = \"outo\"\nlisten =", "did you mean \"auto\"");
    one("listen =", "predict_ms = true\nlisten =", "a number");
    for latency in ["-1", "1001"] {
        let output = format!("output = {{ kind = \"headless\", latency_ms = {latency} }}\nresolution_px");
        one("resolution_px", &output, "from 0 to 1000");
    }
}

#[test]
fn a_body_carries_a_projector_that_there_is_and_no_other_body_does() {
    one("\"viewer\"", "\"projector:lefd\"", "there are `left`");
    one("\"viewer\"", "\"projector:left\"\noffset_m = [0, 0, 1]", "has no offset");
    let second = "[[body]]\nname = \"b\"\ndrives = \"projector:left\"\n[[body]]\nname = \"c\"\ndrives = \"projector:left\"\n[[tracker]]";
    one("[[tracker]]", second, "another body drives `projector:left` already");
}

#[test]
fn an_output_has_the_keys_of_its_kind() {
    let output =
        |keys: &str, words: &str| one("resolution_px", &format!("output = {{ {keys} }}\nresolution_px"), words);
    output("kind = \"windwo\"", "did you mean \"window\"");
    output("kind = \"headless\", connector = \"DP-1\"", "belongs to a display");
    output("kind = \"window\", edid = \"EPS-0123\"", "belongs to a display");
    output("kind = \"display\", connector = \"DP-1\", fullscreen = true", "belongs to a window");
    output("kind = \"headless\", server = \":0\"", "belongs to a window");
    output("kind = \"export\", server = \":0\"", "belongs to a window");
    output("kind = \"display\"", "known by its `connector` or its `edid`");
    output("kind = \"window\", fullscreen = 1", "true or false");
    output("kind = \"window\", pixels = \"12-bit\"", "\"10-bit\"");
    output("kind = \"window\", pixels = \"hdr10\", white_nits = 0", "from 1 to 10000");
}

#[test]
fn calibrations_are_matrices_or_a_file() {
    one("convention =", "file = \"left.yml\"\nformat = \"opencv\"\nconvention =", "matrices or a file");
    one("convention =", "format = \"opencv\"\nconvention =", "without `file`");
    for key in
        ["entry = \"a\"", "unit = \"m\"", "resolution_px = [8, 8]", "near_m = 1", "far_m = 2", "world_from_file = []"]
    {
        one("convention =", &format!("{key}\nconvention ="), "is of no use without `file`");
    }
    one("convention =", "order = \"rows\"\nconvention =", "did you mean \"row\"? there are \"row\", \"column\"");

    let start = GOOD.find("convention").unwrap();
    let file = |keys: &str, says: &str| {
        let found = problems(&format!("{}file = \"left\"\n{keys}\n", &GOOD[..start]));
        let [problem] = found.as_slice() else { panic!("not one problem: {found:#?}") };
        assert!(problem.to_string().contains(says), "`{problem}` does not say `{says}`");
    };
    file("", "no `format`, which is required; hint: add format = \"opencv\", \"mpcdi\", \"roomalive\" or \"splash\"");
    file("format = \"open-cv\"", "did you mean \"opencv\"?");
    file("format = \"opencv\"\nunit = \"metre\"", "there are \"mm\", \"cm\", \"dm\", \"m\", \"in\", \"ft\", \"yd\"");
    file("format = \"splash\"\nresolution_px = [0, 8]", "from 1 to 16384");
    file("format = \"splash\"\nnear_m = 0", "from 0.0001 to 10000");
    file("format = \"splash\"\nnear_m = 2\nfar_m = 2", "`near_m` is 2; hint: the far plane lies beyond");
    file("format = \"splash\"\nentry = \"\"", "no usable name");
    file("format = \"mpcdi\"\norder = \"column\"", "a file of format \"mpcdi\" says it itself");
    file(
        "format = \"splash\"\nworld_from_file = [[2,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]",
        "bends or stretches space",
    );
    file("format = \"roomalive\"\nview = [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]", "says it itself");
    file("format = \"opencv\"\nunits = \"mm\"", "did you mean `unit`?");
}

#[test]
fn all_problems_at_once_in_order() {
    let text = GOOD
        .replace("uri = \"car.glb\"", "url = \"car.glb\"")
        .replace("\"viewer\"", "\"node:bus\"")
        .replace("127.0.0.1:7000", "nowhere")
        .replace("[1280, 800]", "[0, 0]")
        .replace("\"opengl\"", "\"directx\"");
    let found = problems(&text);
    let lines: Vec<_> = found.iter().map(|problem| problem.line).collect();
    assert!(lines.is_sorted(), "{found:#?}");
    for says in ["no `uri`", "unknown key `url`", "no node `bus`", "`nowhere`", "holds 0", "directx"] {
        assert!(found.iter().any(|problem| problem.message.contains(says)), "{says} in {found:#?}");
    }
    assert_eq!(found.len(), 7, "both sides of the resolution are named: {found:#?}");
}

#[test]
fn texts_that_are_no_toml() {
    let found = problems("[scene\nenvironment = \n[[projector]]\nname = \"left\nx = 1 2\n");
    assert!(found.len() >= 3, "{found:#?}");
    assert_eq!(found[0].line, 1);
    one("name = \"head\"", "name = \"head\"\nname = \"hat\"", "duplicate key");
    problems("\u{0}\u{1}");
    problems(&"[".repeat(100_000));
    problems(&"a.".repeat(100_000));
}

#[test]
fn files_that_cannot_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let missing = Config::load(&folder.path().join("none.toml")).unwrap_err();
    assert!(missing[0].to_string().contains("none.toml: cannot be read"), "{}", missing[0]);
    assert!(Config::load(folder.path()).is_err());
    let latin = folder.path().join("latin.toml");
    std::fs::write(&latin, b"name = \"\xe9\"").unwrap();
    assert!(Config::load(&latin).unwrap_err()[0].message.contains("UTF-8"));
}

#[test]
fn metrics_are_for_this_machine_alone() {
    one("[scene]", "[metrics]\nlisten = \"0.0.0.0:9464\"\n[scene]", "127.0.0.1 or [::1]");
    one("[scene]", "[metrics]\nlisten = \"192.168.1.7:9464\"\n[scene]", "127.0.0.1 or [::1]");
    one("[scene]", "[metrics]\nlisten = \"[::]:9464\"\n[scene]", "127.0.0.1 or [::1]");
    one("[scene]", "[metrics]\nlisten = \"localhost\"\n[scene]", "an address and a port");
    one("[scene]", "[metrics]\n[scene]", "add listen = \"127.0.0.1:9464\"");
}
