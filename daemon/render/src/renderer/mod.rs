//! The projectors of one device, and a frame of all of them.
//!
//! - `uploads`: what comes to the device beside the frames.

mod uploads;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use lantern_calibration::GpuFrustum;
use lantern_gpu::{Buffer, BufferKind, Commands, Device, GpuError, Recorder, Submission};
use lantern_scene::Scene;

use crate::catalogue::Catalogue;
use crate::lenses::Lenses;
use crate::loads::Loads;
use crate::moved::{MovedBoxes, MovedTable};
use crate::pattern::Pattern;
use crate::pipelines::{Features, Pipelines};
use crate::present::Target;
use crate::projector::Projector;
use crate::readback::{self, Layer, LayerImage};
use crate::record::{self, RayKind, Recorded};
use crate::report::{FrameReport, ProjectorReport, timeline};
use crate::scene_buffers::SceneBuffers;
use crate::settings::{ProjectorSpec, Settings};
use crate::stale::{Change, Stale};
use crate::{RenderError, room};

pub use uploads::UPLOAD_BYTES_A_FRAME;

/// Renders for the projectors of one device.
pub struct Renderer {
    device: Arc<Device>,
    /// Those of the scene, and of scenes before it, by what they were made for.
    pipelines: BTreeMap<Features, Arc<Pipelines>>,
    settings: Settings,
    scene_buffers: SceneBuffers,
    /// How shaders read them.
    loads: Loads,
    /// What is shown.
    scene: Arc<Scene>,
    /// Where things have moved that were not yet shown so.
    moved: MovedBoxes,
    /// What is to be shown as soon as all of it is on the device.
    pending: Option<Arc<Scene>>,
    /// What is to be brought to the device and not shown yet.
    prepared: Vec<Arc<Scene>>,
    /// Whether what is wanted on the device has changed since it was last asked for.
    wants_changed: bool,
    /// Whether anything was ever shown: before, nothing has to go on meanwhile.
    has_shown: bool,
    upload_budget_bytes: u64,
    projectors: Vec<Projector>,
    /// Every projector's frustum, which the blend pass of each reads.
    frusta: Arc<Buffer>,
    lenses: Lenses,
    frusta_written: bool,
    rebind: bool,
}

impl Renderer {
    /// Makes everything that frames need; renders nothing.
    ///
    /// # Errors
    /// [`RenderError::Samples`], or what Vulkan says.
    pub fn new(
        device: &Arc<Device>,
        specs: Vec<ProjectorSpec>,
        settings: Settings,
        scene: Arc<Scene>,
    ) -> Result<Self, RenderError> {
        let n = settings.samples.isqrt();
        if n == 0 || n > 16 || n * n != settings.samples {
            return Err(RenderError::Samples(settings.samples));
        }
        let projectors = specs
            .into_iter()
            .enumerate()
            .map(|(i, spec)| Projector::new(device, spec, i, &settings))
            .collect::<Result<Vec<_>, _>>()?;
        Ok(Self {
            device: device.clone(),
            pipelines: BTreeMap::new(),
            settings,
            scene_buffers: SceneBuffers::new(device, settings.walk)?,
            loads: Loads::of_device(device.info()),
            scene,
            moved: MovedBoxes::default(),
            pending: None,
            prepared: Vec::new(),
            wants_changed: true,
            has_shown: false,
            upload_budget_bytes: UPLOAD_BYTES_A_FRAME,
            frusta: frusta_buffer(device, projectors.len())?,
            lenses: Lenses::new(device, projectors.iter().map(|p| &p.spec.calibration))?,
            frusta_written: false,
            projectors,
            rebind: true,
        })
    }

    /// The device.
    pub fn device(&self) -> &Arc<Device> {
        &self.device
    }

    /// How shaders read the scene that is shown.
    pub fn loads(&self) -> Loads {
        self.loads
    }

