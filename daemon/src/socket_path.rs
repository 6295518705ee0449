//! Where the control socket is (CONTRACT, Programs).

use std::path::{Path, PathBuf};

/// The environment's word on it.
const VARIABLE: &str = "LANTERN_SOCKET";

/// Nothing says where the socket is.
#[derive(Debug, thiserror::Error)]
#[error("nothing says where the control socket is\nhint: give --socket PATH, or set ${VARIABLE} or $XDG_RUNTIME_DIR")]
pub struct NoSocketPath;

/// The first that applies: the command line's, `$LANTERN_SOCKET`, the configuration's (which lanternctl does not have),
/// `/run/lantern/lanternd.sock` for root, `$XDG_RUNTIME_DIR/lantern/lanternd.sock`.
///
/// # Errors
/// [`NoSocketPath`], where none does.
pub fn resolve(command_line: Option<&Path>, config: Option<&Path>) -> Result<PathBuf, NoSocketPath> {
    let environment = |name| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    if let Some(path) =
        command_line.map(Path::to_owned).or_else(|| environment(VARIABLE)).or_else(|| config.map(Path::to_owned))
    {
        return Ok(path);
    }
    if rustix::process::geteuid().is_root() {
        return Ok(PathBuf::from("/run/lantern/lanternd.sock"));
    }
    environment("XDG_RUNTIME_DIR").map(|dir| dir.join("lantern/lanternd.sock")).ok_or(NoSocketPath)
}
