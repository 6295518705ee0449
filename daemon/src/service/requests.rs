//! What other threads ask of the frame thread, between two frames.

use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::time::Instant;

use lantern_gpu::GpuError;
use lantern_render::{Pattern, ProjectorSpec, RenderError};
use lantern_scene::Scene;

use super::carried::Carried;
use super::frames::{FrameThread, Prepared, Setup};
use super::refusal::{Refusal, is_loss};
use super::shared::Request;
use super::sight::Frame;
use crate::output::LendError;

impl FrameThread {
    /// Does what somebody asked, and answers.
    ///
    /// # Errors
    /// The device's loss, of which whoever asked has heard.
    pub(super) fn serve(&mut self, request: Request) -> Result<(), RenderError> {
        match request {
            Request::Read { projector, layer, reply } => {
                let index = self.renderer.projectors().position(|p| p.name == projector);
                match index {
                    Some(index) => {
                        let read = self.settle().and_then(|()| self.renderer.read(index, layer));
                        answer(&reply, read)
                    }
                    None => refuse(&reply, format!("the projector `{projector}` has gone")),
                }
            }
            Request::Room { projector, reply } => {
                let of = self.renderer.projectors().find(|p| p.name == projector);
                let size_px = of.map(|p| p.calibration.resolution_px().to_array());
                match (self.sight.eyes().first(), size_px) {
                    (Some(eye), Some(size_px)) => {
                        let room = self.settle().and_then(|()| self.renderer.room(*eye, size_px));
                        answer(&reply, room)
                    }
                    (None, _) => refuse(&reply, "no body drives the viewer any more"),
                    (_, None) => refuse(&reply, format!("the projector `{projector}` has gone")),
                }
            }
            Request::Pattern { projector, pattern, reply } => {
                let done = self.set_pattern(projector.as_deref(), pattern);
                answer(&reply, done)
            }
            Request::Prepare { scene, lease, reply } => {
                let others = self.prepared.iter().map(|prepared| prepared.scene.clone());
                if let Err(error) = self.renderer.prepare(others.chain([scene.clone()]).collect()) {
                    let _ = reply.send(Err(Refusal::of_scene(&error, &self.shown, &scene, &self.device)));
                    return if is_loss(&error) { Err(error) } else { Ok(()) };
                }
                self.prepared.push(Prepared { scene, lease, reply: Some(reply) });
                Ok(())
            }
            Request::Lend { projector, handle, reply } => {
                // What a device cannot do at all is the client's to hear of; what fails is a matter of the device.
                let lent = match self.screens.lend(&projector, handle) {
                    Err(LendError::Gpu(error)) if !matches!(error, GpuError::Unsupported { .. }) => Err(error.into()),
                    lent => Ok(lent),
                };
                // The picture that is there is its first.
                self.links.shared.stir();
                answer(&reply, lent)
            }
            Request::Reconfigure { setup, reply } => {
                let done = self.reconfigure(*setup);
                answer(&reply, done)
            }
        }
    }

    /// Shows a pattern on one projector, or on all; where that fails, each keeps its own.
    fn set_pattern(&mut self, projector: Option<&str>, pattern: Pattern) -> Result<(), RenderError> {
        let names: Vec<_> = self.renderer.projectors().map(|p| p.name.clone()).collect();
        let before: Vec<_> = self.renderer.patterns().collect();
        for (index, name) in names.iter().enumerate() {
            if projector.is_none_or(|wanted| wanted == name) {
                self.renderer.set_pattern(index, pattern)?;
            }
        }
        self.screens.plan();
        let shown = self.show(Instant::now());
        if shown.is_err() {
            for (index, pattern) in before.into_iter().enumerate() {
                self.renderer.set_pattern(index, pattern)?;
            }
        }
        if shown.as_ref().is_err_and(|error| !is_loss(error)) {
            self.show(Instant::now())?;
        }
        shown.map(drop)
    }

    /// Takes another setup and shows it, or keeps the old one where the new one cannot be made or shown.
    fn reconfigure(&mut self, setup: Setup) -> Result<(), RenderError> {
        let began = Instant::now();
        let carried = Carried::new(setup.projectors, setup.homes_m);
        let projectors = carried.at(self.sight.carrying(began));
        let frame = if setup.settings == *self.renderer.settings() {
            let before = (self.renderer.projectors().cloned().collect(), self.shown.clone());
            let taken = self.take(projectors, setup.scene, began);
            if taken.as_ref().is_err_and(|error| !is_loss(error)) {
                let frame = self.take(before.0, before.1, began)?;
                self.present(frame.as_ref())?;
            }
            taken?
        } else {
            let mut renderer = self.wanted(projectors, setup.settings).on(&self.device, &setup.scene)?;
            let frame = self.sight.render(&mut renderer, began)?;
            self.renderer = renderer;
            frame
        };
        self.carried = carried;
        self.shown = self.renderer.scene().clone();
        self.screens.reconfigure(setup.outputs, setup.degrade, &self.renderer);
        self.sight.set_output_latency(self.screens.latency());
        self.links.shared.publish_shown(&self.shown);
        self.links.stats.set_projectors(&self.renderer);
        self.counted = None;
        self.present(frame.as_ref())?;
        if let Some(frame) = frame {
            self.attempts.showed();
            self.count(&frame, began);
        }
        self.tell_of_revision();
        Ok(())
    }

    /// Shows a scene on these projectors.
    fn take(
        &mut self,
        projectors: Vec<ProjectorSpec>,
        scene: Arc<Scene>,
        began: Instant,
    ) -> Result<Option<Frame>, RenderError> {
        self.renderer.set_projectors(projectors)?;
        self.renderer.set_scene(scene);
        let mut frame = self.sight.render(&mut self.renderer, began)?;
        while self.renderer.is_pending() {
            self.watchdog.feed(Instant::now());
            frame = self.sight.render(&mut self.renderer, began)?.or(frame);
        }
        Ok(frame)
    }
}

/// Answers somebody, who may have gone.
///
/// # Errors
/// The device's loss, which is not theirs alone.
fn answer<T>(reply: &SyncSender<Result<T, Refusal>>, done: Result<T, RenderError>) -> Result<(), RenderError> {
    let (told, loss) = match done {
        Ok(value) => (Ok(value), Ok(())),
        Err(error) => (Err(Refusal::from(&error)), if is_loss(&error) { Err(error) } else { Ok(()) }),
    };
    let _ = reply.send(told);
    loss
}

/// Refuses somebody what has nothing to do with the device.
fn refuse<T>(reply: &SyncSender<Result<T, Refusal>>, message: impl Into<String>) -> Result<(), RenderError> {
    let _ = reply.send(Err(Refusal::new(message)));
    Ok(())
}