    /// How it renders.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The scene that is shown. Another one that was set takes its place once all of it is on the device.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// The projectors, in order.
    pub fn projectors(&self) -> impl ExactSizeIterator<Item = &ProjectorSpec> {
        self.projectors.iter().map(|p| &p.spec)
    }

    /// Bytes of device memory that each projector has for itself, in order; the scene's are shared.
    pub fn projector_bytes(&self) -> impl Iterator<Item = u64> {
        self.projectors.iter().map(|p| p.targets.bytes())
    }

    /// Takes other projectors. One of which nothing but the matrix is another keeps its buffers, and what of its picture its own or
    /// the others' calibrations do not make stale; a test pattern stays with its projector's name. Where all are of that kind, as
    /// when a projector is moved, nothing is made or bound anew.
    ///
    /// # Errors
    /// What Vulkan says of a new projector's buffers; then nothing has changed.
    pub fn set_projectors(&mut self, specs: Vec<ProjectorSpec>) -> Result<(), RenderError> {
        if self.projectors.iter().map(|p| &p.spec).eq(&specs) {
            return Ok(());
        }

        // What can fail comes first.
        let mut made = Vec::new();
        for (index, spec) in specs.iter().enumerate() {
            let kept = self.projectors.iter().any(|old| old.can_become(spec));
            let new = || Projector::new(&self.device, spec.clone(), index, &self.settings);
            made.push(if kept { None } else { Some(new()?) });
        }
        let rebind = specs.len() != self.projectors.len()
            || specs.iter().zip(&self.projectors).any(|(spec, old)| !old.can_become(spec));
        if rebind {
            let calibrations = || specs.iter().map(|spec| &spec.calibration);
            let frusta = frusta_buffer(&self.device, specs.len())?;
            if !self.lenses.are_of(calibrations()) {
                self.lenses = Lenses::new(&self.device, calibrations())?;
            }
            self.frusta = frusta;
        }

        // Weights depend on every calibration, a picture on its own.
        let mut old = std::mem::take(&mut self.projectors);
        for (index, (spec, new)) in specs.into_iter().zip(made).enumerate() {
            let at = old.iter().position(|p| p.spec.name == spec.name);
            let before = at.map(|at| old.swap_remove(at));
            let mut projector = match (new, before) {
                (Some(mut new), before) => {
                    new.pattern = before.map_or(Pattern::Off, |b| b.pattern);
                    new
                }
                (None, Some(kept)) => kept,
                // A kept one is there to be kept: its name was found above, and names are unique.
                (None, None) => continue,
            };
            projector.queue = index;
            projector.stale |= Change::OtherCalibration.makes_stale();
            projector.recalibrate(spec);
            self.projectors.push(projector);
        }
        self.frusta_written = false;
        self.rebind |= rebind;
        Ok(())
    }

    /// Whether anything was ever rendered.
    pub fn has_shown(&self) -> bool {
        self.has_shown
    }

    /// Bytes of device memory that the scene's buffers take.
    pub fn scene_bytes(&self) -> u64 {
        self.scene_buffers.bytes()
    }

    /// Whether frames from now on leave out the second look at pixels of which one sample stands for all: faster, and coarser where
    /// what a mirror shows has edges. A picture that was made so is stale once this is off again.
    pub fn set_coarse(&mut self, coarse: bool) {
        for projector in &mut self.projectors {
            projector.coarse = coarse;
            if projector.is_coarse && !coarse {
                projector.stale |= Change::Eye.makes_stale();
            }
        }
    }

    /// Whether any projector shows a picture that was made so.
    pub fn is_coarse(&self) -> bool {
        self.projectors.iter().any(|p| p.is_coarse)
    }

    /// Whether frames can be made coarser at all: not where a pixel has one sample anyway.
    pub fn can_be_coarse(&self) -> bool {
        self.settings.shades_once()
    }

