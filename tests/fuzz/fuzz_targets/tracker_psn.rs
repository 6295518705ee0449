//! PosiStageNet.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    lantern_fuzz::tracker::hear("protocol = \"psn\"\nbodies = { \"1\" = \"head\", \"name\" = \"hand\" }", data);
});
