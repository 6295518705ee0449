//! An opened device: its queues and its pipeline cache.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use crate::cache::PipelineCache;
use crate::error::GpuError;
use crate::families;
use crate::handle::{DeviceHandle, Limits};
use crate::info::DeviceInfo;
use crate::instance::Instance;
use crate::queue::Queue;
use crate::ray_query::RayTracing;
use crate::release::Release;
use crate::select;
use crate::ticket::Ticket;

/// What was submitted to a device since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Calls of `vkQueueSubmit2`, each with the command buffers of all projectors that share a queue.
    pub submissions: u64,
    /// Compute dispatches in them, direct and indirect, and draws.
    pub dispatches: u64,
    /// Barriers in them.
    pub barriers: u64,
}

/// An opened device.
pub struct Device {
    pub(crate) handle: Arc<DeviceHandle>,
    /// Those of projectors, and then that of uploads, where they have one of their own.
    pub(crate) queues: Vec<Queue>,
    pub(crate) projector_queues: usize,
    pub(crate) release: Arc<Release>,
    pub(crate) cache: PipelineCache,
    pub(crate) work: Mutex<Work>,
}

impl std::fmt::Debug for Device {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Device").field("name", &self.info().name).field("queues", &self.queues).finish_non_exhaustive()
    }
}

impl Device {
    /// Opens a device whose rays walk the scene's own structures; see [`Device::open_for`].
    ///
    /// # Errors
    /// Those of [`Device::open_for`].
    pub fn open(
        instance: &Arc<Instance>,
        select: Option<&str>,
        compute_queues: u32,
        cache_dir: Option<&Path>,
    ) -> Result<Arc<Device>, GpuError> {
        Self::open_for(instance, select, compute_queues, cache_dir, RayTracing::Bvh)
    }

    /// Opens a device.
    ///
    /// `select` is an index, a UUID, or part of a name in any case; None is the best there is. `compute_queues` is how
    /// many projectors want a queue. `cache_dir` is where compiled pipelines are kept: read now if they are of this
    /// device and driver, and written when the device is dropped.
    /// `ray_tracing` decides whether it is opened with ray queries.
    ///
    /// # Errors
    /// [`GpuError::NoSuchDevice`], [`GpuError::Unsupported`], also for ray queries that it does not have, or the driver's
    /// refusal.
    pub fn open_for(
        instance: &Arc<Instance>,
        select: Option<&str>,
        compute_queues: u32,
        cache_dir: Option<&Path>,
        ray_tracing: RayTracing,
    ) -> Result<Arc<Device>, GpuError> {
        let devices = instance.devices()?;
        let info = select::choose(&devices, select)?.clone();
        let physical = instance.physical_devices()?.get(info.index).copied();
        let gone =
            || GpuError::Unsupported { device: info.name.clone(), missing: "a place in the list: it is gone".into() };
        let physical = physical.ok_or_else(gone)?;
        let of = families::all(instance, physical);
        let serving = families::serving(&of).ok_or_else(gone)?;
        let transfer = families::transfer(&of);

        let count = compute_queues.max(1).min(serving.count);
        let ray_queries = select::takes_ray_queries(&info, ray_tracing)?;
        let handle = DeviceHandle::create(instance, physical, info, (serving, transfer), count, ray_queries)?;
        let mut queues = Queue::all(&handle, serving.index, count)?;
        if let Some(family) = transfer {
            queues.extend(Queue::all(&handle, family.index, 1)?);
        }
        let cache = PipelineCache::open(&handle, cache_dir)?;
        let cache_bytes = cache.loaded_bytes();
        let uploads = transfer.map_or("on the projectors' first queue", |_| "on a queue of their own");
        tracing::info!(device = handle.info.name, queues = count, uploads, ray_queries, cache_bytes, "device opened");
        let projector_queues = count as usize;
        Ok(Arc::new(Device {
            handle,
            queues,
            projector_queues,
            release: Arc::default(),
            cache,
            work: Mutex::default(),
        }))
    }

    /// What the device is and can do.
    pub fn info(&self) -> &DeviceInfo {
        &self.handle.info
    }

    /// The instance that it was opened by.
    pub fn instance(&self) -> &Arc<Instance> {
        &self.handle.instance
    }

    /// What the device allows.
    pub fn limits(&self) -> &Limits {
        &self.handle.limits
    }

    /// How long work may take: what takes longer has hung, and the device is as good as lost.
    pub fn hung_after(&self) -> Duration {
        self.handle.patience.limit()
    }

    /// Whether it was opened with ray queries, so that shaders may bind a [`TopLevel`](crate::TopLevel).
    pub fn has_ray_queries(&self) -> bool {
        self.handle.ray_queries().is_ok()
    }

    /// The queue of projector `i`: where there are fewer queues than projectors, they take turns.
    pub fn queue(&self, i: usize) -> &Queue {
        &self.queues[i % self.projector_queues]
    }

    /// How many queues were opened for projectors.
    pub fn queue_count(&self) -> usize {
        self.projector_queues
    }

    /// The queue of uploads: one for copies alone where the device has such a family, else the first projector's.
    pub fn upload_queue(&self) -> &Queue {
        &self.queues[self.upload_at()]
    }

    /// Its place among all queues.
    pub(crate) fn upload_at(&self) -> usize {
        if self.queues.len() > self.projector_queues { self.projector_queues } else { 0 }
    }

    /// Bytes of device and mapped memory that live buffers and images take.
    pub fn allocated_bytes(&self) -> u64 {
        self.handle.allocated_bytes()
    }

    /// What was submitted so far.
    pub fn work(&self) -> Work {
        *self.work.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes the pipelines that were compiled so far to the folder of the cache, so that a process that is killed need not have compiled
    /// them for nothing. They are written at the end in any case.
    pub fn keep_pipelines(&self) {
        self.cache.save();
    }

    /// Bytes of compiled pipelines that were read from disk when the device was opened.
    pub fn cache_loaded_bytes(&self) -> usize {
        self.cache.loaded_bytes()
    }

    /// Waits until all that was submitted so far has completed, and lets go of what it used.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn wait_idle(&self) -> Result<(), GpuError> {
        while !self.rests_within(Duration::from_secs(3600))? {}
        Ok(())
    }

    /// The same, for so long a queue at most: false where one still works.
    fn rests_within(&self, patience: Duration) -> Result<bool, GpuError> {
        for queue in &self.queues {
            // Waiting for the timeline rather than the queue leaves others free to submit meanwhile.
            let last = *queue.last.lock().unwrap_or_else(PoisonError::into_inner);
            if !queue.timeline.wait(last, patience)? {
                return Ok(false);
            }
        }
        self.release.collect().map(|()| true)
    }

    pub(crate) fn handle(&self) -> &Arc<DeviceHandle> {
        &self.handle
    }

    pub(crate) fn cache(&self) -> &PipelineCache {
        &self.cache
    }

    pub(crate) fn release(&self) -> &Arc<Release> {
        &self.release
    }

    /// A mark for a new recording on the queue at a place among all.
    pub(crate) fn ticket(&self, at: usize) -> Arc<Ticket> {
        Ticket::new(at, Arc::clone(&self.queues[at].timeline))
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        match self.rests_within(self.handle.patience.at_the_end()) {
            // SAFETY: all work has completed, or the device is lost and does no more.
            Ok(true) | Err(GpuError::DeviceLost { .. }) => unsafe { self.release.clear() },
            hung => {
                tracing::error!(?hung, "a device that does not come to rest keeps what it uses");
                self.release.leak();
            }
        }
    }
}
