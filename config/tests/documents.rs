//! The documents against the reader: every TOML block of theirs is read, every bad one is refused in the words that the
//! document says, and the reference lists exactly the keys that there are.
//!
//! A block whose fence says `toml` is good and one whose fence says `toml bad` is not; the `text` block after that one is
//! everything that is said of it. Fragments become a whole with [`PROJECTOR`], the one thing that no configuration is
//! without.
#![expect(clippy::unwrap_used, reason = "helpers of tests, where a failure is a failed test")]

use lantern_config::Config;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

const PROJECTOR: &str = "
[[projector]]
name = \"any\"
resolution_px = [8, 8]
[projector.calibration]
convention = \"opengl\"
projection = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1.01, -0.2], [0, 0, -1, 0]]
view = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -2], [0, 0, 0, 1]]
";

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// Every document of the repository that a person reads.
fn documents() -> Vec<PathBuf> {
    let folders = [root().to_owned(), root().join("docs"), root().join("config")];
    let files = folders.iter().flat_map(|folder| std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()));
    let mut documents: Vec<_> = files.filter(|path| path.extension().is_some_and(|e| e == "md")).collect();
    documents.sort();
    documents
}

/// A fenced block: what stands after the three ticks, and its text.
struct Block {
    fence: String,
    text: String,
}

fn blocks(document: &str) -> Vec<Block> {
    let mut blocks: Vec<Block> = vec![];
    let mut open = false;
    for line in document.lines() {
        match line.strip_prefix("```") {
            Some(_) if open => open = false,
            Some(fence) => {
                blocks.push(Block { fence: fence.to_owned(), text: String::new() });
                open = true;
            }
            None if open => blocks.last_mut().unwrap().text.extend([line, "\n"]),
            None => {}
        }
    }
    blocks
}

/// What is said of a fragment; empty where nothing is wrong with it.
fn said(fragment: &str) -> String {
    let rest = if fragment.contains("[[projector]]") { "" } else { PROJECTOR };
    match Config::parse(&format!("{fragment}{rest}"), "lab.toml", root()) {
        Ok(_) => String::new(),
        Err(problems) => problems.iter().map(|problem| format!("{problem}\n")).collect(),
    }
}

#[test]
fn every_good_block_is_read_and_every_bad_one_refused_in_the_words_that_follow() {
    let (mut good, mut bad) = (0, 0);
    for path in documents() {
        let blocks = blocks(&std::fs::read_to_string(&path).unwrap());
        for (index, block) in blocks.iter().enumerate() {
            let place = format!("{}:\n{}", path.display(), block.text);
            match block.fence.as_str() {
                "toml" => {
                    assert_eq!(said(&block.text), "", "{place}");
                    good += 1;
                }
                "toml bad" => {
                    let words = blocks.get(index + 1).filter(|next| next.fence == "text");
                    let words = words.unwrap_or_else(|| panic!("no `text` block follows in {place}"));
                    assert_eq!(said(&block.text), words.text, "{place}");
                    bad += 1;
                }
                _ => {}
            }
        }
    }
    assert!(good >= 9 && bad >= 5, "{good} good and {bad} bad blocks");
}

/// The keys that a table has, by its own word: what it says to a key that it does not know.
fn keys_of(fragment: &str) -> BTreeSet<String> {
    let said = said(fragment);
    let known = said.lines().filter(|line| line.contains("unknown key `zzz`"));
    let [line] = known.collect::<Vec<_>>()[..] else { panic!("{said}") };
    let list = line.rsplit_once(" knows ").unwrap().1;
    list.split(", ").map(str::to_owned).collect()
}

#[test]
fn the_reference_lists_every_key_and_no_other() {
    let text = std::fs::read_to_string(root().join("docs/configuration.md")).unwrap();
    let mut listed: BTreeMap<&str, BTreeSet<String>> = BTreeMap::new();
    let mut section = None;
    for line in text.lines() {
        if let Some(heading) = line.strip_prefix("## ") {
            section = heading.strip_prefix('`').map(|heading| heading.trim_matches(['`', '[', ']']));
        }
        // A row of keys starts with one; a row of words that a key may have, with a quote.
        let key = line.strip_prefix("| `").and_then(|row| row.split_once('`')).map(|(key, _)| key);
        let key = key.filter(|key| !key.starts_with('"'));
        if let (Some(section), Some(key)) = (section, key) {
            listed.entry(section).or_default().insert(key.to_owned());
        }
    }
    let projector = PROJECTOR.trim();
    let sections = [
        ("daemon", "[daemon]\nzzz = 1\n".to_owned()),
        ("device", "[device]\nzzz = 1\n".to_owned()),
        ("render", "[render]\nzzz = 1\n".to_owned()),
        ("scene", "[scene]\nzzz = 1\n".to_owned()),
        ("scene.node", "[[scene.node]]\nzzz = 1\n".to_owned()),
        ("scene.material", "[[scene.material]]\nzzz = 1\n".to_owned()),
        ("scene.light", "[[scene.light]]\nzzz = 1\n".to_owned()),
        ("body", "[[body]]\nzzz = 1\n".to_owned()),
        ("tracker", "[[tracker]]\nzzz = 1\n".to_owned()),
        ("projector", projector.replacen("name", "zzz = 1\nname", 1)),
        ("projector.output", projector.replacen("name", "output = { kind = \"headless\", zzz = 1 }\nname", 1)),
        ("projector.calibration", format!("{projector}\nzzz = 1\n")),
        ("metrics", "[metrics]\nzzz = 1\n".to_owned()),
        ("limits", "[limits]\nzzz = 1\n".to_owned()),
    ];
    for (section, fragment) in &sections {
        assert_eq!(listed.remove(section), Some(keys_of(fragment)), "[{section}]");
    }
    assert!(listed.is_empty(), "sections that there are not: {listed:?}");
    // And no section is left out: those that the file as a whole knows, and those inside of them.
    let whole: BTreeSet<_> =
        sections.iter().map(|(section, _)| section.split('.').next().unwrap().to_owned()).collect();
    assert_eq!(whole, keys_of("zzz = 1\n"));
}

#[test]
fn every_link_of_the_documents_leads_somewhere() {
    let mut links = 0;
    for path in documents() {
        let text = std::fs::read_to_string(&path).unwrap();
        for link in text.split("](").skip(1).map(|rest| rest.split(')').next().unwrap()) {
            let file = link.split('#').next().unwrap();
            if link.contains("://") || file.is_empty() {
                continue;
            }
            let target = path.parent().unwrap().join(file);
            assert!(target.exists(), "{}: {link}", path.display());
            links += 1;
        }
    }
    assert!(links >= 10);
}
