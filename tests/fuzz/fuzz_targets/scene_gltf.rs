//! glTF, its buffers and images inside.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    lantern_fuzz::scene::load("gltf", data);
});
