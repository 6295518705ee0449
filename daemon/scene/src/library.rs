//! Files and builtins behind URIs, each loaded once while anything shows it.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Weak};

use crate::asset::Asset;
use crate::builtin::{SCHEME, SHAPES, shape};
use crate::edit::{Fault, nearest};
use crate::environment;
use crate::file::{self, Access, Stamp};
use crate::gltf;
use crate::limits::Limits;
use crate::pack::GpuEnvironment;
use crate::structures::Structures;
use crate::studio::studio;

/// By canonical path or builtin URI.
type Known<T> = HashMap<String, (Option<Stamp>, Weak<T>)>;

/// What was loaded, by canonical path or builtin URI. It keeps nothing alive: what no scene shows is loaded again.
#[derive(Clone, Debug, Default)]
pub(crate) struct Library {
    assets: Known<Asset>,
    environments: Known<GpuEnvironment>,
    /// The canonical paths that the configuration or a stored state has named: `scene.get` tells them, so a client may
    /// give them back, wherever they lie.
    named: HashSet<String>,
    pub(crate) structures: Arc<Structures>,
}

/// Something loaded, and the URI that finds it again.
pub(crate) type Found<T> = (Arc<T>, String);

impl Library {
    /// Forgets which paths were named, and gives them for [`Library::name_again`].
    pub(crate) fn take_named(&mut self) -> HashSet<String> {
        std::mem::take(&mut self.named)
    }

    /// Takes paths back that [`Library::take_named`] gave.
    pub(crate) fn name_again(&mut self, named: HashSet<String>) {
        self.named = named;
    }

    /// Takes over what another one has loaded and something keeps alive.
    pub(crate) fn learn_from(&mut self, other: &Self) {
        learn(&mut self.assets, &other.assets);
        learn(&mut self.environments, &other.environments);
    }

    /// Finds the file of a URI, and whose word it is taken for: a client that gives a named path speaks for who named it.
    fn locate<'a>(&mut self, uri: &str, access: Access<'a>) -> Result<(PathBuf, Access<'a>), Fault> {
        let Access::Roots(roots) = access else {
            let path = file::locate(uri, access)?;
            let kept = kept_uri(uri, &path, access)?;
            if path.to_str() == Some(&kept) {
                self.named.insert(kept);
            }
            return Ok((path, access));
        };
        // Still the file of that name, and not what a link there leads to by now.
        let stored = Access::Stored(roots);
        let named = self.named.contains(uri).then(|| file::locate(uri, stored)).and_then(Result::ok);
        match named.filter(|path| path.to_str() == Some(uri)) {
            Some(path) => Ok((path, stored)),
            None => Ok((file::locate(uri, access)?, access)),
        }
    }

    /// The asset of a URI.
    ///
    /// # Errors
    /// `bad-uri`, `outside-asset-roots`, `bad-gltf` or `too-large`, at field `uri`.
    pub(crate) fn asset(&mut self, uri: &str, access: Access<'_>, limits: &Limits) -> Result<Found<Asset>, Fault> {
        if let Some(name) = uri.strip_prefix(SCHEME) {
            return remember(&mut self.assets, uri.to_owned(), None, || {
                shape(name, &self.structures).ok_or_else(|| unknown_builtin(uri, &SHAPES))
            })
            .map(|asset| (asset, uri.to_owned()));
        }
        let (path, access) = self.locate(uri, access)?;
        let asset = remember(&mut self.assets, key(&path)?, Stamp::of(&path), || {
            gltf::load(&path, access, limits, &self.structures)
                .map_err(|error| Fault::new(error.code(), "uri", error.to_string()))
        })?;
        Ok((asset, kept_uri(uri, &path, access)?))
    }

    /// The panorama of a URI.
    ///
    /// # Errors
    /// `bad-uri`, `outside-asset-roots`, `bad-value` (not decodable) or `too-large`, at field `uri`.
    pub(crate) fn environment(
        &mut self,
        uri: &str,
        access: Access<'_>,
        limits: &Limits,
    ) -> Result<Found<GpuEnvironment>, Fault> {
        if let Some(name) = uri.strip_prefix(SCHEME) {
            return remember(&mut self.environments, uri.to_owned(), None, || match name {
                "studio" => Ok(studio()),
                _ => Err(unknown_builtin(uri, &["studio"])),
            })
            .map(|environment| (environment, uri.to_owned()));
        }
        let (path, access) = self.locate(uri, access)?;
        let environment = remember(&mut self.environments, key(&path)?, Stamp::of(&path), || {
            let bytes = file::read(&path, access, limits.max_file_bytes).map_err(|error| {
                let code = if matches!(error, file::ReadError::TooLarge { .. }) { "too-large" } else { "bad-uri" };
                Fault::new(code, "uri", format!("{}: {error}; hint: check the file and the limits", path.display()))
            })?;
            environment::decode(&bytes, &path, limits).map_err(|error| {
                let large = matches!(error, environment::EnvironmentError::TooLarge { .. });
                Fault::new(if large { "too-large" } else { "bad-value" }, "uri", error.to_string())
            })
        })?;
        Ok((environment, kept_uri(uri, &path, access)?))
    }
}

fn learn<T>(known: &mut Known<T>, other: &Known<T>) {
    let alive = other.iter().filter(|(_, (_, weak))| weak.strong_count() > 0);
    known.extend(alive.map(|(key, entry)| (key.clone(), entry.clone())));
}

/// What is remembered under a key if it is still shown and its file has not changed, else what `load` gives.
fn remember<T>(
    known: &mut Known<T>,
    key: String,
    stamp: Option<Stamp>,
    load: impl FnOnce() -> Result<T, Fault>,
) -> Result<Arc<T>, Fault> {
    if let Some((of, weak)) = known.get(&key)
        && *of == stamp
        && let Some(shared) = weak.upgrade()
    {
        return Ok(shared);
    }
    known.retain(|_, (_, weak)| weak.strong_count() > 0);
    let loaded = Arc::new(load()?);
    known.insert(key, (stamp, Arc::downgrade(&loaded)));
    Ok(loaded)
}

fn key(path: &Path) -> Result<String, Fault> {
    let utf8 = path.to_str().map(str::to_owned);
    utf8.ok_or_else(|| Fault::new("bad-uri", "uri", format!("{} is not UTF-8; hint: rename it", path.display())))
}

/// A client's URI stays as it was given; the operator's becomes the canonical path, which holds wherever it is read again.
/// A stored one is either already.
fn kept_uri(uri: &str, path: &Path, access: Access<'_>) -> Result<String, Fault> {
    match access {
        Access::Roots(_) | Access::Stored(_) => Ok(uri.to_owned()),
        Access::Anywhere(_) => key(path),
    }
}

fn unknown_builtin(uri: &str, known: &[&str]) -> Fault {
    let known: Vec<String> = known.iter().map(|name| format!("{SCHEME}{name}")).collect();
    let known = nearest(uri, known.iter().map(String::as_str));
    Fault::new("bad-uri", "uri", format!("{uri:?} is no builtin; hint: {known}"))
}
