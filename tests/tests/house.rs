//! The house against its drawing: what ARCHITECTURE.md and docs/protocol.md say of crates, modules, passes, dependencies and
//! codes is what there is.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use lantern_gpu::BindingKind;
use serde_json::Value;

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

fn read(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The words between backticks.
fn quoted(text: &str) -> Vec<&str> {
    text.split('`').skip(1).step_by(2).collect()
}

/// The cells of the rows of the table below a line that starts with `header`.
fn table(document: &str, header: &str) -> Vec<Vec<String>> {
    let from = document.find(header).unwrap_or_else(|| panic!("no table {header:?}"));
    let rows = document[from..].lines().skip(2).take_while(|line| line.starts_with('|'));
    let cells = |line: &str| line.trim_matches('|').split(" |").map(|cell| cell.trim().to_owned()).collect();
    rows.map(|line| cells(&format!("{line} "))).collect()
}

/// Every Rust file below a folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut files = vec![];
    for entry in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.is_dir() {
            files.extend(sources(&entry));
        } else if entry.extension().is_some_and(|e| e == "rs") {
            files.push(entry);
        }
    }
    files.sort();
    files
}

/// Packages of the workspace, as cargo sees them.
fn packages() -> Vec<Value> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    let output =
        command.args(["metadata", "--no-deps", "--offline", "--format-version", "1"]).current_dir(root()).output();
    let output = output.unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    metadata["packages"].as_array().unwrap().clone()
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

#[test]
fn crates_know_what_the_drawing_lets_them() {
    let ours = |name: &str| name == "lantern" || name.starts_with("lantern-");
    let mut real: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for package in packages() {
        let all = package["dependencies"].as_array().unwrap().iter();
        let known = all.filter(|d| d["kind"].is_null() && ours(text(&d["name"]))).map(|d| text(&d["name"]).to_owned());
        real.insert(text(&package["name"]).to_owned(), known.collect());
    }
    let all: BTreeSet<String> = real.keys().cloned().collect();
    let mut drawn: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for row in table(&read("ARCHITECTURE.md"), "| crate | place |") {
        let name = quoted(&row[0])[0].to_owned();
        let known = match row[3].as_str() {
            "nothing" => BTreeSet::new(),
            "all above" => drawn.keys().cloned().collect(),
            some => quoted(some).into_iter().map(|short| format!("lantern-{short}")).collect(),
        };
        assert!(root().join(quoted(&row[1])[0]).join("Cargo.toml").is_file(), "{row:?}");
        drawn.insert(name, known);
    }
    assert_eq!(drawn.keys().cloned().collect::<BTreeSet<_>>(), all);
    for (name, known) in &real {
        let more: Vec<_> = known.difference(&drawn[name]).collect();
        assert!(more.is_empty(), "{name} knows {more:?}, which the drawing does not let it");
        // Tests may come to know less than all; every other arrow is there.
        if name != "lantern-tests" {
            assert_eq!(known, &drawn[name], "{name}");
        }
    }
}

#[test]
fn dependencies_are_explained_and_used() {
    let mut declared: BTreeSet<String> = BTreeSet::new();
    for package in packages() {
        let folder = Path::new(text(&package["manifest_path"])).parent().unwrap();
        // A room's own files, without those of the rooms inside its folder.
        let parts = ["src", "tests", "examples", "build.rs"].map(|part| folder.join(part));
        let files = parts.iter().flat_map(|part| if part.is_dir() { sources(part) } else { vec![part.clone()] });
        let code: String = files.filter_map(|file| fs::read_to_string(file).ok()).collect();
        for dependency in package["dependencies"].as_array().unwrap() {
            let name = text(&dependency["name"]);
            let module = name.replace('-', "_");
            let used =
                [format!("{module}::"), format!("use {module};")].iter().any(|use_| code.contains(use_.as_str()));
            // The tests' own crate is a workshop: what lies ready there need not be in use.
            let package = text(&package["name"]);
            assert!(used || package == "lantern-tests", "{package} declares {name} and does not use it");
            if dependency["path"].is_null() {
                declared.insert(name.to_owned());
            }
        }
    }
    let explained: BTreeSet<String> = table(&read("ARCHITECTURE.md"), "| crate | used by |")
        .iter()
        .map(|row| quoted(&row[0])[0].to_owned())
        .collect();
    assert_eq!(declared, explained);
}