    /// Which projectors' screens are due, by their place: one that is not waits with what its picture lacks where that is nothing but
    /// another eye. Whoever asks later gets it whole. Those beyond the list's end are due.
    pub fn set_due(&mut self, due: &[bool]) {
        for (index, projector) in self.projectors.iter_mut().enumerate() {
            projector.due = due.get(index).copied().unwrap_or(true);
        }
    }

    /// Whether a projector whose screen was not due has yet to show something.
    pub fn is_behind(&self) -> bool {
        self.projectors.iter().any(|p| p.stale.any())
    }

    /// Makes something stale on every projector; for benches, and for tests of what a frame redoes.
    pub fn make_stale(&mut self, stale: Stale) {
        for projector in &mut self.projectors {
            projector.stale |= stale;
        }
    }

    /// Empties what was recorded, and says what the next frames are to keep: the rays of a kind, or of those the part `part` of
    /// `part_count`, which is at least 1. Nothing is recorded without [`Settings::record_rays`].
    ///
    /// # Errors
    /// What Vulkan says.
    pub fn record(&mut self, kind: RayKind, part: u32, part_count: u32) -> Result<(), RenderError> {
        for projector in &self.projectors {
            record::begin(&self.device, &projector.targets.records, kind, part, part_count.max(1))?;
        }
        Ok(())
    }

    /// The rays of a projector since [`Renderer::record`].
    ///
    /// # Errors
    /// [`RenderError::NoProjector`], or what Vulkan says.
    pub fn recorded(&self, projector: usize) -> Result<Recorded, RenderError> {
        let of = self.projectors.get(projector).ok_or(RenderError::NoProjector(projector))?;
        Ok(record::read(&self.device, &of.targets.records)?)
    }

    /// Shows a test pattern on a projector instead of the scene, or the scene again.
    ///
    /// # Errors
    /// [`RenderError::NoProjector`].
    pub fn set_pattern(&mut self, projector: usize, pattern: Pattern) -> Result<(), RenderError> {
        let of = self.projectors.get_mut(projector).ok_or(RenderError::NoProjector(projector))?;
        if of.pattern != pattern {
            of.pattern = pattern;
            of.stale |= Change::Pattern.makes_stale();
        }
        Ok(())
    }

    /// The test pattern that each projector shows, in order.
    pub fn patterns(&self) -> impl Iterator<Item = Pattern> {
        self.projectors.iter().map(|p| p.pattern)
    }

    /// Draws what a projector shows into an image of its output: what the last frame made of it, whole; black where there was none
    /// yet, or where the image has other columns or rows, since no pixel's light would then fall where it belongs. False where it
    /// is black for one of these reasons.
    ///
    /// # Errors
    /// What Vulkan says.
    pub fn present(
        &mut self,
        recorder: &mut Recorder,
        projector: usize,
        target: &Target<'_>,
    ) -> Result<bool, GpuError> {
        let size_px = [target.image.width_px(), target.image.height_px()];
        let fits = |p: &&mut Projector| self.has_shown && p.targets.size_px == size_px;
        match self.projectors.get_mut(projector).filter(fits) {
            Some(of) => of.record_present(&self.device, recorder, target).map(|()| true),
            None => target.record_black(recorder).map(|()| false),
        }
    }

    /// Writes what a projector shows, and its depth, to a buffer that lies as [`crate::ExportLayout`] says: what the last frame made of
    /// it, whole. False where there was none yet, or where the buffer is for other columns or rows; then nothing is recorded.
    ///
    /// # Errors
    /// What Vulkan says.
    pub fn export(
        &mut self,
        recorder: &mut Recorder,
        projector: usize,
        to: &Arc<Buffer>,
        size_px: [u32; 2],
    ) -> Result<bool, GpuError> {
        let fits = |p: &&mut Projector| self.has_shown && p.targets.size_px == size_px;
        match self.projectors.get_mut(projector).filter(fits) {
            Some(of) => of.record_export(&self.device, recorder, to).map(|()| true),
            None => Ok(false),
        }
    }

