//! A device that is lost, or hangs, is opened again, and what was shown is shown again.
//!
//! Everything on the lost device goes first, so that its memory is free; then the same device is opened, with the same pipelines from
//! the cache, and shows the newest revision on the same projectors with the same test patterns. Where that revision was never shown
//! and the device is lost over it once more, the one that was shown last is, and the newest is refused. Frames and revisions count on.

use std::sync::Arc;
use std::time::{Duration, Instant};

use lantern_gpu::{Device, GpuError};
use lantern_render::{RenderError, Renderer};

use super::frames::{FrameError, FrameThread};
use super::refusal::Refusal;
use super::screens::Screens;
use super::sight::Frame;

/// Times in a row that a device is opened again. What fails then may be the driver or the bus; another process has better chances.
const ATTEMPTS: u32 = 6;
/// The wait before the second attempt; each later one is twice as long.
const FIRST_WAIT: Duration = Duration::from_millis(250);

/// A loss so long after the last attempt has nothing to do with it.
const APART: Duration = Duration::from_secs(60);

/// How often, and how soon, a device is opened again.
#[derive(Debug, Default)]
pub(super) struct Attempts {
    in_a_row: u32,
    last: Option<Instant>,
}

impl Attempts {
    /// How long to wait before another attempt; none where there have been enough.
    fn next(&mut self, now: Instant) -> Option<Duration> {
        if self.last.is_some_and(|last| now.saturating_duration_since(last) > APART) {
            self.in_a_row = 0;
        }
        self.last = Some(now);
        self.in_a_row += 1;
        match self.in_a_row {
            1 => Some(Duration::ZERO),
            n if n <= ATTEMPTS => Some(FIRST_WAIT * 2u32.pow(n - 2)),
            _ => None,
        }
    }

    /// Something new was shown, which is more than what is shown right after the device was opened: the next loss is the first again.
    pub(super) fn showed(&mut self) {
        self.in_a_row = 0;
    }
}

impl FrameThread {
    /// Shows what was shown before `loss` on a device that is opened anew; `None` where it is told to stop meanwhile.
    ///
    /// # Errors
    /// [`FrameError::GaveUp`] where the device cannot be had again, [`FrameError::Hangs`] where another process has to try.
    pub(super) fn recover(mut self, loss: &RenderError) -> Result<Option<Self>, FrameError> {
        tracing::error!("{loss}; nothing is shown until the device is open again");
        self.links.hardware.lost();
        let began = Instant::now();
        let projectors = self.carried.at(self.sight.carrying(began));
        let wanted = self.wanted(projectors, *self.renderer.settings());
        let newest = self.links.shared.newest();
        let mut scene = if self.refused == Some(newest.revision) { self.shown.clone() } else { newest.clone() };

        // What hangs keeps its displays for as long as this process lives; the next one has them.
        if matches!(loss, RenderError::Gpu(GpuError::Timeout { .. })) && self.screens.have_displays() {
            return Err(FrameError::Hangs(loss.to_string()));
        }
        // All of the old device goes before the new one comes; outputs first, which show what is on it.
        let (outputs, degrade) = self.screens.give_up();
        drop(self.renderer);
        drop(self.device);
        let mut last = loss.to_string();
        let (device, renderer, frame): (Arc<Device>, Renderer, Option<Frame>) = loop {
            let Some(wait) = self.attempts.next(Instant::now()) else {
                return Err(FrameError::GaveUp { attempts: ATTEMPTS, loss: loss.to_string(), last });
            };
            self.links.shared.pause(Instant::now() + wait);
            if self.links.shared.stopping() {
                return Ok(None);
            }
            self.watchdog.feed(Instant::now());
            let device = match (self.open)() {
                Ok(device) => device,
                Err(error) => {
                    last = format!("{error:#}");
                    tracing::warn!("the device cannot be opened: {last}");
                    continue;
                }
            };
            let began = Instant::now();
            let shown = wanted.on(&device, &scene).and_then(|mut renderer| {
                let frame = self.sight.render(&mut renderer, began)?;
                Ok((renderer, frame))
            });
            match shown {
                Ok((renderer, frame)) => break (device, renderer, frame),
                Err(error) => {
                    last = error.to_string();
                    tracing::warn!(revision = scene.revision, "the device was opened, and shows nothing: {last}");
                    // It may be this revision that it is lost over.
                    if scene.revision != self.shown.revision {
                        let refusal = Refusal::of_scene(&error, &self.shown, &scene, &device);
                        if self.links.shared.shown(scene.revision, Err(refusal)) {
                            self.refused = Some(scene.revision);
                        }
                        scene = self.shown.clone();
                    }
                }
            }
        };

        let screens = Screens::open(&device, outputs, degrade, &renderer, &self.links.shared);
        let mut again = Self { device, renderer, screens, ..self };
        again.links.hardware.opened(&again.device);
        again.links.stats.set_projectors(&again.renderer);
        // Where the device is lost over this, the next turn finds it so.
        if let Err(error) = again.present(frame.as_ref()) {
            tracing::warn!("outputs cannot be shown on: {error}");
        }
        if let Some(frame) = &frame {
            again.count(frame, began);
        }
        again.shown = again.renderer.scene().clone();
        let revision = again.shown.revision;
        again.links.shared.shown(revision, Ok(again.frame));
        again.tell_of_revision();
        tracing::info!(
            device = again.device.info().name,
            revision,
            dark_ms = began.elapsed().as_millis(),
            "shows again"
        );
        // Requests may wait, and bodies may have moved.
        again.links.shared.stir();
        Ok(Some(again))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attempts_are_bounded_and_wait_ever_longer() {
        let (mut attempts, now) = (Attempts::default(), Instant::now());
        let mut waits = || (0..8).map(|_| attempts.next(now).map(|wait| wait.as_millis())).collect::<Vec<_>>();
        let all = [Some(0), Some(250), Some(500), Some(1000), Some(2000), Some(4000), None, None];
        assert_eq!(waits(), all);
        attempts.showed();
        assert_eq!(attempts.next(now), Some(Duration::ZERO));
        assert_eq!(attempts.next(now + APART), Some(FIRST_WAIT));
        assert_eq!(attempts.next(now + APART * 3), Some(Duration::ZERO));
    }
}
