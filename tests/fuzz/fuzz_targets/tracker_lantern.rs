//! The protocol `lantern`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    lantern_fuzz::tracker::hear("protocol = \"lantern\"\nbodies = { \"1\" = \"head\", \"2\" = \"hand\" }", data);
});
