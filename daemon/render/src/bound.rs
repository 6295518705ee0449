//! What each pass of a projector binds.

use std::sync::Arc;

use lantern_gpu::{Bindings, Buffer, ComputePipeline, GpuError, Recorder};

use crate::catalogue::Catalogue;
use crate::pipelines::Pipelines;
use crate::targets::Targets;

/// What the passes over one sample plane bind.
pub(crate) struct Plane {
    pub(crate) primary: Arc<Bindings>,
    pub(crate) light: Arc<Bindings>,
    pub(crate) secondary: Arc<Bindings>,
}

/// Every pass of a projector with what it binds; made anew when a buffer of the scene is replaced.
pub(crate) struct Bound {
    pub(crate) pipelines: Arc<Pipelines>,
    planes: Vec<Plane>,
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
    ) -> Result<Self, GpuError> {
        let all = targets.list(scene.clone());
        let plane = |(hits, live): (&Arc<Buffer>, &Arc<Buffer>)| {
            let all = all.clone().with_buffer("Hits", hits).with_buffer("Live", live);
            Ok::<_, GpuError>(Plane {
                primary: all.bind(&*pipelines.primary)?,
                light: all.bind(&*pipelines.light)?,
                secondary: all.bind(&*pipelines.secondary)?,
            })
        };
        let blend = |other: &Arc<Buffer>| all.clone().with_buffer("OtherEdge", other).bind(&*pipelines.blend);
        Ok(Self {
            planes: targets.hits.iter().zip(&targets.live).map(plane).collect::<Result<_, _>>()?,
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

    /// One dispatch a sample plane: no invocation does more than one sample, which keeps its loops far below the 65,535 turns
    /// after which lavapipe 22.3 ends them silently.
    pub(crate) fn each_plane(
        &self,
        recorder: &mut Recorder,
        span: &'static str,
        bindings: impl Fn(&Plane) -> &Arc<Bindings>,
        pipeline: impl Fn(&Pipelines) -> &Arc<ComputePipeline>,
        groups: [u32; 3],
    ) -> Result<(), GpuError> {
        recorder.span(span, |recorder| {
            for (sample, plane) in self.planes() {
                let push = [sample, 0];
                recorder.dispatch(pipeline(&self.pipelines), bindings(plane), bytemuck::bytes_of(&push), groups)?;
            }
            Ok(())
        })
    }
}