    /// Renders what is stale. `newest_viewers` is asked twice: to learn whether an eye has moved, and again right before the
    /// submissions, whose frames all show what that second answer says. `None`: nothing was stale, nothing was submitted.
    ///
    /// # Errors
    /// What Vulkan says; what was stale stays so.
    pub fn render(&mut self, newest_viewers: impl Fn() -> Vec<DVec3>) -> Result<Option<FrameReport>, RenderError> {
        if self.settings.always_full {
            self.make_stale(Stale::EVERYTHING);
        }

        // An eye that has moved makes stale only what depends on it.
        let viewers = newest_viewers();
        for projector in &mut self.projectors {
            if projector.shown_viewers != viewers {
                projector.stale |= Change::Eye.makes_stale();
            }
        }
        let (uploaded_bytes, sections) = self.upload()?;
        if !self.projectors.iter().any(Projector::takes_part) {
            // No frame comes that would be waited for, and what was replaced is to go.
            if let Some(sections) = sections {
                sections.wait(self.device.hung_after())?;
            }
            return Ok(None);
        }

        // Everything is recorded before the pose is read, so that nothing but a small write lies between the two.
        let moved =
            self.moved.table(self.projectors.iter().map(|p| (&p.frustum, p.ideal_tiles.as_ref())), self.scene.origin_m);
        let recorded = self.record_passes(&moved)?;
        let count = self.projectors.len();
        let environment_first = self.scene_buffers.environment_first(&self.scene);
        let read = Instant::now();
        let viewers = newest_viewers();
        for (index, projector) in self.projectors.iter_mut().enumerate().filter(|(_, p)| p.takes_part()) {
            projector.write_frame(&self.scene, &viewers, &self.settings, (index, count), environment_first)?;
        }
        let begun = Instant::now();
        let (owners, commands): (Vec<usize>, Vec<Commands>) = recorded.into_iter().unzip();
        let submissions = self.device.submit_all(commands, &[])?;
        let submitted = Instant::now();
        let pose_to_submit_ms = (submitted - read).as_secs_f64() * 1e3;

        // The frame is whole when the last projector's part of it is.
        let mut reports = Vec::new();
        for index in 0..count {
            let own: Vec<&Submission> =
                owners.iter().zip(&submissions).filter(|(owner, _)| **owner == index).map(|(_, s)| s).collect();
            let Some(last) = own.last() else { continue };
            last.wait(self.device.hung_after())?;
            let completed = Instant::now();
            let frame_ms = (completed - begun).as_secs_f64() * 1e3;
            let spans = own.iter().flat_map(|submission| submission.spans());
            reports.push(ProjectorReport {
                projector: index,
                frame_ms,
                completed,
                stages_ms: spans.map(|(name, start, end)| (name, end - start)).collect(),
                pose_to_submit_ms,
                stale: self.projectors[index].stale,
                rays: None,
                timeline: Vec::new(),
            });
        }
        for report in &mut reports {
            self.projectors[report.projector].done();
            let own = owners.iter().zip(&submissions).filter(|(owner, _)| **owner == report.projector);
            report.timeline = own.flat_map(|(_, submission)| timeline(&submissions, submission)).collect();
        }
        self.moved.clear();
        self.has_shown = true;
        if self.settings.count_rays {
            for report in &mut reports {
                let words = readback::read_words(&self.device, &self.projectors[report.projector].targets.counters)?;
                report.rays = Some(bytemuck::cast_slice(&words)[0]);
            }
        }
        let revision = self.scene.revision;
        Ok(Some(FrameReport { revision, projectors: reports, uploaded_bytes, read, submitted }))
    }

