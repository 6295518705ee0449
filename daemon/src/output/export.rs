//! An output whose pictures go to other processes, in memory that these import.

use std::sync::Arc;

use lantern_gpu::{Buffer, Device, GpuError, HandleKind, Recorder, SharedTimeline, Submission};
use lantern_proto::event::{ExportEnd, ExportEvent};
use lantern_proto::{ExportBuffer, ExportHandle, ExportMemory, ExportOpened, ExportPlane};
use lantern_render::{ExportLayout, Renderer};

use super::{Description, Output, OutputError, Picture, Showing};
use crate::feed::{Feed, IMAGES, Lent, Wake};

/// Clients of one projector's pictures: each costs a copy a frame, and memory of its own.
const MAX_READERS: usize = 4;

/// Why it gets none.
#[derive(Debug, thiserror::Error)]
pub enum LendError {
    /// It goes elsewhere.
    #[error("its pictures go to no other process; hint: give it output = {{ kind = \"export\" }}")]
    NoExport,
    /// It is not there.
    #[error("its output is lost: {0}")]
    Lost(String),
    /// Others have them.
    #[error("all {MAX_READERS} places for readers are taken; hint: close one, or try again later")]
    Taken,
    /// What the driver says.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// A client with its images.
struct Served {
    feed: Arc<Feed>,
    images: Vec<Arc<Buffer>>,
    timeline: Option<Arc<SharedTimeline>>,
    /// It was never shown anything.
    is_new: bool,
}

/// The output.
pub(super) struct ExportOutput {
    device: Arc<Device>,
    projector: String,
    size_px: [u32; 2],
    queue: usize,
    wake: Wake,
    served: Vec<Served>,
    missed: u64,
}

impl ExportOutput {
    pub(super) fn open(
        device: &Arc<Device>,
        projector: &str,
        size_px: [u32; 2],
        queue: usize,
        wake: Wake,
    ) -> Result<Self, OutputError> {
        device.must_export(HandleKind::OpaqueFd)?;
        let (device, projector) = (device.clone(), projector.to_owned());
        Ok(Self { device, projector, size_px, queue, wake, served: Vec::new(), missed: 0 })
    }

    /// Writes the newest picture to images of one client.
    fn serve(&mut self, at: usize, renderer: &mut Renderer, picture: Picture) -> Result<Told, GpuError> {
        let Picture { projector, frame, .. } = picture;
        let served = &mut self.served[at];
        served.is_new = false;
        let Some(image) = served.feed.free() else {
            self.missed += 1;
            return Ok(None);
        };
        let mut recorder = Recorder::new(&self.device, self.queue, &self.projector)?;
        if !renderer.export(&mut recorder, projector, &served.images[image], self.size_px)? {
            return Ok(None);
        }
        let value = recorder.hand_out(&served.images[image], served.timeline.as_ref())?;
        let submission = self.device.submit(recorder.finish()?, &[])?;
        let (projector, revision) = (self.projector.clone(), renderer.scene().revision);
        Ok(Some((submission, ExportEvent { projector, image, frame, revision, value, missed: 0 })))
    }
}

/// A picture on its way, and what is to be said of it.
type Told = Option<(Submission, ExportEvent)>;

impl Output for ExportOutput {
    fn show(&mut self, renderer: &mut Renderer, picture: Picture) -> Result<Showing, OutputError> {
        if !renderer.has_shown() {
            return Ok(Showing::Black);
        }
        let mut told = Vec::new();
        for at in 0..self.served.len() {
            // Who has this picture already does not get it again for another's sake.
            let of = &self.served[at];
            if (picture.is_new || of.is_new || of.feed.wants_newest())
                && let Some((submission, event)) = self.serve(at, renderer, picture)?
            {
                told.push((at, submission, event));
            }
        }
        for (at, submission, event) in told {
            // A timeline lets the client wait by itself; else a picture is whole before anyone hears of it.
            if event.value.is_none() {
                submission.wait(self.device.hung_after())?;
            }
            self.served[at].feed.tell(event);
        }
        Ok(Showing::Shown)
    }

    fn must_show_again(&mut self) -> bool {
        // Images of those who have gone go as soon as the device is through with them.
        self.served.retain(|served| !served.feed.is_closed());
        self.served.iter().any(|served| served.is_new || served.feed.wants_newest())
    }

    fn describe(&self) -> Description {
        Description {
            readers: Some(self.served.len() as u64),
            readers_missed: Some(self.missed),
            size_px: Some(self.size_px),
            ..Description::default()
        }
    }

    fn lend(&mut self, handle: ExportHandle) -> Result<Lent, LendError> {
        self.served.retain(|served| !served.feed.is_closed());
        if self.served.len() >= MAX_READERS {
            return Err(LendError::Taken);
        }
        let kind = match handle {
            ExportHandle::OpaqueFd => HandleKind::OpaqueFd,
            ExportHandle::DmaBuf => HandleKind::DmaBuf,
        };
        let layout = ExportLayout::of(self.size_px);
        let name = format!("{}/exported", self.projector);
        let (mut images, mut descriptors) = (Vec::new(), Vec::new());
        let (mut memory, mut buffer) = (ExportMemory::default(), ExportBuffer::default());
        for _ in 0..IMAGES {
            // All are alike, and so is what is said of them.
            let exported = self.device.export_buffer(&name, layout.bytes, kind)?;
            let (bytes, memory_type, dedicated) = (exported.memory_bytes, exported.memory_type, exported.alone);
            memory = ExportMemory { bytes, memory_type, dedicated };
            buffer = ExportBuffer { bytes: exported.buffer_bytes, usage: exported.usage };
            images.push(exported.buffer);
            descriptors.push(exported.memory);
        }
        // Whoever takes a dma-buf need not be Vulkan, nor the same driver, which alone could wait for a timeline.
        let timeline = match kind {
            HandleKind::OpaqueFd => self.device.export_timeline(&name)?,
            HandleKind::DmaBuf => None,
        };
        let timeline = timeline.map(|(timeline, descriptor)| {
            descriptors.push(descriptor);
            timeline
        });
        let plane = |format: &str, offset| ExportPlane { format: format.into(), offset, row_pitch: layout.row_pitch };
        let info = self.device.info();
        let opened = ExportOpened {
            projector: self.projector.clone(),
            handle,
            images: IMAGES,
            width: self.size_px[0],
            height: self.size_px[1],
            color: plane("R8G8B8A8_SRGB", 0),
            depth: plane("R32_SFLOAT", layout.depth_offset),
            memory,
            buffer,
            semaphore: timeline.is_some(),
            device_uuid: info.uuid.clone(),
            driver_uuid: info.driver_uuid.clone(),
        };
        let (feed, reader) = Feed::new(self.wake.clone());
        self.served.push(Served { feed, images, timeline, is_new: true });
        Ok(Lent { opened, descriptors, reader })
    }
}

impl Drop for ExportOutput {
    fn drop(&mut self) {
        for served in &self.served {
            let detail = "the output has gone; hint: open it again".to_owned();
            served.feed.end(ExportEnd { projector: self.projector.clone(), detail });
        }
    }
}
