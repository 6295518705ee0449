//! What systemd hears of the daemon (`sd_notify(3)`), and the socket that it may hand over (`sd_listen_fds(3)`). Without systemd
//! nobody listens, and all of this does nothing.

use std::os::unix::net::UnixListener;
use std::time::{Duration, Instant};

use listenfd::ListenFd;
use sd_notify::NotifyState;

/// Tells systemd that sockets and outputs are up.
pub fn ready(status: &str) {
    notify(&[NotifyState::Ready, NotifyState::Status(status)]);
}

/// Tells systemd how it goes, in one line.
pub fn status(status: &str) {
    notify(&[NotifyState::Status(status)]);
}

/// Tells systemd that the end has begun.
pub fn stopping() {
    notify(&[NotifyState::Stopping]);
}

fn notify(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::warn!(%error, "systemd cannot be told");
    }
}

/// The control socket of `lanternd.socket`, where systemd started the daemon for it; to be asked before threads start.
///
/// # Errors
/// Where what was handed over is no Unix stream socket that listens.
pub fn control_socket() -> std::io::Result<Option<UnixListener>> {
    ListenFd::from_env().take_unix_listener(0)
}

/// Fed by the frame thread alone: while that is stuck systemd hears nothing, and after `WatchdogSec` starts the daemon again.
#[derive(Debug)]
pub struct Watchdog(Option<Fed>);

#[derive(Debug)]
struct Fed {
    period: Duration,
    due: Instant,
}

impl Watchdog {
    /// As systemd asks for it (`$WATCHDOG_USEC`), twice as often.
    pub fn from_environment() -> Self {
        Self::of(sd_notify::watchdog_enabled(), Instant::now())
    }

    fn of(limit: Option<Duration>, now: Instant) -> Self {
        Self(limit.map(|limit| Fed { period: limit / 2, due: now }))
    }

    /// When the frame thread has to wake for it.
    pub fn due(&self) -> Option<Instant> {
        self.0.as_ref().map(|fed| fed.due)
    }

    /// To be called once a turn: tells systemd where it is time to.
    pub fn feed(&mut self, now: Instant) {
        if self.is_due(now) {
            notify(&[NotifyState::Watchdog]);
        }
    }

    /// Whether it is time, and if so, when it is next.
    fn is_due(&mut self, now: Instant) -> bool {
        let Some(fed) = self.0.as_mut().filter(|fed| fed.due <= now) else { return false };
        fed.due = now + fed.period;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_watchdog_is_fed_twice_as_often_as_asked() {
        let start = Instant::now();
        let at = |s| start + Duration::from_secs(s);
        let mut watchdog = Watchdog::of(Some(Duration::from_secs(10)), start);
        let fed: Vec<u64> = (0..13).filter(|&s| watchdog.is_due(at(s))).collect();
        assert_eq!((fed.as_slice(), watchdog.due()), ([0, 5, 10].as_slice(), Some(at(15))));
        let mut none = Watchdog::of(None, start);
        assert_eq!((none.due(), none.is_due(at(100))), (None, false));
    }
}
