//! The pipeline cache on disk, and what a device tells of itself.

use std::sync::Arc;

use lantern_gpu::*;

use crate::common::*;

/// Opens a device with a cache in `folder`, compiles, and closes it; returns how much was read.
fn session(instance: &Arc<Instance>, folder: &std::path::Path) -> usize {
    let device = Device::open(instance, None, 1, Some(folder)).unwrap();
    let _pipeline = ComputePipeline::new(&device, step(), &[]).unwrap();
    device.cache_loaded_bytes()
}

#[test]
fn compiled_pipelines_are_kept_on_disk_and_a_bad_file_is_ignored() {
    let instance = Instance::new(Validation::On).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join("not yet there");
    let files = || std::fs::read_dir(&inside).unwrap().map(|entry| entry.unwrap().path()).collect::<Vec<_>>();

    assert_eq!(session(&instance, &inside), 0);
    let [file] = &files()[..] else { panic!("one file, no leftovers: {:?}", files()) };
    let written = std::fs::read(file).unwrap();
    let loaded = session(&instance, &inside);
    assert!(loaded > 0 && loaded < written.len());

    // Rotten, cut and foreign files count as none, and are replaced.
    let mut rotten = written.clone();
    *rotten.last_mut().unwrap() ^= 1;
    for bad in [&rotten[..], &written[..written.len() / 2], b"", b"something else altogether"] {
        std::fs::write(file, bad).unwrap();
        assert_eq!(session(&instance, &inside), 0);
        assert_eq!(files().len(), 1);
        assert!(session(&instance, &inside) > 0);
    }
    assert_eq!(instance.validation_messages(), Vec::<String>::new());
}

#[test]
fn devices_tell_who_they_are() {
    let instance = Instance::new(Validation::On).unwrap();
    let devices = instance.devices().unwrap();
    for (index, info) in devices.iter().enumerate() {
        assert_eq!(info.index, index);
        assert!(!info.name.is_empty());
        assert!(["cpu", "integrated", "discrete", "virtual", "other"].contains(&info.kind));
        assert!(!info.queue_families.is_empty() && !info.memory_heaps.is_empty());
        if info.lacks.is_empty() {
            assert_eq!(info.uuid.len(), 36);
            assert!(info.abilities["timeline_semaphore"] && info.abilities["dynamic_rendering"]);
            assert!(info.abilities.contains_key("ray_query") && info.abilities.contains_key("dma_buf"));
            assert!(info.max_storage_buffer_bytes >= 1 << 27 && info.subgroup_size > 0);
        }
    }

    // Each is found again by its UUID, and what is not there is refused.
    let usable = devices.iter().find(|info| info.lacks.is_empty()).expect("no device here can serve");
    let device = Device::open(&instance, Some(&usable.uuid), 1, None).unwrap();
    assert_eq!(device.info().name, usable.name);
    let error = Device::open(&instance, Some("no such device"), 1, None).unwrap_err();
    assert!(matches!(error, GpuError::NoSuchDevice { .. }), "{error}");
    drop(device);
    assert_eq!(instance.validation_messages(), Vec::<String>::new());
}
