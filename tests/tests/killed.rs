//! `kill -9` in the middle of durable edits, a few times; `tests/kill/run.py` alone does it two hundred times.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::process::Command;

use lantern_tests::harness;

const SCRIPTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/kill");

/// Runs a script on the daemon as just built, and gives what it says.
fn script(name: &str, arguments: &[&str]) -> String {
    let lanternd = harness::program("lanternd").unwrap();
    let mut command = Command::new("python3");
    let output = command.arg(format!("{SCRIPTS}/{name}")).arg("--lanternd").arg(lanternd).args(arguments).output();
    let output = output.unwrap();
    let said = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap()).concat();
    assert!(output.status.success(), "{said}");
    said
}

#[test]
fn what_was_acknowledged_is_whole_after_each_of_a_few_kills() {
    let said = script("run.py", &["--times", "7", "--validation"]);
    assert!(said.contains("\"kills\": 8"), "{said}");
}

#[test]
fn a_durable_edit_goes_to_the_disk_in_the_order_that_lasts() {
    let said = script("order.py", &[]);
    if said.contains("skipped") {
        println!("{said}");
    } else {
        assert!(said.contains("synced, renamed, the folder synced, and then answered"), "{said}");
    }
}
