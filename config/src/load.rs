//! From a file to a [`Config`], or to everything that is wrong with it.

use crate::places::Places;
use crate::problem::Problem;
use crate::read;
use crate::reader::{Source, Table};
use crate::types::{Config, Limits};
use std::path::{Path, PathBuf};
use toml::de::DeTable;

/// No configuration that a person wrote is longer; a wrong path may lead to a disk image.
const MAX_FILE_BYTES: u64 = 16 << 20;

/// What stands in a configuration file.
///
/// # Errors
/// A file that cannot be read is one problem.
pub fn read_text(path: &Path) -> Result<String, Vec<Problem>> {
    let file = path.display().to_string();
    let whole = |message: String, hint: &str| {
        vec![Problem { file: file.clone(), line: 0, column: 0, message, hint: hint.to_owned() }]
    };
    let readable = "name a configuration file that you may read; config/demo.toml is one to start from";
    let length = std::fs::metadata(path).map_err(|e| whole(format!("cannot be read: {e}"), readable))?.len();
    if length > MAX_FILE_BYTES {
        return Err(whole(format!("is {length} bytes long, which no configuration is"), readable));
    }
    let bytes = std::fs::read(path).map_err(|e| whole(format!("cannot be read: {e}"), readable))?;
    String::from_utf8(bytes).map_err(|e| whole(format!("is not UTF-8: {e}"), "save it as UTF-8"))
}

/// What relative paths of a configuration file start from.
pub fn folder_of(path: &Path) -> &Path {
    // A bare file name has an empty parent, which means the working folder.
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// `daemon.state_dir` of a text that may be wrong in every other way, and may be no TOML as a whole; `None` where it does not say.
pub fn state_dir_of(text: &str, base_dir: &Path) -> Option<PathBuf> {
    let (root, _) = DeTable::parse_recoverable(text);
    let written = root.get_ref().get("daemon")?.get_ref().get("state_dir")?.get_ref().as_str()?;
    (!written.is_empty()).then(|| base_dir.join(written))
}

impl Config {
    /// Reads a file.
    ///
    /// # Errors
    /// Everything that is wrong with it, in the file's order; a file that cannot be read is one problem.
    pub fn load(path: &Path) -> Result<Self, Vec<Problem>> {
        Self::parse(&read_text(path)?, &path.display().to_string(), folder_of(path))
    }

    /// Reads a text. `file_name` is what problems call it, `base_dir` what relative paths start from.
    ///
    /// # Errors
    /// Everything that is wrong with it, in the text's order. Where the text is no TOML, that alone is said: what it
    /// means cannot be judged then.
    pub fn parse(text: &str, file_name: &str, base_dir: &Path) -> Result<Self, Vec<Problem>> {
        let source = Source::new(file_name, text);
        let (root, errors) = DeTable::parse_recoverable(text);
        for error in &errors {
            let message = error.message().trim().replace('\n', ", ");
            let hint = "TOML wants one `key = value` a line, strings in double quotes, tables under [name] or [[name]]";
            source.problem(&error.span().unwrap_or(0..0), message, hint);
        }
        if !errors.is_empty() {
            return Err(source.finish().0);
        }

        let config = read_root(Table::root(&source, root.get_ref()), base_dir);
        let (problems, places) = source.finish();
        match config {
            Some(config) if problems.is_empty() => Ok(Config { places, ..config }),
            _ => Err(problems),
        }
    }
}

/// Reads every section, whether or not an earlier one was good.
fn read_root(root: Table<'_>, base_dir: &Path) -> Option<Config> {
    let section = |key| root.get(key).and_then(|value| value.table());
    let daemon = section("daemon").map(|table| read::daemon::daemon(table, base_dir));
    let device = section("device").map(read::daemon::device);
    let render = section("render").map(read::daemon::render);
    let metrics = section("metrics").map(read::metrics::metrics);
    let limits = section("limits").map(read::daemon::limits);
    let scene = section("scene").map(read::scene::scene);

    // Names are looked up in what the file has, good or not, so that one bad node does not make its body wrong as well.
    let nodes = root.names_at(&["scene", "node"]).into_iter().collect();
    let projector_names = root.names_at(&["projector"]).into_iter().collect();
    let bodies = read::tracking::bodies(root.tables("body"), &nodes, &projector_names);
    let body_names = root.names_at(&["body"]).into_iter().collect();
    let trackers = read::tracking::trackers(root.tables("tracker"), &body_names);

    let tables = root.tables("projector");
    if tables.is_empty() {
        root.problem("there is no projector", "add a [[projector]] with name, resolution_px and calibration");
    }
    let projectors = read::projector::projectors(tables, base_dir);
    root.finish();

    Some(Config {
        base_dir: base_dir.to_owned(),
        daemon: daemon.unwrap_or_default(),
        device: device.unwrap_or_default(),
        render: render.unwrap_or_default(),
        metrics: metrics.unwrap_or_default(),
        limits: limits.unwrap_or_else(Limits::default),
        scene: scene.unwrap_or_default(),
        bodies: bodies?,
        trackers: trackers?,
        projectors: projectors?,
        places: Places::default(),
    })
}
