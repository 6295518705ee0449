//! What is on its way to the device: the next scene and those that are prepared, beside the frames, and the switch to one that is whole.

use std::sync::Arc;

use lantern_calibration::GpuFrustum;
use lantern_gpu::{GpuError, Recorder, Submission};
use lantern_scene::{Scene, changes, moved};

use super::Renderer;
use crate::RenderError;
use crate::pipelines::{Features, has_virtual};
use crate::stale::{Change, Stale, stale_by};

/// What is uploaded beside one frame at most, bytes: a few milliseconds' worth on a software driver, a fraction of one elsewhere.
pub const UPLOAD_BYTES_A_FRAME: u64 = 4 << 20;

/// The same before the first frame. It bounds the memory of the host that uploads pass through.
const FIRST_SLICE_BYTES: u64 = 16 << 20;

impl Renderer {
    /// Takes another revision of the scene, instead of any that was taken and is not shown yet. The next frame shows it where at
    /// most a slice has to be uploaded; else frames go on showing the one before until all of it is on the device.
    pub fn set_scene(&mut self, scene: Arc<Scene>) {
        let asked_for = self.pending.as_ref().unwrap_or(&self.scene);
        if !Arc::ptr_eq(asked_for, &scene) {
            self.pending = if Arc::ptr_eq(&self.scene, &scene) { None } else { Some(scene) };
            self.wants_changed = true;
        }
    }

    /// Whether a scene was set that is not shown yet.
    pub fn is_pending(&self) -> bool {
        self.pending.is_some()
    }

    /// Brings what these scenes hold to the device, beside the frames, and keeps it there as long as they are among those given
    /// last. A revision made of it can then be shown at once, and none that comes in between has to wait.
    ///
    /// # Errors
    /// A buffer that the device cannot make; then those given before stay.
    pub fn prepare(&mut self, scenes: Vec<Arc<Scene>>) -> Result<(), RenderError> {
        let before = std::mem::replace(&mut self.prepared, scenes);
        if let Err(error) = self.want() {
            self.prepared = before;
            return Err(error.into());
        }
        Ok(())
    }

    /// Asks for what is wanted on the device.
    fn want(&mut self) -> Result<(), GpuError> {
        let scenes = [&self.scene].into_iter().chain(&self.pending).chain(&self.prepared);
        self.scene_buffers.want(scenes)?;
        self.wants_changed = false;
        Ok(())
    }

    /// Whether all that a scene holds is on the device.
    pub fn is_prepared(&self, scene: &Scene) -> bool {
        self.scene_buffers.has(scene)
    }

    /// Whether uploads have yet to be made: [`Renderer::render`] goes on with them, whether or not anything is stale.
    pub fn is_uploading(&self) -> bool {
        self.pending.is_some() || self.wants_changed || self.scene_buffers.is_busy()
    }

    /// How much is uploaded beside one frame, bytes; for tests, whose scenes are small.
    pub fn set_upload_budget(&mut self, bytes: u64) {
        self.upload_budget_bytes = bytes;
    }

    /// Shows another revision, all of which is on the device.
    fn switch_to(&mut self, scene: Arc<Scene>) {
        let mut stale = stale_by(&changes(&self.scene, &scene));
        let (before, after) = (Features::of(&self.scene, self.loads), Features::of(&scene, self.loads));
        if before != after {
            self.rebind = true;
            stale |= match before.differ_in_trees_alone(&after) {
                true => Change::TreePipelines.makes_stale(),
                false => Change::Pipelines.makes_stale(),
            };
        }
        if has_virtual(&self.scene) != has_virtual(&scene) {
            stale |= Change::AnyVirtual.makes_stale();
        }
        moved(&self.scene, &scene).iter().for_each(|moved| self.moved.add(moved));
        if scene.origin_m != self.scene.origin_m {
            stale = Stale::EVERYTHING;
            self.frusta_written = false;
        }
        self.scene = scene;
        self.make_stale(stale);
    }

    /// Goes on with what has to be brought to the device, and shows the pending scene once it is there. Gives the bytes of blocks
    /// that were sent, and the submission of small sections, where there is one.
    pub(super) fn upload(&mut self) -> Result<(u64, Option<Submission>), GpuError> {
        if self.wants_changed {
            // What the device has no room for is not asked for again.
            if let Err(error) = self.want() {
                self.pending = None;
                return Err(error);
            }
        }
        let mut bytes = 0;
        if self.scene_buffers.is_busy() {
            let mut budget = self.upload_budget_bytes;
            loop {
                let advanced = self.scene_buffers.advance(budget)?;
                self.rebind |= advanced.moved;
                bytes += advanced.bytes;
                if self.has_shown || !self.scene_buffers.is_busy() {
                    break;
                }
                // Nothing is shown that would have to go on meanwhile.
                budget = FIRST_SLICE_BYTES;
            }
        }
        if let Some(scene) = self.pending.take_if(|scene| self.scene_buffers.has(scene)) {
            self.switch_to(scene);
            self.wants_changed = true;
        }
        let sections = self.write_sections().inspect_err(|_| {
            // Some buffers may be others already, so nothing that was bound before may be used again.
            self.scene_buffers.forget();
            self.rebind = true;
        })?;
        Ok((bytes, sections))
    }

    /// Brings the shown scene's small sections and the frusta to the device where they differ, and binds what was replaced.
    fn write_sections(&mut self) -> Result<Option<Submission>, GpuError> {
        let mut sections = None;
        if self.scene_buffers.differs(&self.scene) || !self.frusta_written || self.lenses.differs() {
            let mut recorder = Recorder::new(&self.device, 0, "sections")?;
            self.rebind |= self.scene_buffers.update(&mut recorder, &self.scene)?;
            let frusta: Vec<GpuFrustum> =
                self.projectors.iter().map(|p| GpuFrustum::new(&p.frustum, self.scene.origin_m)).collect();
            recorder.upload(&self.frusta, 0, bytemuck::cast_slice(&frusta))?;
            self.lenses.write(&mut recorder)?;
            sections = Some(self.device.submit(recorder.finish()?, &[])?);
            self.lenses.written();
            self.frusta_written = true;
        }
        // What shaders read lies in other buffers only where these are bound anew, and looks the same either way.
        if self.rebind {
            self.loads = self.scene_buffers.loads()?;
        } else if sections.is_none() {
            return Ok(None);
        }
        let catalogue = self.catalogue();
        let pipelines: Vec<_> =
            (0..self.projectors.len()).map(|index| self.pipelines(Some(index))).collect::<Result<_, _>>()?;
        let edges: Vec<_> = self.projectors.iter().map(|p| p.targets.edge.clone()).collect();
        for (projector, pipelines) in self.projectors.iter_mut().zip(&pipelines) {
            projector.take(&self.device, &self.scene, &catalogue, pipelines, &edges, self.rebind)?;
        }
        self.rebind = false;
        Ok(sections)
    }
}
