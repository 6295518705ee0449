//! The control socket, over the real editor.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    lantern_fuzz::socket::say(data);
});
