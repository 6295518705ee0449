//! lanternctl.
fn main() {}
