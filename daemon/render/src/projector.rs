//! One projector: its targets, and the order of its passes.

use std::sync::Arc;

use glam::DVec3;
use lantern_calibration::{Frustum, GpuFrustum};
use lantern_gpu::{Buffer, BufferKind, Device, GpuError, Recorder};
use lantern_scene::Scene;

use crate::bound::Bound;
use crate::catalogue::Catalogue;
use crate::export::Export;
use crate::frame::{GpuFrame, GpuSetup};
use crate::ideal_tiles::IdealTiles;
use crate::jitter::sample_state;
use crate::moved::MovedTable;
use crate::pattern::Pattern;
use crate::pipelines::Pipelines;
use crate::present::{Present, Target};
use crate::raster::RasterNode;
use crate::settings::{ProjectorSpec, RasterOrder, Settings};
use crate::stale::{Change, Stale};
use crate::targets::Targets;
use crate::visible::Visible;
use crate::{RenderError, blend, composite, edges, light, primary, raster, resolve, secondary, tiles};

/// A projector's side of the device.
pub(crate) struct Projector {
    pub(crate) spec: ProjectorSpec,
    pub(crate) frustum: Frustum,
    pub(crate) targets: Targets,
    /// Behind a lens.
    pub(crate) ideal_tiles: Option<IdealTiles>,
    /// The ideal image of raster nodes behind a lens; made when there first is such a node.
    visible: Option<Visible>,
    pub(crate) queue: usize,
    bound: Option<Bound>,
    raster_nodes: Vec<RasterNode>,
    pub(crate) stale: Stale,
    pub(crate) pattern: Pattern,
    /// What its picture was made with: a pattern that was asked for since is not in it yet.
    shown_pattern: Pattern,
    pub(crate) shown_viewers: Vec<DVec3>,
    /// Whether samples may stand for all of a pixel's without a look at its neighbours; and whether the picture was made so.
    pub(crate) coarse: bool,
    pub(crate) is_coarse: bool,
    /// Whether its screen is to show another picture.
    pub(crate) due: bool,
    constants_written: bool,
    present: Option<Present>,
    export: Option<Export>,
}

impl Projector {
    pub(crate) fn new(
        device: &Arc<Device>,
        spec: ProjectorSpec,
        queue: usize,
        settings: &Settings,
    ) -> Result<Self, RenderError> {
        let frustum = Frustum::new(spec.calibration.clone());
        let targets = Targets::new(device, &spec.name, &spec.calibration, settings)?;
        Ok(Self {
            ideal_tiles: IdealTiles::of(&spec.calibration),
            visible: None,
            spec,
            frustum,
            targets,
            queue,
            bound: None,
            raster_nodes: Vec::new(),
            stale: Stale::EVERYTHING,
            pattern: Pattern::Off,
            shown_pattern: Pattern::Off,
            shown_viewers: Vec::new(),
            coarse: false,
            is_coarse: false,
            due: true,
            constants_written: false,
            present: None,
            export: None,
        })
    }

    /// Whether a projector with that calibration can have this one's buffers: all but the matrix is the same.
    pub(crate) fn can_become(&self, spec: &ProjectorSpec) -> bool {
        let (own, other) = (&self.spec.calibration, &spec.calibration);
        self.spec.name == spec.name
            && own.resolution_px() == other.resolution_px()
            && own.optics() == other.optics()
            && own.maps() == other.maps()
    }

    /// Takes another matrix.
    pub(crate) fn recalibrate(&mut self, spec: ProjectorSpec) {
        if self.spec != spec {
            self.stale |= Change::Calibration.makes_stale();
            self.frustum = Frustum::new(spec.calibration.clone());
            self.spec = spec;
        }
    }

    /// Takes a revision: what it draws, and, where `rebound`, the buffers that it reads.
    pub(crate) fn take(
        &mut self,
        device: &Arc<Device>,
        scene: &Scene,
        catalogue: &Catalogue,
        pipelines: &Arc<Pipelines>,
        edges: &[Arc<Buffer>],
        rebound: bool,
    ) -> Result<(), GpuError> {
        self.raster_nodes = raster::nodes(scene);
        if rebound {
            self.visible = None;
        }
        if let Some(tiles) = self.ideal_tiles.as_ref().filter(|_| !self.raster_nodes.is_empty())
            && self.visible.is_none()
        {
            let own = (&self.targets, tiles);
            self.visible = Some(Visible::new(device, &self.spec.name, own, catalogue, pipelines)?);
        }
        if rebound || self.bound.is_none() {
            let bytes = MovedTable::bytes_for(edges.len());
            let moved = Buffer::new(device, &format!("{}/moved", self.spec.name), BufferKind::Storage, bytes)?;
            self.bound = Some(Bound::new(pipelines, &self.targets, catalogue, edges, moved)?);
        }
        Ok(())
    }

    /// Records what is stale and needs nothing of another projector's: what each pixel lands on, and where its light ends.
    pub(crate) fn record_seen(
        &self,
        recorder: &mut Recorder,
        settings: &Settings,
        moved: &MovedTable,
    ) -> Result<(), GpuError> {
        let Some(bound) = self.bound.as_ref().filter(|_| self.stale.primary.any()) else { return Ok(()) };
        if !self.constants_written {
            self.write_constants(recorder, settings)?;
        }
        recorder.fill(&self.targets.counters, 0)?;
        tiles::record(recorder, bound, &self.targets, self.stale, moved)?;
        primary::record(recorder, bound, &self.targets)?;
        if settings.blend {
            edges::record(recorder, bound, &self.targets)?;
        }
        Ok(())
    }

