//! Where the control socket is (CONTRACT, "Programs"), for the daemon and for `lanternctl` alike.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// The variable that names the socket.
pub const ENVIRONMENT: &str = "LANTERN_SOCKET";

/// The file's place below a runtime folder.
const BELOW_RUNTIME_DIR: &str = "lantern/lanternd.sock";

/// No rule applies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no path for the control socket: $XDG_RUNTIME_DIR is not set; hint: name one by --socket or ${ENVIRONMENT}")]
pub struct NoSocketPath;

/// The first of: `--socket`, `$LANTERN_SOCKET`, the configuration's `daemon.socket`, `/run/lantern/lanternd.sock` for
/// root, `$XDG_RUNTIME_DIR/lantern/lanternd.sock`. A variable that is empty counts as not set.
///
/// # Errors
/// [`NoSocketPath`] for a user without `$XDG_RUNTIME_DIR`.
pub fn resolve(argument: Option<&Path>, config: Option<&Path>) -> Result<PathBuf, NoSocketPath> {
    let is_root = rustix::process::geteuid().is_root();
    first(argument, config, is_root, |name| std::env::var_os(name))
}

fn first(
    argument: Option<&Path>,
    config: Option<&Path>,
    is_root: bool,
    variable: impl Fn(&str) -> Option<OsString>,
) -> Result<PathBuf, NoSocketPath> {
    let variable = |name| variable(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    if let Some(path) = argument {
        return Ok(path.to_owned());
    }
    if let Some(path) = variable(ENVIRONMENT) {
        return Ok(path);
    }
    if let Some(path) = config {
        return Ok(path.to_owned());
    }
    if is_root {
        return Ok(Path::new("/run").join(BELOW_RUNTIME_DIR));
    }
    variable("XDG_RUNTIME_DIR").map(|folder| folder.join(BELOW_RUNTIME_DIR)).ok_or(NoSocketPath)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_that_applies() {
        let both = |name: &str| match name {
            ENVIRONMENT => Some("/env.sock".into()),
            "XDG_RUNTIME_DIR" => Some("/run/user/1000".into()),
            _ => None,
        };
        let runtime_alone = |name: &str| both(name).filter(|_| name != ENVIRONMENT);
        let (argument, config) = (Some(Path::new("/arg.sock")), Some(Path::new("/config.sock")));
        let path = |path: &str| Ok(PathBuf::from(path));
        assert_eq!(first(argument, config, true, both), path("/arg.sock"));
        assert_eq!(first(None, config, true, both), path("/env.sock"));
        assert_eq!(first(None, config, true, runtime_alone), path("/config.sock"));
        assert_eq!(first(None, None, true, runtime_alone), path("/run/lantern/lanternd.sock"));
        assert_eq!(first(None, None, false, runtime_alone), path("/run/user/1000/lantern/lanternd.sock"));
        assert_eq!(first(None, None, false, |_| None), Err(NoSocketPath));
        // Set but empty is as good as not set.
        assert_eq!(first(None, config, false, |_| Some("".into())), path("/config.sock"));
        assert_eq!(first(None, None, false, |_| Some("".into())), Err(NoSocketPath));
    }
}
