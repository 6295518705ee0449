//! A panic ends the process, so that systemd starts it again on the last revision (DESIGN section 6).
//!
//! Without this a panic would end its own thread alone, and the daemon would go on with a part of it missing.

/// Logs every panic from now on, on any thread, and aborts.
pub fn abort() {
    let print = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        // The hook that was there knows where and why, and prints a backtrace where one is asked for.
        print(panic);
        tracing::error!("panicked, which is a fault of lanternd: it ends here, to be started again");
        std::process::abort();
    }));
}

#[cfg(test)]
mod tests {
    use std::os::unix::process::ExitStatusExt;
    use std::process::Command;

    /// Makes this test's own process, started by itself, panic.
    const CHILD: &str = "LANTERN_TEST_PANICS";

    #[test]
    fn a_panic_on_any_thread_ends_the_process() {
        if std::env::var_os(CHILD).is_some() {
            super::abort();
            // Nobody hears of a thread's panic but those who join it.
            let _ = std::thread::spawn(|| panic!("the reason")).join();
            return;
        }
        let name = "service::panics::tests::a_panic_on_any_thread_ends_the_process";
        let mut command = Command::new(std::env::current_exe().unwrap());
        let output = command.args(["--exact", name, "--nocapture"]).env(CHILD, "1").output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        const SIGABRT: i32 = 6;
        assert_eq!(output.status.signal(), Some(SIGABRT), "{stderr}");
        assert!(stderr.contains("the reason") && stderr.contains("panics.rs"), "{stderr}");
    }
}
