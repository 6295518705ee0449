//! The pipeline cache on disk.
//!
//! Drivers read their own data back with little suspicion, so the file carries a checksum: what is not whole, or from
//! another device or driver, never reaches them.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use ash::vk;

use crate::error::GpuError;
use crate::handle::DeviceHandle;

/// The first bytes of the file; the last is the version of its form.
const MAGIC: &[u8; 8] = b"LNTNPIP\x01";
/// Magic, device and driver (16 bytes), length, checksum.
const HEADER_BYTES: usize = 8 + 16 + 8 + 8;
/// A longer file is none of ours.
const MAX_BYTES: u64 = 256 << 20;

/// Compiled pipelines, read when the device is opened, and written when it is closed or its user says so.
pub(crate) struct PipelineCache {
    raw: vk::PipelineCache,
    device: Arc<DeviceHandle>,
    key: [u8; 16],
    path: Option<PathBuf>,
    /// What the file held at first.
    loaded_bytes: usize,
    /// What it holds.
    saved: Mutex<Vec<u8>>,
}

impl PipelineCache {
    /// Opens the cache in `folder`, or one that is not kept. A file that does not fit is ignored.
    pub(crate) fn open(device: &Arc<DeviceHandle>, folder: Option<&Path>) -> Result<PipelineCache, GpuError> {
        // SAFETY: the physical device is one that the instance listed.
        let core = unsafe { device.instance.raw().get_physical_device_properties(device.physical) };
        let key = core.pipeline_cache_uuid;
        let hex: String = key.iter().map(|byte| format!("{byte:02x}")).collect();
        let file = format!("pipelines-{:04x}-{:04x}-{hex}.bin", core.vendor_id, core.device_id);
        let path = folder.map(|folder| folder.join(file));
        let saved = path.as_deref().and_then(|path| read(path, &key)).unwrap_or_default();

        let create = |data: &[u8]| {
            let info = vk::PipelineCacheCreateInfo::default().initial_data(data);
            // SAFETY: the data is empty, or what this very driver gave for this device, whole by its checksum.
            unsafe { device.raw.create_pipeline_cache(&info, None) }
        };
        let raw = create(&saved)
            .or_else(|_| create(&[]))
            .map_err(|result| GpuError::vulkan("creating the pipeline cache", result))?;
        let loaded_bytes = saved.len();
        Ok(PipelineCache { raw, device: Arc::clone(device), key, path, loaded_bytes, saved: Mutex::new(saved) })
    }

    pub(crate) fn raw(&self) -> vk::PipelineCache {
        self.raw
    }

    /// Bytes that were read from disk.
    pub(crate) fn loaded_bytes(&self) -> usize {
        self.loaded_bytes
    }

    /// Writes what has been compiled, if that is more than the file has. What cannot be written is compiled again another time.
    pub(crate) fn save(&self) {
        let Some(path) = &self.path else { return };
        // SAFETY: the cache lives.
        let Ok(data) = (unsafe { self.device.raw.get_pipeline_cache_data(self.raw) }) else { return };
        // Bytes are never half replaced.
        let mut saved = self.saved.lock().unwrap_or_else(PoisonError::into_inner);
        if data == *saved {
            return;
        }
        match write(path, &self.key, &data) {
            Ok(()) => *saved = data,
            Err(error) => tracing::warn!(path = %path.display(), %error, "the pipeline cache could not be written"),
        }
    }
}

impl Drop for PipelineCache {
    fn drop(&mut self) {
        self.save();
        // SAFETY: makers of pipelines borrow the device that owns the cache, so none is at work.
        unsafe { self.device.raw.destroy_pipeline_cache(self.raw, None) };
    }
}

/// The driver's data in a file, if the file is whole and for this device and driver.
fn read(path: &Path, key: &[u8; 16]) -> Option<Vec<u8>> {
    if std::fs::metadata(path).ok()?.len() > MAX_BYTES {
        return None;
    }
    let data = decode(&std::fs::read(path).ok()?, key);
    if data.is_none() {
        tracing::info!(path = %path.display(), "the pipeline cache does not fit and is written anew");
    }
    data
}

/// Replaces a file as a whole, or not at all.
fn write(path: &Path, key: &[u8; 16], data: &[u8]) -> std::io::Result<()> {
    let folder = path.parent().ok_or_else(|| std::io::Error::other("a path without a folder"))?;
    std::fs::create_dir_all(folder)?;
    let fresh = path.with_extension(format!("new-{}", std::process::id()));
    let written = std::fs::File::create(&fresh).and_then(|mut file| {
        file.write_all(&encode(data, key))?;
        file.sync_all()
    });
    let replaced = written.and_then(|()| std::fs::rename(&fresh, path));
    if replaced.is_err() {
        let _ = std::fs::remove_file(&fresh);
    }
    replaced
}

fn encode(data: &[u8], key: &[u8; 16]) -> Vec<u8> {
    let mut file = Vec::with_capacity(HEADER_BYTES + data.len());
    file.extend_from_slice(MAGIC);
    file.extend_from_slice(key);
    file.extend_from_slice(&(data.len() as u64).to_le_bytes());
    file.extend_from_slice(&checksum(data).to_le_bytes());
    file.extend_from_slice(data);
    file
}

fn decode(file: &[u8], key: &[u8; 16]) -> Option<Vec<u8>> {
    let (header, data) = file.split_at_checked(HEADER_BYTES)?;
    let expected = encode(data, key);
    (header == &expected[..HEADER_BYTES]).then(|| data.to_vec())
}

/// FNV-1a, 64 bits: against torn and rotten files, not against malice.
fn checksum(data: &[u8]) -> u64 {
    data.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_comes_back_whole_or_not_at_all() {
        let key = *b"0123456789abcdef";
        let file = encode(b"some pipelines", &key);
        assert_eq!(decode(&file, &key).unwrap(), b"some pipelines");

        for length in 0..file.len() {
            assert_eq!(decode(&file[..length], &key), None, "cut to {length} bytes");
        }
        for at in 0..file.len() {
            let mut rotten = file.clone();
            rotten[at] ^= 0x10;
            assert_eq!(decode(&rotten, &key), None, "byte {at} flipped");
        }
        assert_eq!(decode(&file, b"another device!!"), None);
    }

    #[test]
    fn the_checksum_is_fnv_1a() {
        assert_eq!(checksum(b"foobar"), 0x8594_4171_f739_67e8);
    }
}
