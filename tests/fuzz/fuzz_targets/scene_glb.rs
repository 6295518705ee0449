//! Binary glTF.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    lantern_fuzz::scene::load("glb", data);
});
