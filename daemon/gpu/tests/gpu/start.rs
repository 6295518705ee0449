//! Starting on a machine that lacks something. The loader looks at the environment of its process, so these run the
//! test program again in another one.

use std::process::Command;

use lantern_gpu::*;

/// What an instance says, in an environment where the loader finds no driver.
#[test]
fn without_a_driver_the_package_to_install_is_named() {
    let output = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "start::child", "--ignored", "--nocapture"])
        .env("VK_DRIVER_FILES", "/nonexistent/driver.json")
        .env("VK_ICD_FILENAMES", "/nonexistent/driver.json")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("no vulkan driver") && said.contains("hint: install mesa-vulkan-drivers"), "{said}");
}

#[test]
#[ignore = "run by the test above, in another environment"]
fn child() {
    match Instance::new(Validation::Off) {
        Ok(instance) => println!("a driver: {instance:?}"),
        Err(error) => println!("{error}"),
    }
}