/// Top-level modules of a crate, and which others each names, tests left out.
fn modules(source: &Path) -> BTreeMap<String, BTreeSet<String>> {
    let module_of = |path: &Path| {
        let first = path.strip_prefix(source).unwrap().components().next().unwrap();
        first.as_os_str().to_string_lossy().trim_end_matches(".rs").to_owned()
    };
    let not_module = |name: &str| ["lib", "bin"].contains(&name) || name.ends_with("_tests");
    let files: Vec<_> = sources(source).into_iter().filter(|f| !f.to_string_lossy().ends_with("tests.rs")).collect();
    let mut known: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for file in files.iter().filter(|file| !not_module(&module_of(file))) {
        known.entry(module_of(file)).or_default();
    }

    // What lib.rs gives on is its module's.
    let library = fs::read_to_string(source.join("lib.rs")).unwrap();
    let mut home: BTreeMap<String, String> = known.keys().map(|name| (name.clone(), name.clone())).collect();
    for statement in library.split("use ").skip(1).filter_map(|rest| rest.split(';').next()) {
        let (module, names) = statement.split_once("::").unwrap_or((statement, ""));
        if known.contains_key(module) {
            let names = names.rsplit("::").next().unwrap_or(names);
            home.extend(words(names).map(|name| (name.to_owned(), module.to_owned())));
        }
    }
    for file in files.iter().filter(|file| !not_module(&module_of(file))) {
        let module = module_of(file);
        let whole = fs::read_to_string(file).unwrap();
        let code = whole.split("#[cfg(test)]").next().unwrap();
        let code: String = code.lines().map(|line| line.split("//").next().unwrap().to_owned() + "\n").collect();
        let mut named = named_after(&code, "crate::");
        if file.parent() == Some(source) {
            named.extend(named_after(&code, "super::"));
        }
        let homes = named.iter().filter_map(|name| home.get(*name)).filter(|other| **other != module).cloned();
        known.get_mut(&module).unwrap().extend(homes.collect::<Vec<_>>());
    }
    known
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|word| !word.is_empty())
}

/// First names of the paths that start with `prefix`, those in braces as well.
fn named_after<'a>(code: &'a str, prefix: &str) -> Vec<&'a str> {
    let mut named = vec![];
    for rest in code.split(prefix).skip(1) {
        let Some(group) = rest.strip_prefix('{') else {
            named.extend(words(rest).next());
            continue;
        };
        let (mut depth, mut start) = (1, 0);
        for (at, c) in group.char_indices() {
            depth += i32::from(c == '{') - i32::from(c == '}');
            if depth == 0 || (depth == 1 && c == ',') {
                named.extend(words(&group[start..at]).next());
                start = at;
            }
            if depth == 0 {
                break;
            }
        }
    }
    named
}

#[test]
fn modules_know_what_stands_below_them() {
    let document = read("ARCHITECTURE.md");
    let mut rooms = 0;
    for block in document.split("```text modules ").skip(1) {
        let (place, drawing) = block.split_once('\n').unwrap();
        let lines: Vec<Vec<BTreeSet<&str>>> = drawing
            .split("```")
            .next()
            .unwrap()
            .lines()
            .map(|line| line.split(" · ").map(|knot| knot.split(" + ").collect()).collect())
            .collect();
        let line_of = |name: &str| lines.iter().position(|line| line.iter().any(|knot| knot.contains(name)));
        let real = modules(&root().join(place).join("src"));
        let drawn: BTreeSet<_> = lines.iter().flatten().flatten().copied().collect();
        assert_eq!(real.keys().map(String::as_str).collect::<BTreeSet<_>>(), drawn, "modules of {place}");
        for (module, known) in &real {
            let knot = lines.iter().flatten().find(|knot| knot.contains(module.as_str())).unwrap();
            for other in known {
                let below = line_of(other) > line_of(module);
                assert!(
                    below || knot.contains(other.as_str()),
                    "{place}: {module} knows {other}, which is not below it"
                );
            }
        }
        rooms += 1;
    }
    assert_eq!(rooms, packages().len() - 1, "every room but the tests has a drawing");
}

#[test]
fn passes_read_and_write_what_the_table_says() {
    // What every pass may read, and what none is about.
    let common = ["Textures", "Frame", "Setup", "SampleState", "Projectors", "Lenses", "Counters", "Records"];
    let rows = table(&read("ARCHITECTURE.md"), "| shader | does |");
    let mut drawn: BTreeMap<String, [BTreeSet<String>; 2]> = BTreeMap::new();
    for row in &rows {
        let names = |cell: usize| quoted(&row[cell]).into_iter().map(str::to_owned).collect();
        drawn.insert(quoted(&row[0])[0].to_owned(), [names(2), names(3)]);
    }
    let mut real = BTreeMap::new();
    for shader in lantern_render::shaders::ALL {
        let own = |b: &&lantern_gpu::Binding| b.kind != BindingKind::UniformTexelBuffer && !common.contains(&b.name);
        let bindings: Vec<_> = shader.bindings.iter().filter(own).collect();
        let reads = bindings.iter().filter(|b| b.reads).map(|b| b.name.to_owned()).collect();
        let writes = bindings.iter().filter(|b| b.writes).map(|b| b.name.to_owned()).collect();
        real.insert(shader.name.to_owned(), [reads, writes]);
    }
    assert_eq!(drawn, real);
}

#[test]
fn every_code_of_a_refusal_is_documented() {
    let document = read("docs/protocol.md");
    let rows = table(&document, "| code | |");
    let documented: BTreeSet<&str> = rows.iter().flat_map(|row| quoted(&row[0])).collect();
    let mut used = BTreeSet::new();
    for folder in ["daemon/src", "daemon/scene/src", "proto/src"] {
        for file in sources(&root().join(folder)) {
            let code = fs::read_to_string(&file).unwrap();
            for made in ["ErrorBody::new(", "Fault::new("] {
                for rest in code.split(made).skip(1) {
                    let argument = rest.trim_start().strip_prefix('"').and_then(|rest| rest.split('"').next());
                    used.extend(argument.map(str::to_owned));
                }
            }
        }
    }
    let unknown: Vec<_> = used.iter().filter(|code| !documented.contains(code.as_str())).collect();
    assert!(unknown.is_empty(), "{unknown:?}");
    assert!(used.len() > 15, "{used:?}");
}
