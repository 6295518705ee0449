//! Opens files beneath a folder, whatever others do to the links and folders on the way meanwhile.

use std::fs::File;
use std::io;
use std::os::fd::OwnedFd;
use std::path::{Component, Path};

use rustix::fs::{CWD, Mode, OFlags, ResolveFlags, openat, openat2};
use rustix::io::Errno;

/// To read, without waiting for the other end of a pipe.
const READ: OFlags = OFlags::RDONLY.union(OFlags::NONBLOCK).union(OFlags::NOCTTY).union(OFlags::CLOEXEC);

/// As a place to go on from.
const FOLDER: OFlags = OFlags::PATH.union(OFlags::DIRECTORY).union(OFlags::CLOEXEC);

/// Opens what a path without links and `..` leads to, beneath a folder; `None` where the path has either by now.
///
/// # Errors
/// What the system says.
pub(crate) fn open(root: &Path, below: &Path) -> io::Result<Option<File>> {
    let root = openat(CWD, root, FOLDER, Mode::empty())?;
    let opened = match at_once(&root, below) {
        // Linux has it since 5.6, and some containers hide it.
        Err(Errno::NOSYS | Errno::PERM) => step_by_step(root, below),
        opened => opened,
    };
    match opened {
        Ok(file) => Ok(Some(file.into())),
        Err(Errno::LOOP | Errno::XDEV) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// The kernel follows no link, and does not leave the folder.
fn at_once(root: &OwnedFd, below: &Path) -> rustix::io::Result<OwnedFd> {
    let resolve = ResolveFlags::BENEATH | ResolveFlags::NO_SYMLINKS | ResolveFlags::NO_MAGICLINKS;
    // Nothing below the root is the root itself.
    let below = if below.as_os_str().is_empty() { Path::new(".") } else { below };
    openat2(root, below, READ, Mode::empty(), resolve)
}

/// The same by a call for each name: none of them is followed, so that nothing leads out.
fn step_by_step(root: OwnedFd, below: &Path) -> rustix::io::Result<OwnedFd> {
    let mut names = Vec::new();
    for component in below.components() {
        match component {
            Component::Normal(name) => names.push(name),
            Component::CurDir => {}
            Component::ParentDir | Component::RootDir | Component::Prefix(_) => return Err(Errno::XDEV),
        }
    }
    let Some((last, folders)) = names.split_last() else { return openat(root, ".", READ, Mode::empty()) };
    let mut folder = root;
    for name in folders {
        folder = openat(&folder, *name, FOLDER | OFlags::NOFOLLOW, Mode::empty()).map_err(of_link)?;
    }
    openat(&folder, *last, READ | OFlags::NOFOLLOW, Mode::empty()).map_err(of_link)
}

/// A link that is not followed is no folder.
fn of_link(error: Errno) -> Errno {
    if error == Errno::NOTDIR { Errno::LOOP } else { error }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn both_ways_open_the_same_and_refuse_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("root");
        std::fs::create_dir_all(root.join("a/b")).unwrap();
        std::fs::write(root.join("a/b/file"), "x").unwrap();
        std::fs::write(folder.path().join("outside"), "y").unwrap();
        symlink("file", root.join("a/b/link")).unwrap();
        symlink("b", root.join("a/folder")).unwrap();
        symlink("../../outside", root.join("a/out")).unwrap();
        let try_both = |below: &str| {
            let root = || openat(CWD, &root, FOLDER, Mode::empty()).unwrap();
            let ways = [at_once(&root(), Path::new(below)), step_by_step(root(), Path::new(below))];
            let codes = ways.map(|way| way.map(drop).map_err(|error| matches!(error, Errno::LOOP | Errno::XDEV)));
            assert_eq!(codes[0], codes[1], "{below}");
            codes[0]
        };
        for good in ["a/b/file", "a/./b/file", "a/b", ""] {
            assert_eq!(try_both(good), Ok(()), "{good}");
        }
        for bad in ["a/b/link", "a/folder/file", "a/out", "../outside", "/etc/passwd"] {
            assert_eq!(try_both(bad), Err(true), "{bad}");
        }
        assert_eq!(try_both("a/none"), Err(false));
    }
}
