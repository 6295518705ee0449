//! The scene across restarts: what was acknowledged as durable survives `kill -9` and power loss.
//!
//! - [`disk`]: files that are replaced whole;
//! - [`document`]: what tells a kept text from a damaged one;
//! - [`mod@format`]: the scene's form, and those of earlier releases;
//! - `aside`: where what could not be used goes.
//!
//! What is found at a start is never fatal, and never silently overwritten: a state that cannot be used is set aside, with its reason in
//! its name and in the log, and where even that fails nothing new is kept in its place.

mod aside;
pub mod disk;
pub mod document;
pub mod format;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use lantern_config::Scene;
use lantern_proto::Edit;

pub use disk::DiskError;
use disk::Unread;
use format::FormatError;
pub use format::State;

const FILE: &str = "scene.json";

/// No scene's edits are longer; positions of vertices take about sixty bytes each.
const MAX_BYTES: u64 = 256 << 20;

/// Why a scene could not be kept.
#[derive(Debug, thiserror::Error)]
pub enum StateError {
    /// The file system refused.
    #[error(transparent)]
    Disk(#[from] DiskError),
    /// There is too much of it.
    #[error("the scene cannot be written: {0}\nhint: shapes that change all the time need not be durable")]
    Unwritable(String),
}

/// What a start finds.
#[derive(Debug)]
pub enum Found {
    /// Nothing was kept.
    Nothing,
    /// A scene, of the configuration's.
    Scene(State),
    /// Something that cannot be used.
    Unusable {
        /// Why.
        reason: String,
        /// Its revision, where that can be told: numbers go on from there.
        revision: Option<u64>,
        /// Where it is now.
        aside: Result<PathBuf, DiskError>,
    },
}

/// The folder where the state lives.
#[derive(Debug)]
pub struct Store {
    folder: PathBuf,
    /// Something lies where the state should that could be neither used nor set aside.
    in_the_way: AtomicBool,
}

impl Store {
    /// Makes the folder if it is missing.
    ///
    /// # Errors
    /// [`DiskError`].
    pub fn open(folder: &Path) -> Result<Self, DiskError> {
        disk::make_folder(folder)?;
        Ok(Self { folder: folder.to_owned(), in_the_way: AtomicBool::new(false) })
    }

    /// Writes a revision of a configuration's scene. When it returns, the revision is on the disk.
    ///
    /// # Errors
    /// [`StateError`]; what was kept before is still there, but as [`disk::replace`] says.
    pub fn save(&self, scene: &Scene, revision: u64, edits: Vec<Edit>) -> Result<(), StateError> {
        let state = State { scene_fingerprint: scene.fingerprint(), revision, edits };
        let file = format::write(&state, MAX_BYTES).map_err(StateError::Unwritable)?;
        // A person may have taken it away meanwhile.
        if self.in_the_way.load(Ordering::Relaxed) && self.folder.join(FILE).symlink_metadata().is_ok() {
            self.set_aside("unusable")?;
        }
        Ok(disk::replace(&self.folder, FILE, &file)?)
    }

    /// Reads what is kept. What cannot be used is set aside: it is damaged, of a later release, or of another configuration's scene.
    pub fn load(&self, scene: &Scene) -> Found {
        disk::tidy(&self.folder, FILE);
        let file = match disk::read(&self.folder.join(FILE), MAX_BYTES) {
            Ok(file) => file,
            Err(Unread::Missing) => return Found::Nothing,
            Err(error) => return self.unusable("unreadable", error.to_string(), None),
        };
        match format::read(&file, scene) {
            Ok(state) if state.scene_fingerprint == scene.fingerprint() => Found::Scene(state),
            Ok(state) => {
                let reason = "the configuration's [scene] has changed since it was kept";
                self.unusable("of-another-scene", reason.into(), Some(state.revision))
            }
            Err(error @ FormatError::Later(_)) => self.unusable("of-a-later-release", error.to_string(), None),
            Err(error) => self.unusable("damaged", error.to_string(), None),
        }
    }

    /// Of a state that was read well and still cannot be shown.
    pub fn unshowable(&self, state: &State, reason: String) -> Found {
        self.unusable("cannot-be-shown", reason, Some(state.revision))
    }

    fn unusable(&self, word: &str, reason: String, revision: Option<u64>) -> Found {
        let aside = self.set_aside(word);
        self.in_the_way.store(aside.is_err(), Ordering::Relaxed);
        Found::Unusable { reason, revision, aside }
    }

