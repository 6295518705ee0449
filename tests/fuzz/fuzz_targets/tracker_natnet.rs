//! NatNet, by version or by asking for it: the first byte says which.
#![no_main]

const KEYS: [&str; 4] = [
    "protocol = \"natnet\"\nversion = \"3.1\"\nbodies = { \"1\" = \"head\", \"2\" = \"hand\" }",
    "protocol = \"natnet\"\nversion = \"4.0\"\nbodies = { \"1\" = \"head\", \"2\" = \"hand\" }",
    "protocol = \"natnet\"\nversion = \"4.1\"\nbodies = { \"1\" = \"head\", \"2\" = \"hand\" }",
    "protocol = \"natnet\"\nserver = \"127.0.0.1\"\nbodies = { \"1\" = \"head\", \"2\" = \"hand\" }",
];

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    lantern_fuzz::tracker::hear_by(&KEYS, data);
});
