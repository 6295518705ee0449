//! FreeD.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    lantern_fuzz::tracker::hear("protocol = \"freed\"\nbodies = { \"1\" = \"head\", \"2\" = \"hand\" }", data);
});
