//! Structures that were built before, kept on disk by what they were built over.
//!
//! A file is named after a hash of the boxes and of the builder's version. It carries a checksum, so that one which is torn,
//! rotten or foreign is found out; and what comes out of it is checked like a stranger's word ([`soundness`]): it may cost a
//! build, never a hit and never memory.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::SystemTime;

use obvhs::aabb::Aabb;
use obvhs::cwbvh::node::CwBvhNode;
use sha2::{Digest, Sha256};

use crate::bvh::Bvh;
use crate::soundness;

/// The first bytes of a file; the last is the version of its form and of the builder: raise it with every change of what
/// [`Bvh::build`] makes of the same boxes. Read in the machine's own order of bytes, as the rest of the file is.
const MAGIC: u64 = u64::from_be_bytes(*b"LNTNBVH\x01");
/// Magic, key, checksum, numbers of nodes and of primitives.
const HEADER_BYTES: usize = 8 + 32 + 32 + 8 + 8;
/// The files' names.
const PREFIX: &str = "structure-";
/// Fewer boxes are built over in less time than a file is opened in, and are not kept.
const FEWEST: usize = 64;
/// What a small file takes up at least.
const BLOCK_BYTES: u64 = 4096;
/// All files together, unless told otherwise. What was not used for longest goes first.
const LIMIT_BYTES: u64 = 1 << 30;

/// How many structures were made since the start, and how.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Built.
    pub built: u64,
    /// Read from disk.
    pub cached: u64,
}

/// Where structures come from: from disk if they were built before, else from the builder. Without a folder all are built.
#[derive(Debug, Default)]
pub struct Structures {
    folder: Option<PathBuf>,
    limit_bytes: u64,
    built: AtomicU64,
    cached: AtomicU64,
    kept: Mutex<Kept>,
}

/// What is known of the folder.
#[derive(Clone, Copy, Debug, Default)]
enum Kept {
    /// Nothing yet.
    #[default]
    Unknown,
    /// How much its files take up.
    Bytes(u64),
    /// That it cannot be written to.
    Closed,
}

impl Structures {
    /// Keeps structures in a folder, which is made when the first one is.
    pub fn in_folder(folder: PathBuf) -> Self {
        Self { folder: Some(folder), limit_bytes: LIMIT_BYTES, ..Self::default() }
    }

    /// What was done so far.
    pub fn counts(&self) -> Counts {
        Counts { built: self.built.load(Ordering::Relaxed), cached: self.cached.load(Ordering::Relaxed) }
    }

    /// The structure over boxes: what [`Bvh::build`] makes of them.
    pub(crate) fn over(&self, boxes: &[Aabb]) -> Bvh {
        let Some(folder) = self.folder.as_deref().filter(|_| boxes.len() >= FEWEST) else {
            if boxes.len() >= FEWEST {
                self.built.fetch_add(1, Ordering::Relaxed);
            }
            return Bvh::build(boxes);
        };
        let key = key(boxes);
        let path = folder.join(format!("{PREFIX}{}.bin", hex(&key)));
        match read(&path, &key, boxes) {
            Ok(bvh) => {
                self.cached.fetch_add(1, Ordering::Relaxed);
                return bvh;
            }
            Err(Unread::Absent) => {}
            Err(why) => {
                tracing::info!(path = %path.display(), %why, "a kept structure does not serve and is built anew")
            }
        }
        let bvh = Bvh::build(boxes);
        self.built.fetch_add(1, Ordering::Relaxed);
        self.keep(folder, &path, &encode(&key, &bvh));
        bvh
    }

    /// Writes a file, and makes room where that takes too much.
    fn keep(&self, folder: &Path, path: &Path, file: &[u8]) {
        // A second thread that keeps something at the same time waits; the lock is held by nobody who panics.
        let mut kept = self.kept.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let held = match *kept {
            Kept::Closed => return,
            Kept::Bytes(bytes) => bytes,
            Kept::Unknown => room_taken(&list(folder)),
        };
        if let Err(error) = write(folder, path, file) {
            tracing::warn!(path = %path.display(), %error, "structures cannot be kept, and are built anew at the next start");
            *kept = Kept::Closed;
            return;
        }
        let mut bytes = held + on_disk(file.len() as u64);
        if bytes > self.limit_bytes {
            bytes = make_room(folder, path, self.limit_bytes);
        }
        *kept = Kept::Bytes(bytes);
    }
}

