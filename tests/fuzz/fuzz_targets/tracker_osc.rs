//! Open Sound Control, by preset or by description: the first byte says which.
#![no_main]

const KEYS: [&str; 4] = [
    "protocol = \"osc\"\npreset = \"vmc\"\nbodies = { \"1\" = \"head\", \"name\" = \"hand\" }",
    "protocol = \"osc\"\npreset = \"vrchat\"\nbodies = { \"1\" = \"head\", \"head\" = \"hand\" }",
    "protocol = \"osc\"\npreset = \"optitrack\"\nbodies = { \"1\" = \"head\", \"2\" = \"hand\" }",
    "protocol = \"osc\"\naddress = \"/t/{id}\"\narguments = [\"time\", \"x\", \"y\", \"z\", \"rx\", \"ry\", \"rz\"]\nbodies = { \"1\" = \"head\" }",
];

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    lantern_fuzz::tracker::hear_by(&KEYS, data);
});
