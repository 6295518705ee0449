//! What another renderer is to show, so that it stands in for the one before: on a device that is opened anew, or with other settings.

use std::sync::Arc;

use lantern_gpu::Device;
use lantern_render::{Pattern, ProjectorSpec, RenderError, Renderer, Settings};
use lantern_scene::Scene;

use super::frames::FrameThread;

/// What it is to show, of whatever scene.
pub(super) struct Wanted {
    projectors: Vec<ProjectorSpec>,
    patterns: Vec<(String, Pattern)>,
    settings: Settings,
    prepared: Vec<Arc<Scene>>,
}

impl FrameThread {
    /// What is shown now and brought to the device for others, on these projectors. Test patterns stay where their projectors do.
    pub(super) fn wanted(&self, projectors: Vec<ProjectorSpec>, settings: Settings) -> Wanted {
        let names = self.renderer.projectors().map(|projector| projector.name.clone());
        Wanted {
            projectors,
            patterns: names.zip(self.renderer.patterns()).collect(),
            settings,
            prepared: self.prepared.iter().map(|prepared| prepared.scene.clone()).collect(),
        }
    }
}

impl Wanted {
    /// A renderer on a device that shows a scene.
    ///
    /// # Errors
    /// What Vulkan says.
    pub(super) fn on(&self, device: &Arc<Device>, scene: &Arc<Scene>) -> Result<Renderer, RenderError> {
        let mut renderer = Renderer::new(device, self.projectors.clone(), self.settings, scene.clone())?;
        for (at, projector) in self.projectors.iter().enumerate() {
            if let Some((_, pattern)) = self.patterns.iter().find(|(name, _)| *name == projector.name) {
                renderer.set_pattern(at, *pattern)?;
            }
        }
        renderer.prepare(self.prepared.clone())?;
        Ok(renderer)
    }
}
