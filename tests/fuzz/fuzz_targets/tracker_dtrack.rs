//! DTRACK.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    lantern_fuzz::tracker::hear(
        "protocol = \"dtrack\"\nbodies = { \"1\" = \"head\", \"flystick 0\" = \"hand\" }",
        data,
    );
});