    fn set_aside(&self, word: &str) -> Result<PathBuf, DiskError> {
        let to = aside::set_aside(&self.folder.join(FILE), &self.folder.join("aside"), word)?;
        self.in_the_way.store(false, Ordering::Relaxed);
        Ok(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lantern_config::SceneLight;
    use lantern_proto::Remove;
    use std::fs;

    fn edits() -> Vec<Edit> {
        vec![Edit::Remove(Remove { node: "car".into() })]
    }

    /// Two scenes, which only have to differ.
    fn scenes() -> [Scene; 2] {
        let light = SceneLight {
            name: "lamp".into(),
            kind: lantern_config::LightKind::Point,
            position_m: None,
            direction: None,
            color: None,
            intensity: None,
            inner_cone_rad: None,
            outer_cone_rad: None,
        };
        [Scene::default(), Scene { lights: vec![light], ..Scene::default() }]
    }

    #[test]
    fn what_was_saved_is_loaded_for_the_same_scene_only() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let [a, b] = scenes();
        assert!(matches!(store.load(&a), Found::Nothing));
        store.save(&a, 7, edits()).unwrap();
        let Found::Scene(state) = store.load(&a) else { panic!("it has gone") };
        assert_eq!((state.revision, state.edits), (7, edits()));
        let Found::Unusable { revision, aside, .. } = store.load(&b) else { panic!("it is shown for another scene") };
        assert_eq!((revision, aside.unwrap()), (Some(7), folder.path().join("aside/0001-scene-of-another-scene.json")));
        assert!(matches!(store.load(&a), Found::Nothing));
    }

    #[test]
    fn whatever_lies_there_is_set_aside_and_the_next_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let [scene, _] = scenes();
        let path = folder.path().join(FILE);
        let cases: [(&str, &dyn Fn()); 6] = [
            ("damaged", &|| fs::write(&path, "{").unwrap()),
            ("damaged", &|| fs::write(&path, [0xff; 5000]).unwrap()),
            ("of-a-later-release", &|| fs::write(&path, document::seal("lantern scene", 99, b"?")).unwrap()),
            ("unreadable", &|| fs::create_dir(&path).unwrap()),
            ("unreadable", &|| std::os::unix::fs::symlink("/dev/zero", &path).unwrap()),
            ("unreadable", &|| fs::File::create(&path).and_then(|file| file.set_len(MAX_BYTES + 1)).unwrap()),
        ];
        for (number, (word, make)) in cases.iter().enumerate() {
            make();
            let Found::Unusable { reason, aside, .. } = store.load(&scene) else { panic!("{word} was used") };
            let name = aside.unwrap().file_name().unwrap().to_string_lossy().into_owned();
            assert_eq!(name, format!("{:04}-scene-{word}.json", number + 1), "{reason}");
            store.save(&scene, 3, edits()).unwrap();
            assert!(matches!(store.load(&scene), Found::Scene(State { revision: 3, .. })));
            fs::remove_file(&path).unwrap();
        }
    }

    #[test]
    fn what_cannot_be_set_aside_is_not_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let [scene, _] = scenes();
        fs::write(folder.path().join(FILE), "precious").unwrap();
        // Not even root makes a folder where a file is.
        fs::write(folder.path().join("aside"), "").unwrap();
        let Found::Unusable { aside, .. } = store.load(&scene) else { panic!("it was used") };
        assert!(aside.is_err());
        assert!(matches!(store.save(&scene, 1, edits()), Err(StateError::Disk(_))));
        assert_eq!(fs::read(folder.path().join(FILE)).unwrap(), b"precious");

        // Once it can be, it is, and the new one is kept.
        fs::remove_file(folder.path().join("aside")).unwrap();
        store.save(&scene, 2, edits()).unwrap();
        assert_eq!(fs::read(folder.path().join("aside/0001-scene-unusable.json")).unwrap(), b"precious");
        assert!(matches!(store.load(&scene), Found::Scene(State { revision: 2, .. })));
    }

    #[test]
    fn what_a_killed_daemon_left_half_written_is_no_state_and_goes() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let [scene, _] = scenes();
        store.save(&scene, 5, edits()).unwrap();
        fs::write(folder.path().join("scene.json.new"), "{\"format\":").unwrap();
        assert!(matches!(store.load(&scene), Found::Scene(State { revision: 5, .. })));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
