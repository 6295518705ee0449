//! Whether the layer in `tests/faults` hooks every call that can fail, by what crate `ash` knows of Vulkan.
#![expect(clippy::unwrap_used, reason = "in a test, a failure")]

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
    process::Command,
};

use lantern_faults::{CALLS, SILENT_EXTENSIONS};
use serde_json::Value;

/// Crate `ash`'s sources, which know of each call what it returns and which extension it is of.
fn ash() -> BTreeMap<&'static str, String> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo)
        .args(["metadata", "--offline", "--format-version", "1"])
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
        .output()
        .unwrap();
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let package = metadata["packages"].as_array().unwrap().iter().find(|package| package["name"] == "ash").unwrap();
    let folder = Path::new(package["manifest_path"].as_str().unwrap()).with_file_name("src");
    let files = ["vk/features.rs", "vk/extensions.rs", "tables.rs", "extensions_generated.rs"];
    files.map(|file| (file, fs::read_to_string(folder.join(file)).unwrap())).into()
}

/// Names after `PFN_` in a text.
fn functions(text: &str) -> BTreeSet<String> {
    let name = |rest: &str| rest.chars().take_while(char::is_ascii_alphanumeric).collect::<String>();
    text.split("PFN_").skip(1).map(name).collect()
}

#[test]
fn the_layer_knows_every_call_that_returns_a_result() {
    let ash = ash();
    let mut fallible = BTreeSet::new();
    for file in ["vk/features.rs", "vk/extensions.rs"] {
        for rest in ash[file].split("pub type PFN_").skip(1) {
            let (head, _) = rest.split_once(';').unwrap();
            if head.ends_with("-> Result") {
                fallible.insert(head.chars().take_while(char::is_ascii_alphanumeric).collect::<String>());
            }
        }
    }
    assert!(fallible.len() > 200, "{}", fallible.len());
    let known: BTreeSet<String> = CALLS.iter().map(|call| call.name().to_owned()).collect();
    assert_eq!(known.len(), CALLS.len(), "each once");

    // The core's, but for those that the loader answers, and for the two that the layer makes by hand.
    let apart = [
        "vkCreateInstance",
        "vkCreateDevice",
        "vkEnumerateInstanceVersion",
        "vkEnumerateInstanceExtensionProperties",
        "vkEnumerateInstanceLayerProperties",
        "vkEnumerateDeviceLayerProperties",
    ];
    let core: BTreeSet<String> = functions(&ash["tables.rs"]).intersection(&fallible).cloned().collect();
    let missing: Vec<_> = core.difference(&known).filter(|call| !apart.contains(&call.as_str())).collect();
    assert!(missing.is_empty(), "{missing:?}");

    // Those of each extension in the table, and none of those that are said to have none.
    let of_extension = |extension: &str| -> BTreeSet<String> {
        let (vendor, name) = extension.strip_prefix("VK_").unwrap().split_once('_').unwrap();
        let vendor =
            ash["extensions_generated.rs"].split_once(&format!("\npub mod {} {{\n", vendor.to_lowercase())).unwrap().1;
        let module = vendor.split_once(&format!("    pub mod {name} {{\n")).unwrap().1;
        let module = module.split("\n    pub mod ").next().unwrap().split("\n}\n").next().unwrap();
        functions(module).intersection(&fallible).cloned().collect()
    };
    for extension in CALLS.iter().map(|call| call.extension).filter(|name| !name.is_empty()).collect::<BTreeSet<_>>() {
        let missing: Vec<_> = of_extension(extension).difference(&known).cloned().collect();
        assert!(missing.is_empty(), "{extension}: {missing:?}");
    }
    for extension in SILENT_EXTENSIONS {
        assert_eq!(of_extension(extension), BTreeSet::new(), "{extension}");
    }
}
