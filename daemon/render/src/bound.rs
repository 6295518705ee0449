//! What each pass of a projector binds.

use std::sync::Arc;

use lantern_gpu::{Bindings, Buffer, ComputePipeline, GpuError, Recorder};

use crate::catalogue::Catalogue;
use crate::pipelines::Pipelines;
use crate::targets::Targets;

/// What the passes over a group of sample planes bind.
pub(crate) struct Group {
    pub(crate) primary: Arc<Bindings>,
    pub(crate) light: Arc<Bindings>,
    /// The pass that follows the eye, with the list of the pixels of which one sample is shaded.
    pub(crate) once: Arc<Bindings>,
    /// The same, with the list of those of which every one is.
    pub(crate) each: Arc<Bindings>,
}

/// Every pass of a projector with what it binds; made anew when a buffer of the scene is replaced.
pub(crate) struct Bound {
    pub(crate) pipelines: Arc<Pipelines>,
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
        let group = |hits: &Arc<Buffer>| {
            let all = all.clone().with_buffer("Hits", hits);
            let over = |list: &Arc<Buffer>, pipeline: &Arc<ComputePipeline>| {
                all.clone().with_buffer("Live", list).bind(&**pipeline)
            };
            Ok::<_, GpuError>(Group {
                primary: all.bind(&**pipelines.primary(targets.planes_a_group))?,
                light: all.bind(&*pipelines.light)?,
                once: over(&targets.once, &pipelines.secondary_once)?,
                each: over(&targets.each, &pipelines.secondary_each)?,
            })
        };
        let blend = |other: &Arc<Buffer>| all.clone().with_buffer("OtherEdge", other).bind(&*pipelines.blend);
        Ok(Self {
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

    /// Dispatches over the tiles of a list for all sample planes, `together` of a group at once: each is told its first plane.
    pub(crate) fn each_plane(
        &self,
        recorder: &mut Recorder,
        pipeline: &Arc<ComputePipeline>,
        bindings: impl Fn(&Group) -> &Arc<Bindings>,
        (planes_a_group, together): (u32, u32),
        tiles: (&Arc<Buffer>, u64),
    ) -> Result<(), GpuError> {
        for (group, first) in self.groups.iter().zip((0..).step_by(planes_a_group as usize)) {
            for plane in (0..planes_a_group).step_by(together as usize) {
                let push = [first + plane, 0];
                recorder.dispatch_indirect_at(pipeline, bindings(group), bytemuck::bytes_of(&push), tiles)?;
            }
        }
        Ok(())
    }
}
