//! Where the configuration in use comes from: its file, or, where that has come to be wrong, what it last was.
//!
//! A daemon that keeps state starts with what it showed before rather than not at all: a file that was edited and not checked, a
//! calibration that has gone, must not leave projectors dark until somebody comes. It says loudly that it does, and takes the
//! mended file at the next reload. A file that was never good has nothing to go back to, and is refused.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use lantern_proto::status::ConfigStatus;

use super::last_good::LastGood;
use super::setup::{self, Loaded, Problems};
use super::sources::Sources;
use super::systemd;

/// A configuration that was loaded, and from what.
pub type LoadedFrom = (Loaded, Sources);

/// Where the configuration in use comes from.
#[derive(Debug)]
pub struct Origin {
    path: PathBuf,
    last_good: Option<LastGood>,
    /// What is wrong with the file, as it was when it was last read; `None`: it is in use.
    problem: Mutex<Option<String>>,
}

impl Origin {
    /// Loads a configuration file, or what it last was where it is wrong.
    ///
    /// # Errors
    /// What is wrong with it, where nothing was kept of it.
    pub fn start(path: &Path) -> Result<(Self, LoadedFrom), Problems> {
        let (problem, (loaded, sources)) = match load(path) {
            Ok(good) => (None, good),
            Err(problems) => match go_back(path) {
                Some(good) => (Some(problems.to_string()), good),
                None => return Err(problems),
            },
        };
        if let Some(problem) = &problem {
            tracing::error!(
                "the configuration cannot be used, and what it last was is; mend it and reload it:\n{problem}"
            );
        }
        let last_good = loaded.config.daemon.state_dir.as_deref().map(LastGood::below);
        Ok((Self { path: path.to_owned(), last_good, problem: Mutex::new(problem) }, (loaded, sources)))
    }

    /// The configuration file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The configuration that was loaded is shown: where it comes from its file, it is kept for starts at which that is wrong.
    pub fn works(&self, sources: &Sources) {
        if self.problem().is_some() {
            return;
        }
        if let Some(Err(error)) = self.last_good.as_ref().map(|last_good| last_good.keep(sources)) {
            tracing::warn!("this configuration is not kept for a start at which it has come to be wrong: {error}");
        }
    }

    /// The file was read again, and is in use. `shows` says what that is.
    pub fn reloaded(&self, sources: &Sources, shows: &str) {
        *self.lock() = None;
        self.works(sources);
        systemd::status(&self.words(shows));
    }

    /// The file was read again, and is not used.
    pub fn refused(&self, problem: &str) {
        *self.lock() = Some(problem.to_owned());
        systemd::status(&self.words(""));
    }

    /// For the service manager, in one line.
    pub fn words(&self, shows: &str) -> String {
        match self.problem() {
            None => shows.to_owned(),
            Some(problem) => {
                let first = problem.lines().next().unwrap_or_default();
                format!("the configuration file is wrong, and an earlier one is in use: {first}")
            }
        }
    }

    /// For clients.
    pub fn status(&self) -> ConfigStatus {
        let problem = self.problem();
        ConfigStatus { path: self.path.display().to_string(), good: problem.is_none(), problem }
    }

    fn problem(&self) -> Option<String> {
        self.lock().clone()
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Option<String>> {
        // It is replaced whole.
        self.problem.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Loads a configuration file with all that it names.
///
/// # Errors
/// Every problem, with its place.
pub fn load(path: &Path) -> Result<LoadedFrom, Problems> {
    let mut sources = Sources::read(path).map_err(Problems)?;
    setup::load_from(&mut sources).map(|loaded| (loaded, sources))
}

/// What a configuration file last was, where that is kept and can still be shown.
fn go_back(path: &Path) -> Option<LoadedFrom> {
    for state_dir in state_dirs(path) {
        let mut kept = match LastGood::below(&state_dir).find(path) {
            Ok(Some(kept)) => kept,
            Ok(None) => continue,
            Err(error) => {
                tracing::warn!("there is no earlier configuration to go back to: {error}");
                continue;
            }
        };
        match setup::load_from(&mut kept) {
            Ok(loaded) => return Some((loaded, kept)),
            Err(problems) => tracing::error!("nor can the configuration be used that worked last:\n{problems}"),
        }
    }
    None
}

/// Where the state of a file may be that is wrong: where it says, as far as it can be read at all, or where the service manager does.
fn state_dirs(path: &Path) -> Vec<PathBuf> {
    let text = lantern_config::read_text(path).ok();
    let said = text.and_then(|text| lantern_config::state_dir_of(&text, lantern_config::folder_of(path)));
    // systemd's StateDirectory= may have several, of which the unit's first is ours.
    let managed = std::env::var("STATE_DIRECTORY").ok();
    let managed = managed.and_then(|all| all.split(':').next().filter(|first| !first.is_empty()).map(PathBuf::from));
    let mut all: Vec<_> = said.into_iter().chain(managed).collect();
    all.dedup();
    all
}
