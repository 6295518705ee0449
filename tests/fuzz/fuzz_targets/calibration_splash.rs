//! Splash's projects.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    lantern_fuzz::calibration::read("splash", "unit = \"m\"", data);
});
