//! What each pass of a projector binds.

use std::sync::Arc;

use lantern_gpu::{Bindings, Buffer, ComputePipeline, GpuError, Recorder};

use crate::catalogue::Catalogue;
use crate::pipelines::Pipelines;
use crate::targets::Targets;

/// What the passes over one sample plane bind.
pub(crate) struct Plane {
    pub(crate) light: Arc<Bindings>,
}

/// What the passes over a group of sample planes bind.
pub(crate) struct Group {
    pub(crate) primary: Arc<Bindings>,
    /// The pass that follows the eye, with the list of the pixels of which one sample is shaded.
    pub(crate) once: Arc<Bindings>,
    /// The same, with the list of those of which every one is.
    pub(crate) each: Arc<Bindings>,
}

/// Every pass of a projector with what it binds; made anew when a buffer of the scene is replaced.
pub(crate) struct Bound {
    pub(crate) pipelines: Arc<Pipelines>,
    planes: Vec<Plane>,
    pub(crate) groups: Vec<Group>,
    pub(crate) lists: Arc<Bindings>,
    pub(crate) refine: Arc<Bindings>,
    pub(crate) tiles: Arc<Bindings>,
    /// What has moved, for as many projectors as there are.
    pub(crate) moved: Arc<Buffer>,
    pub(crate) edges: Arc<Bindings>,
    /// One a projector, itself included.
    pub(crate) blend: Vec<Arc<Bindings>>,
    pub(crate) composite: Arc<Bindings>,
    pub(crate) raster: Arc<Bindings>,
    pub(crate) resolve: Arc<Bindings>,
}

impl Bound {
    pub(crate) fn new(
        pipelines: &Arc<Pipelines>,
        targets: &Targets,
        scene: &Catalogue,
        edges: &[Arc<Buffer>],
        moved: Arc<Buffer>,
    ) -> Result<Self, GpuError> {
        let all = targets.list(scene.clone()).with_buffer("Moved", &moved);
        let plane = |hits: &Arc<Buffer>| {
            let all = all.clone().with_buffer("Hits", hits);
            Ok::<_, GpuError>(Plane { light: all.bind(&*pipelines.light)? })
        };
        let group = |hits: &Arc<Buffer>| {
            let over = |list: &Arc<Buffer>, pipeline: &Arc<ComputePipeline>| {
                all.clone().with_buffer("Hits", hits).with_buffer("Live", list).bind(&**pipeline)
            };
            Ok::<_, GpuError>(Group {
                primary: all.clone().with_buffer("Hits", hits).bind(&*pipelines.primary)?,
                once: over(&targets.once, &pipelines.secondary_once)?,
                each: over(&targets.each, &pipelines.secondary_each)?,
            })
        };
        let planes = (targets.hits.iter()).flat_map(|hits| (0..targets.planes_a_group).map(move |_| plane(hits)));
        let blend = |other: &Arc<Buffer>| all.clone().with_buffer("OtherEdge", other).bind(&*pipelines.blend);
        Ok(Self {
            planes: planes.collect::<Result<_, _>>()?,
            groups: targets.hits.iter().map(group).collect::<Result<_, _>>()?,
            lists: all.bind(&*pipelines.lists)?,
            refine: all.bind(&*pipelines.refine)?,
            tiles: all.bind(&*pipelines.tiles)?,
            moved,
            edges: all.bind(&*pipelines.edges)?,
            blend: edges.iter().map(blend).collect::<Result<_, _>>()?,
            composite: all.bind(&*pipelines.composite_first)?,
            raster: all.bind(&*pipelines.raster)?,
            resolve: all.bind(&*pipelines.resolve)?,
            pipelines: pipelines.clone(),
        })
    }

    /// The sample planes with their numbers.
    pub(crate) fn planes(&self) -> impl Iterator<Item = (u32, &Plane)> {
        (0..).zip(&self.planes)
    }

    /// One dispatch a sample plane, over the tiles of a list: no invocation does more than one sample, which keeps its loops far below the 65,535 turns
    /// after which lavapipe 22.3 ends them silently.
    pub(crate) fn each_plane(
        &self,
        recorder: &mut Recorder,
        span: &'static str,
        bindings: impl Fn(&Plane) -> &Arc<Bindings>,
        pipeline: impl Fn(&Pipelines) -> &Arc<ComputePipeline>,
        tiles: (&Arc<Buffer>, u64),
    ) -> Result<(), GpuError> {
        recorder.span(span, |recorder| {
            for (sample, plane) in self.planes() {
                let push = [sample, 0];
                let (pipeline, push) = (pipeline(&self.pipelines), bytemuck::bytes_of(&push));
                recorder.dispatch_indirect_at(pipeline, bindings(plane), push, tiles)?;
            }
            Ok(())
        })
    }
}
