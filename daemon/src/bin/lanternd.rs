//! lanternd.
fn main() {}
