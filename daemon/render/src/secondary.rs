//! Light that depends on the eye: reflection, refraction, highlights, and virtual things on the line of sight.
//!
//! Reads `Hits` and the lists `Once` and `Each` of the pixels that there is anything to do for; writes `Look`, what is to be added
//! to `Light`. PAPER.md, View-dependent Rendering; Whitted, CACM 23(6), 1980.

use lantern_gpu::{GpuError, Recorder};

use crate::bound::Bound;
use crate::settings::Settings;
use crate::shaders;
use crate::targets::{LIVE_EMPTY, LIVE_HEAD, Targets};

/// Workgroups in x of the pass that makes the lists.
const LIST_GROUPS_X: u32 = 32_768;

/// Records the pass that lists the pixels whose look depends on the eye; it does so itself only where what they land on, or
/// materials, have changed.
pub(crate) fn record_lists(recorder: &mut Recorder, bound: &Bound, targets: &Targets) -> Result<(), GpuError> {
    recorder.span("lists", |recorder| {
        for list in [&targets.once, &targets.each] {
            recorder.upload(list, 0, bytemuck::cast_slice(&LIVE_EMPTY))?;
        }
        let groups = (targets.size_px[0] * targets.size_px[1]).div_ceil(shaders::LISTS_COMP.local_size[0]);
        let grid = [groups.min(LIST_GROUPS_X), groups.div_ceil(LIST_GROUPS_X), 1];
        recorder.dispatch(&bound.pipelines.lists, &bound.lists, &[], grid)?;
        recorder.copy_buffer(&targets.each, 0, &targets.each_head, 0, LIVE_HEAD)
    })
}

/// Records the pass: first one sample of each pixel where it may stand for all, then every sample where it may not, or, where
/// `refine`, did not do.
pub(crate) fn record(
    recorder: &mut Recorder,
    bound: &Bound,
    targets: &Targets,
    settings: &Settings,
    refine: bool,
) -> Result<(), GpuError> {
    let pipelines = &bound.pipelines;
    recorder.span("secondary", |recorder| {
        recorder.copy_buffer(&targets.each_head, 0, &targets.each, 0, LIVE_HEAD)?;
        if settings.shades_once() {
            let middle = &bound.groups[targets.middle_group(settings.samples)];
            let push = [0, 0];
            let once = &targets.once;
            recorder.dispatch_indirect(&pipelines.secondary_once, &middle.once, bytemuck::bytes_of(&push), once)?;
            if refine {
                recorder.dispatch_indirect(&pipelines.refine, &bound.refine, &[], once)?;
            }
        }
        for (first, group) in (0..).step_by(targets.planes_a_group as usize).zip(&bound.groups) {
            let push = [first, 0];
            let each = &targets.each;
            recorder.dispatch_indirect(&pipelines.secondary_each, &group.each, bytemuck::bytes_of(&push), each)?;
        }
        Ok(())
    })
}
