//! What a frame costs in things that can be counted (CONTRACT, Bench): rays, submissions, dispatches, barriers and bytes of a small
//! fixed scene, by `lanternd bench`, exactly as tests/tests/counters.txt has them. A change that makes a frame do more shows here,
//! whatever the machine's speed is; one that is meant to is told with `LANTERN_BLESS=1 cargo test -p lantern-tests --test counters`.
//!
//! How many rays a mirror or a shadow takes depends on the driver's rounding, and bytes on its alignment; those are compared where
//! the driver is the one that the table names, and the rest everywhere.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use lantern_tests::{harness, lab};
use serde_json::Value;

/// Glass and a mirror on a floor, and a virtual thing, for two projectors.
const SCENE: &str = r##"
[render]
samples = 4
[scene]
environment = "#406080"
[[scene.node]]
name = "floor"
uri = "lantern:checker"
scale = [0.3, 0.3, 0.3]
[[scene.node]]
name = "mirror"
uri = "lantern:sphere"
translation_m = [-0.4, 0.4, 0]
scale = [0.4, 0.4, 0.4]
[[scene.node]]
name = "ghost"
uri = "lantern:cube"
role = "virtual"
translation_m = [0.2, 0.3, 0.9]
scale = [0.2, 0.2, 0.2]
[[scene.node]]
name = "glass"
uri = "lantern:sphere"
translation_m = [0.5, 0.3, 0.2]
scale = [0.3, 0.3, 0.3]
[[scene.material]]
name = "mirror/sphere"
metallic = 1.0
roughness = 0.0
[[scene.material]]
name = "glass/sphere"
base_color = [1, 1, 1]
transmission = 1.0
thickness = 0.5
roughness = 0.0
[[scene.light]]
name = "lamp"
kind = "point"
position_m = [1, 3, 1]
intensity = 8.0
"##;

const TABLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/counters.txt");

/// The table of a run: the driver, what each case submits, and each projector's rays and bytes.
fn table(told: &Value) -> String {
    let mut all = format!("driver: {}, {}\n", text(&told["device"]["name"]), text(&told["device"]["driver"]));
    let _ = writeln!(all, "all, of this driver: bytes {}", number(&told["gpu_bytes"]));
    for case in ["static", "viewer", "node", "full"] {
        let found = &told["cases"][case];
        let work = &found["work"];
        let _ = writeln!(all, "{case}");
        let counts = ["submissions", "dispatches", "barriers"].map(|key| format!("{key} {}", number(&work[key])));
        let _ = writeln!(all, "  frame: {}", counts.join(", "));
        for (name, projector) in found["projectors"].as_object().unwrap() {
            let _ = writeln!(all, "  {name}: primary {}", number(&projector["rays"]["primary"]));
            let rays =
                ["secondary", "shadow", "blend"].map(|kind| format!("{kind} {}", number(&projector["rays"][kind])));
            let _ = writeln!(
                all,
                "  {name}, of this driver: {}, bytes {}",
                rays.join(", "),
                number(&projector["gpu_bytes"])
            );
        }
    }
    all
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap()
}

fn number(value: &Value) -> u64 {
    value.as_u64().unwrap()
}

#[test]
fn a_frame_costs_what_the_table_says() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("lab.toml");
    fs::write(&file, [SCENE, lab::TRACKED, &lab::projectors()].join("\n")).unwrap();
    let output = harness::run("lanternd", &["bench", "--frames", "1", "--json", "-c", file.to_str().unwrap()]).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found = table(&serde_json::from_slice(&output.stdout).unwrap());
    print!("{found}");
    if std::env::var_os("LANTERN_BLESS").is_some_and(|value| value == "1") {
        fs::write(TABLE, &found).unwrap();
        return;
    }

    let expected = fs::read_to_string(Path::new(TABLE)).unwrap();
    let of_any_driver = |table: &str| -> Vec<String> {
        table.lines().skip(1).filter(|line| !line.contains("of this driver")).map(str::to_owned).collect()
    };
    let hint = "hint: where this is meant, LANTERN_BLESS=1 cargo test -p lantern-tests --test counters";
    assert_eq!(of_any_driver(&found), of_any_driver(&expected), "{hint}");
    if found.lines().next() == expected.lines().next() {
        assert!(found == expected, "expected\n{expected}\nfound\n{found}\n{hint}");
    } else {
        println!("rays beside primary ones and bytes are not compared: the table is of {:?}", expected.lines().next());
    }
}