    /// Records what is stale, in the order of submission: by projector.
    ///
    /// Weights read the other projectors' occlusion edges, so where several projectors share their light, those that see anew do
    /// so before any weighs, in a recording of its own: then the queues wait for each other in between and nowhere else.
    fn record_passes(&self, moved: &MovedTable) -> Result<Vec<(usize, Commands)>, GpuError> {
        let stale = || self.projectors.iter().enumerate().filter(|(_, p)| p.takes_part());
        let apart = self.settings.blend && self.projectors.len() > 1;
        let shares = |p: &Projector| self.settings.blend && p.spec.calibration.maps().alpha.is_none();
        let shares: Vec<bool> = self.projectors.iter().map(shares).collect();
        let mut recorded = Vec::new();
        for (index, projector) in stale().filter(|(_, p)| apart && p.stale.primary.any()) {
            let mut recorder = projector.recorder(&self.device)?;
            projector.record_seen(&mut recorder, &self.settings, moved)?;
            recorded.push((index, recorder.finish()?));
        }
        for (index, projector) in stale() {
            let mut recorder = projector.recorder(&self.device)?;
            if !apart {
                projector.record_seen(&mut recorder, &self.settings, moved)?;
            }
            projector.record_shown(&mut recorder, &self.settings, (index, &shares), moved)?;
            recorded.push((index, recorder.finish()?));
        }
        Ok(recorded)
    }

    /// The pipelines for the scene as it is, and for that projector's picture; made when they are first needed.
    fn pipelines(&mut self, projector: Option<usize>) -> Result<Arc<Pipelines>, GpuError> {
        let calibration = projector.map(|index| &self.projectors[index].spec.calibration);
        let features = Features::of(&self.scene, self.loads).of_projector(calibration, self.lenses.any());
        if let Some(made) = self.pipelines.get(&features) {
            return Ok(made.clone());
        }
        let (device, settings) = (&self.device, &self.settings);
        let alike = self.pipelines.iter().find(|(made_for, _)| made_for.differ_in_trees_alone(&features));
        let made = Arc::new(match alike {
            Some((_, alike)) => alike.with_trees(device, settings, features)?,
            None => Pipelines::new(device, settings, features)?,
        });
        self.pipelines.insert(features, made.clone());
        Ok(made)
    }

    /// What the projectors of this device share.
    fn catalogue(&self) -> Catalogue {
        self.lenses.list(self.scene_buffers.list(Catalogue::default())).with_buffer("Projectors", &self.frusta)
    }

    /// Reads a layer of the frame that was shown last.
    ///
    /// # Errors
    /// [`RenderError::NoProjector`], or what Vulkan says.
    pub fn read(&self, projector: usize, layer: Layer) -> Result<LayerImage, RenderError> {
        let of = self.projectors.get(projector).ok_or(RenderError::NoProjector(projector))?;
        Ok(readback::read(&self.device, &of.targets, of.frustum.is_reversed(), layer)?)
    }

    /// What a viewer's eye sees of the lit props: every projector's picture, through its own calibration, linear, `size_px`.
    ///
    /// # Errors
    /// What Vulkan says.
    pub fn room(&mut self, eye: DVec3, size_px: [u32; 2]) -> Result<LayerImage, RenderError> {
        let pipelines = self.pipelines(None)?;
        let pictures = self.projectors.iter().map(|p| p.targets.color.clone()).collect();
        let frusta = self.projectors.iter().map(|p| p.frustum.clone()).collect();
        let environment_first = self.scene_buffers.environment_first(&self.scene);
        let of = room::View { frusta, scene: &self.scene, settings: &self.settings, environment_first, pictures };
        room::render(&self.device, &pipelines, &self.catalogue(), &of, eye, size_px)
    }
}

fn frusta_buffer(device: &Arc<Device>, count: usize) -> Result<Arc<Buffer>, GpuError> {
    let bytes = (count.max(1) * size_of::<GpuFrustum>()) as u64;
    Buffer::new(device, "frusta", BufferKind::Storage, bytes)
}
