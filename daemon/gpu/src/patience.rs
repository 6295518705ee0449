//! How long work may take before a device counts as hung.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Of a GPU: a hundred times a slow frame, about as long as kernels wait before they reset one, and well within the time after
/// which systemd takes the whole daemon for stuck.
const GPU: Duration = Duration::from_secs(10);
/// Of a driver that runs on a processor, which others may keep busy, and which compiles shaders within the work.
const SOFTWARE: Duration = Duration::from_secs(60);
/// How long a device that comes to rest may take to, when it is let go of.
const AT_THE_END: Duration = Duration::from_secs(10);

/// The patience with a device.
#[derive(Debug)]
pub(crate) struct Patience {
    limit: Duration,
    /// Whether work took longer.
    is_over: AtomicBool,
}

impl Patience {
    /// With a device of a kind, as [`DeviceInfo`](crate::DeviceInfo) says it.
    pub(crate) fn with(kind: &str) -> Self {
        Self { limit: if kind == "cpu" { SOFTWARE } else { GPU }, is_over: AtomicBool::new(false) }
    }

    /// How long work may take.
    pub(crate) fn limit(&self) -> Duration {
        self.limit
    }

    /// Work has not ended within a time.
    pub(crate) fn waited(&self, waited: Duration) {
        self.is_over.fetch_or(waited >= self.limit, Ordering::AcqRel);
    }

    /// How long to wait for the rest of the work when the device is let go of: not at all where it hangs.
    pub(crate) fn at_the_end(&self) -> Duration {
        if self.is_over.load(Ordering::Acquire) { Duration::ZERO } else { AT_THE_END }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_hung_is_not_waited_for_again() {
        let patience = Patience::with("discrete");
        assert_eq!(patience.limit(), GPU);
        patience.waited(Duration::from_secs(1));
        assert_eq!(patience.at_the_end(), AT_THE_END);
        patience.waited(GPU);
        patience.waited(Duration::from_secs(1));
        assert_eq!(patience.at_the_end(), Duration::ZERO);
        assert_eq!(Patience::with("cpu").limit(), SOFTWARE);
    }
}
