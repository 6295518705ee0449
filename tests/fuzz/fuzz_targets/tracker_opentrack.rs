//! opentrack.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    lantern_fuzz::tracker::hear("protocol = \"opentrack\"\nbodies = { \"1\" = \"head\" }", data);
});
