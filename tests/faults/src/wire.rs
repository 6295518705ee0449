//! How a test speaks to the layer: lines over a socket, each answered by one.
//!
//! - `arm NAME NTH RESULT once|on`: forgets all counts, and fails the NTH call of that name from now on;
//! - `clear`: forgets all counts, and fails nothing;
//! - `report`: does nothing.
//!
//! The answer is `fired=N strangers=A,B counts=NAME:N,…`, as it was *before* the command; or `refused: …`.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::sync::Once;

use crate::dispatch::plan;
use crate::plan::Fault;

/// Names the socket's path.
pub const SOCKET_VARIABLE: &str = "LANTERN_FAULTS_SOCKET";
/// Holds what to arm from the first call on: `NAME NTH RESULT once|on`.
pub const ARM_VARIABLE: &str = "LANTERN_FAULTS_ARM";

/// Arms what the environment says and begins to listen, once a process.
pub(crate) fn start() {
    static START: Once = Once::new();
    START.call_once(|| {
        if let Ok(text) = std::env::var(ARM_VARIABLE) {
            match text.parse() {
                Ok(fault) => plan().begin(Some(fault)),
                Err(error) => eprintln!("{ARM_VARIABLE}: {error}"),
            }
        }
        let Some(path) = std::env::var_os(SOCKET_VARIABLE) else { return };
        match UnixListener::bind(&path) {
            Ok(listener) => drop(std::thread::spawn(move || listener.incoming().flatten().for_each(serve))),
            Err(error) => eprintln!("{}: {error}", path.display()),
        }
    });
}

/// One test after the other; a connection that breaks is over.
fn serve(stream: UnixStream) {
    let Ok(read) = stream.try_clone() else { return };
    let mut write = stream;
    for line in BufReader::new(read).lines().map_while(Result::ok) {
        if writeln!(write, "{}", answer(&line)).is_err() {
            return;
        }
    }
}

fn answer(line: &str) -> String {
    let mut plan = plan();
    let report = plan.report();
    match line.split_once(' ').unwrap_or((line, "")) {
        ("report", "") => report,
        ("clear", "") => {
            plan.begin(None);
            report
        }
        ("arm", fault) => match fault.parse::<Fault>() {
            Ok(fault) => {
                plan.begin(Some(fault));
                report
            }
            Err(error) => format!("refused: {error}"),
        },
        _ => format!("refused: {line:?}"),
    }
}