    /// What never changes while a projector keeps its buffers.
    fn write_constants(&self, recorder: &mut Recorder, settings: &Settings) -> Result<(), GpuError> {
        let words = sample_state(&self.spec.name, settings.samples);
        recorder.upload(&self.targets.sample_state, 0, bytemuck::cast_slice(&words))?;
        let calibration = &self.spec.calibration;
        if !calibration.maps().is_empty() {
            let maps = calibration.maps().packed(calibration.resolution_px());
            recorder.upload(&self.targets.maps, 0, bytemuck::cast_slice(&maps))?;
        }
        if let Some(tiles) = &self.ideal_tiles {
            recorder.upload(&self.targets.ideal_tiles, 0, bytemuck::cast_slice(tiles.around_px()))?;
        }
        Ok(())
    }

    /// Records the rest of what is stale, in the order in which each pass reads the last one's buffers. Every projector's
    /// [`Projector::record_seen`] comes before any of these, since weights read the others' occlusion edges.
    pub(crate) fn record_shown(
        &self,
        recorder: &mut Recorder,
        settings: &Settings,
        (index, shares): (usize, &[bool]),
        moved: &MovedTable,
    ) -> Result<(), GpuError> {
        let Some(bound) = self.bound.as_ref().filter(|_| self.stale.any()) else { return Ok(()) };
        let (stale, targets) = (self.stale, &self.targets);
        if !stale.primary.any() {
            recorder.fill(&targets.counters, 0)?;
            if stale.any_tiles() {
                tiles::record(recorder, bound, targets, stale, moved)?;
            }
        }
        if stale.light.any() {
            light::record(recorder, bound, targets)?;
            secondary::record_lists(recorder, bound, targets)?;
        }
        if stale.weight.any() {
            blend::record(recorder, bound, targets, index, shares)?;
        }
        if stale.look {
            secondary::record(recorder, bound, targets, settings, !self.coarse)?;
        }
        recorder.span("composite", |recorder| self.record_composite(recorder, bound, settings))
    }

    /// Where nothing is rasterised one composite serves the pixel. Otherwise every stratum is composited on its own, so that
    /// the rasteriser samples a pixel as finely as the rays do.
    fn record_composite(&self, recorder: &mut Recorder, bound: &Bound, settings: &Settings) -> Result<(), GpuError> {
        let strata = if self.raster_nodes.is_empty() { 1 } else { settings.samples.isqrt() };
        let order = if self.raster_nodes.is_empty() { RasterOrder::After } else { settings.raster };
        for pass in 0..strata * strata {
            let from_centre = |i: u32| (i as f32 + 0.5) / strata as f32 - 0.5;
            let offset_px = [from_centre(pass % strata), from_centre(pass / strata)];
            let visible = self.visible.as_ref().filter(|_| !self.raster_nodes.is_empty());
            if let Some(visible) = visible.filter(|_| pass == 0) {
                visible.record(recorder, &bound.pipelines, &self.raster_nodes)?;
            }
            composite::record(recorder, bound, &self.targets, (&self.raster_nodes, visible), order, offset_px)?;
            resolve::record(recorder, bound, pass, strata * strata, self.targets.groups())?;
        }
        Ok(())
    }

    /// Draws what it shows into an image of its output, which has as many pixels.
    pub(crate) fn record_present(
        &mut self,
        device: &Arc<Device>,
        recorder: &mut Recorder,
        target: &Target<'_>,
    ) -> Result<(), GpuError> {
        let mapped = !self.spec.calibration.maps().is_empty();
        let of = match self.present.take().filter(|present| present.serves(target)) {
            Some(present) => present,
            None => Present::new(device, &self.targets, mapped, target)?,
        };
        let is_pattern = self.shown_pattern != Pattern::Off;
        self.present.insert(of).record(recorder, &self.targets, is_pattern, target)
    }

    /// Writes what it shows to a buffer of another process.
    pub(crate) fn record_export(
        &mut self,
        device: &Arc<Device>,
        recorder: &mut Recorder,
        to: &Arc<Buffer>,
    ) -> Result<(), GpuError> {
        let of = match self.export.take() {
            Some(export) => export,
            None => Export::new(device)?,
        };
        self.export.insert(of).record(recorder, &self.targets, self.frustum.is_reversed(), to)
    }

    /// A recording for its queue.
    pub(crate) fn recorder(&self, device: &Arc<Device>) -> Result<Recorder, GpuError> {
        Recorder::new(device, self.queue, &self.spec.name)
    }

    /// Writes the blocks that the recorded passes read. Called as late as the newest pose allows: right before the submission.
    pub(crate) fn write_frame(
        &mut self,
        scene: &Scene,
        viewers: &[DVec3],
        settings: &Settings,
        index: (usize, usize),
        environment_first: u32,
    ) -> Result<(), GpuError> {
        if self.stale.look {
            self.shown_viewers = viewers.to_vec();
        }
        let frustum = GpuFrustum::new(&self.frustum, scene.origin_m);
        let setup = GpuSetup {
            pattern: self.pattern as u32,
            planes_a_group: self.targets.planes_a_group,
            environment_first,
            ..GpuSetup::new(scene, &self.shown_viewers, settings, index)
        };
        self.targets.frame.write(&GpuFrame::new(frustum, scene, &self.shown_viewers), &setup)
    }

    /// Whether the next frame has anything to do for it: nothing but another eye can wait until its screen is due.
    pub(crate) fn takes_part(&self) -> bool {
        self.stale.any() && (self.due || !self.stale.is_of_eye_alone())
    }

    /// What was recorded has been shown.
    pub(crate) fn done(&mut self) {
        if self.stale.look {
            self.is_coarse = self.coarse;
        }
        self.shown_pattern = self.pattern;
        self.stale = Stale::NOTHING;
        self.constants_written = true;
    }
}