/// Hashes what a structure depends on.
fn key(boxes: &[Aabb]) -> [u8; 32] {
    let mut hash = Sha256::new();
    hash.update(MAGIC.to_be_bytes());
    // Many at a time: the hash takes long over small pieces.
    for some in boxes.chunks(1024) {
        let corners: Vec<[[f32; 3]; 2]> = some.iter().map(|b| [b.min.to_array(), b.max.to_array()]).collect();
        hash.update(bytemuck::cast_slice::<_, u8>(&corners));
    }
    hash.finalize().into()
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn encode(key: &[u8; 32], bvh: &Bvh) -> Vec<u8> {
    let (nodes, order): (&[u8], &[u8]) = (bytemuck::cast_slice(&bvh.nodes), bytemuck::cast_slice(&bvh.order));
    let mut file = Vec::with_capacity(HEADER_BYTES + nodes.len() + order.len());
    file.extend_from_slice(&MAGIC.to_ne_bytes());
    file.extend_from_slice(key);
    file.extend_from_slice(&checksum(nodes, order));
    file.extend_from_slice(&(bvh.nodes.len() as u64).to_ne_bytes());
    file.extend_from_slice(&(bvh.order.len() as u64).to_ne_bytes());
    file.extend_from_slice(nodes);
    file.extend_from_slice(order);
    file
}

fn checksum(nodes: &[u8], order: &[u8]) -> [u8; 32] {
    Sha256::new().chain_update(nodes).chain_update(order).finalize().into()
}

/// Why a file does not serve.
#[derive(Debug, thiserror::Error)]
enum Unread {
    #[error("there is none")]
    Absent,
    #[error(transparent)]
    Io(io::Error),
    #[error("it has another form, or is of another machine or version")]
    Foreign,
    #[error("it is not whole")]
    Torn,
    #[error(transparent)]
    Flawed(#[from] soundness::Flaw),
}

/// The structure in a file, if that is whole, of this version, and sound over these boxes.
fn read(path: &Path, key: &[u8; 32], boxes: &[Aabb]) -> Result<Bvh, Unread> {
    let absent = |error: io::Error| match error.kind() {
        io::ErrorKind::NotFound => Unread::Absent,
        _ => Unread::Io(error),
    };
    // There is no tree with more nodes than primitives, so a longer file is none of ours, and its size asks for no memory.
    let most = HEADER_BYTES + boxes.len() * (size_of::<CwBvhNode>() + size_of::<u32>());
    if fs::metadata(path).map_err(absent)?.len() > most as u64 {
        return Err(Unread::Foreign);
    }
    let file = fs::read(path).map_err(absent)?;
    let bvh = decode(&file, key, boxes.len())?;
    soundness::check(&bvh, boxes)?;
    // What is used stays: the oldest time goes first. A folder that cannot be written to is read all the same.
    if let Err(error) = fs::File::options().append(true).open(path).and_then(|f| f.set_modified(SystemTime::now())) {
        tracing::debug!(path = %path.display(), %error, "the use of a kept structure cannot be noted");
    }
    Ok(bvh)
}

fn decode(file: &[u8], key: &[u8; 32], primitives: usize) -> Result<Bvh, Unread> {
    let (header, data) = file.split_at_checked(HEADER_BYTES).ok_or(Unread::Torn)?;
    let word = |at: usize| header[at..at + 8].iter().rev().fold(0u64, |word, &byte| word << 8 | u64::from(byte));
    let word = |at: usize| if cfg!(target_endian = "big") { word(at).swap_bytes() } else { word(at) };
    if word(0) != MAGIC || header[8..40] != key[..] {
        return Err(Unread::Foreign);
    }
    let node_bytes = usize::try_from(word(72)).ok().and_then(|count| count.checked_mul(size_of::<CwBvhNode>()));
    let (nodes, order) = node_bytes.and_then(|bytes| data.split_at_checked(bytes)).ok_or(Unread::Torn)?;
    if word(80) != primitives as u64 || order.len() != primitives * size_of::<u32>() {
        return Err(Unread::Torn);
    }
    if header[40..72] != checksum(nodes, order) {
        return Err(Unread::Torn);
    }
    Ok(Bvh { nodes: bytemuck::pod_collect_to_vec(nodes), order: bytemuck::pod_collect_to_vec(order) })
}

/// Replaces a file as a whole, or not at all. It is not synced: what a loss of power leaves of it is found to be torn.
fn write(folder: &Path, path: &Path, file: &[u8]) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    let fresh = path.with_extension(format!("new-{}", std::process::id()));
    let replaced = fs::write(&fresh, file).and_then(|()| fs::rename(&fresh, path));
    if replaced.is_err() {
        // It may never have been there.
        let _ = fs::remove_file(&fresh);
    }
    replaced
}

/// Our files in a folder: path, bytes, and when they were used last. What cannot be asked is left out.
fn list(folder: &Path) -> Vec<(PathBuf, u64, SystemTime)> {
    let Ok(entries) = fs::read_dir(folder) else { return vec![] };
    let ours = entries.flatten().filter(|entry| entry.file_name().to_string_lossy().starts_with(PREFIX));
    ours.filter_map(|entry| {
        let metadata = entry.metadata().ok()?;
        Some((entry.path(), metadata.len(), metadata.modified().ok()?))
    })
    .collect()
}

fn on_disk(bytes: u64) -> u64 {
    bytes.next_multiple_of(BLOCK_BYTES)
}

fn room_taken(files: &[(PathBuf, u64, SystemTime)]) -> u64 {
    files.iter().map(|(_, bytes, _)| on_disk(*bytes)).sum()
}

/// Removes what was not used for longest until three quarters of the limit are left, but never `newest`; gives what is left.
fn make_room(folder: &Path, newest: &Path, limit_bytes: u64) -> u64 {
    let mut files = list(folder);
    files.sort_by_key(|(_, _, used)| *used);
    let mut left = room_taken(&files);
    for (path, bytes, _) in files.iter().filter(|(path, ..)| path != newest) {
        if left <= limit_bytes / 4 * 3 {
            break;
        }
        // Another daemon may have removed it.
        if let Err(error) = fs::remove_file(path) {
            tracing::debug!(path = %path.display(), %error, "a kept structure cannot be removed");
        }
        left -= on_disk(*bytes);
    }
    left
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3A;

    fn some_boxes(count: u32) -> Vec<Aabb> {
        let at = |i: u32| Vec3A::new((i % 10) as f32, (i / 10) as f32 * 0.7, (i % 7) as f32);
        (0..count).map(|i| Aabb::new(at(i), at(i) + 0.4)).collect()
    }

    fn counts(built: u64, cached: u64) -> Counts {
        Counts { built, cached }
    }

    #[test]
    fn what_was_built_before_is_read_and_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("deep/structures");
        let boxes = some_boxes(200);
        let first = Structures::in_folder(place.clone());
        let built = first.over(&boxes);
        assert_eq!((built == Bvh::build(&boxes), first.counts()), (true, counts(1, 0)));
        let second = Structures::in_folder(place.clone());
        assert!(second.over(&boxes) == built && second.over(&boxes) == built);
        assert_eq!(second.counts(), counts(0, 2));
        // Others are not taken for these, and what costs nothing to build is not kept.
        second.over(&some_boxes(201));
        second.over(&some_boxes(3));
        assert_eq!((second.counts(), fs::read_dir(&place).unwrap().count()), (counts(1, 2), 2));
        let without = Structures::default();
        assert!(without.over(&boxes) == built && without.counts() == counts(1, 0));
    }

    #[test]
    fn what_is_not_whole_or_not_ours_is_built_anew() {
        let folder = tempfile::tempdir().unwrap();
        let boxes = some_boxes(100);
        let built = Structures::in_folder(folder.path().to_owned()).over(&boxes);
        let path = fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        let good = fs::read(&path).unwrap();
        let mut bad: Vec<Vec<u8>> =
            [0, 7, HEADER_BYTES, good.len() / 2, good.len() - 1].map(|n| good[..n].to_vec()).into();
        bad.extend((0..good.len()).step_by(37).map(|at| {
            let mut rotten = good.clone();
            rotten[at] ^= 4;
            rotten
        }));
        bad.push([&good[..], &[0; 4]].concat());
        bad.push(vec![0xff; 1 << 20]);
        // Whole by its checksum, and still no tree over these boxes: another's, and one that leads beyond its end.
        let key = key(&boxes);
        let others: Vec<Aabb> = boxes.iter().map(|b| Aabb::new(b.min + 1.0, b.max + 1.0)).collect();
        bad.push(encode(&key, &Bvh::build(&others)));
        let mut endless = built.clone();
        endless.nodes[0].child_base_idx = 0;
        bad.push(encode(&key, &endless));
        for file in bad {
            fs::write(&path, &file).unwrap();
            let structures = Structures::in_folder(folder.path().to_owned());
            assert!(structures.over(&boxes) == built && structures.counts() == counts(1, 0));
            assert_eq!(fs::read(&path).unwrap(), good, "it is not replaced");
        }
    }

    #[test]
    fn the_folder_stays_within_its_limit_and_loses_what_was_not_used_for_longest() {
        let folder = tempfile::tempdir().unwrap();
        let structures =
            || Structures { limit_bytes: 8 * BLOCK_BYTES, ..Structures::in_folder(folder.path().to_owned()) };
        let mut time = SystemTime::now() - std::time::Duration::from_secs(1000);
        let used_first = some_boxes(FEWEST as u32);
        for count in 0..20 {
            structures().over(&some_boxes(FEWEST as u32 + count));
            for (path, ..) in list(folder.path()) {
                let file = fs::File::options().append(true).open(path).unwrap();
                if file.metadata().unwrap().modified().unwrap() > time {
                    file.set_modified(time).unwrap();
                }
            }
            time += std::time::Duration::from_secs(1);
            // The first is used all the time, and so it stays.
            assert_eq!(structures().counts(), counts(0, 0));
            let again = structures();
            again.over(&used_first);
            assert_eq!(again.counts(), counts(0, 1), "round {count}");
            assert!(room_taken(&list(folder.path())) <= 8 * BLOCK_BYTES);
        }
        assert!(list(folder.path()).len() >= 4);
    }

    #[test]
    fn a_folder_that_cannot_be_written_to_costs_builds_alone() {
        let folder = tempfile::tempdir().unwrap();
        let plain = folder.path().join("plain");
        fs::write(&plain, "").unwrap();
        let structures = Structures::in_folder(plain.join("structures"));
        let boxes = some_boxes(100);
        assert!(structures.over(&boxes) == Bvh::build(&boxes) && structures.over(&boxes) == Bvh::build(&boxes));
        assert_eq!(structures.counts(), counts(2, 0));
    }
}
