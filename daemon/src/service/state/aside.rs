//! What could not be used is put aside under a name that says why, for a person to look at; the newest few are kept.

use std::fs;
use std::path::{Path, PathBuf};

use super::disk::{DiskError, failed, make_folder};

/// How many are kept.
const KEPT: usize = 8;

/// Moves what a path names into `folder`, as `0003-STEM-REASON.EXTENSION`, and gives its new path. The oldest there go.
///
/// # Errors
/// [`DiskError`]; then it is where it was.
pub(super) fn set_aside(path: &Path, folder: &Path, reason: &str) -> Result<PathBuf, DiskError> {
    make_folder(folder)?;
    let before = numbered(folder);
    let number = before.last().map_or(1, |(last, _)| last + 1);
    let part = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
    let name = format!("{number:04}-{}-{reason}.{}", part(path.file_stem()), part(path.extension()));
    let to = folder.join(name);
    fs::rename(path, &to).map_err(failed("set aside", path))?;
    for (_, old) in before.iter().rev().skip(KEPT - 1) {
        // A folder was put there by a person, and is theirs to remove.
        if let Err(error) = fs::remove_file(old)
            && error.kind() != std::io::ErrorKind::IsADirectory
        {
            tracing::warn!(path = %old.display(), %error, "what was set aside long ago cannot be removed");
        }
    }
    Ok(to)
}

/// What is there, in the order of its numbers.
fn numbered(folder: &Path) -> Vec<(u64, PathBuf)> {
    let Ok(entries) = fs::read_dir(folder) else { return vec![] };
    let number = |path: &Path| path.file_name()?.to_str()?.split_once('-')?.0.parse().ok();
    let mut found: Vec<_> =
        entries.flatten().filter_map(|entry| Some((number(&entry.path())?, entry.path()))).collect();
    found.sort();
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_are_kept_and_nothing_is_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let (path, aside) = (folder.path().join("scene.json"), folder.path().join("aside"));
        for round in 1..=20 {
            if round == 14 {
                fs::create_dir(&path).unwrap();
                fs::write(path.join("mine"), "").unwrap();
            } else {
                fs::write(&path, round.to_string()).unwrap();
            }
            let to = set_aside(&path, &aside, "damaged").unwrap();
            assert_eq!(to, aside.join(format!("{round:04}-scene-damaged.json")));
            assert!(!path.exists() && numbered(&aside).len() == round.min(KEPT), "{round}");
        }
        assert_eq!(fs::read_to_string(aside.join("0020-scene-damaged.json")).unwrap(), "20");
        assert!(aside.join("0014-scene-damaged.json/mine").exists());
        assert!(set_aside(&path, &aside, "damaged").is_err(), "there is nothing to set aside");
    }
}
