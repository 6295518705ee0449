//! `lanternctl`: the operator's hand on a running `lanternd`.

use std::process::ExitCode;

fn main() -> ExitCode {
    lantern::ctl::main()
}
