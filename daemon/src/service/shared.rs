//! What other threads ask of the frame thread, and how they wake it.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Instant;

use lantern_proto::ExportHandle;
use lantern_render::{Layer, LayerImage, Pattern};
use lantern_scene::Scene;

use super::frames::Setup;
use super::refusal::Refusal;
use crate::feed::Lent;
use crate::output::LendError;

/// Requests that may wait; one more is refused.
const MAX_REQUESTS: usize = 64;

/// A request to the frame thread; it is served between two frames, after everything that was acknowledged before it is shown.
pub enum Request {
    /// A layer of a projector's picture.
    Read {
        /// Its name: its number may be another's by the time that the request is served.
        projector: String,
        /// Which layer.
        layer: Layer,
        /// Where the answer goes.
        reply: SyncSender<Result<LayerImage, Refusal>>,
    },
    /// What the viewer sees of the lit props, in a projector's resolution.
    Room {
        /// Its name.
        projector: String,
        /// Where the answer goes.
        reply: SyncSender<Result<LayerImage, Refusal>>,
    },
    /// A test pattern instead of the scene, or the scene again.
    Pattern {
        /// On one projector, by its name, or on all.
        projector: Option<String>,
        /// Which.
        pattern: Pattern,
        /// Where the answer goes, once it is shown.
        reply: SyncSender<Result<(), Refusal>>,
    },
    /// What a scene holds, brought to the device beside the frames, ahead of a revision made of it.
    Prepare {
        /// The scene, of no revision that is published.
        scene: Arc<Scene>,
        /// Where nobody holds it any more, what was brought need not stay for its sake.
        lease: Weak<Lease>,
        /// Where the answer goes, once everything is there.
        reply: SyncSender<Result<(), Refusal>>,
    },
    /// Images of its own for a client that wants a projector's pictures.
    Lend {
        /// Its name.
        projector: String,
        /// What they are to be passed as.
        handle: ExportHandle,
        /// Where the answer goes.
        reply: SyncSender<Result<Result<Lent, LendError>, Refusal>>,
    },
    /// Other projectors or settings.
    Reconfigure {
        /// All of them.
        setup: Box<Setup>,
        /// Where the answer goes.
        reply: SyncSender<Result<(), Refusal>>,
    },
}

/// Held by whoever had a scene prepared, until a revision made of it is shown or refused.
pub struct Lease(Arc<Shared>);

impl Drop for Lease {
    fn drop(&mut self) {
        self.0.stir();
    }
}

/// Somebody who waits for a revision to be shown.
struct Waiter {
    revision: u64,
    reply: SyncSender<Result<u64, Refusal>>,
}

struct Inner {
    scene: Arc<Scene>,
    waiters: Vec<Waiter>,
    requests: VecDeque<Request>,
    stirred: bool,
    stop: bool,
}

/// What the frame thread finds when it wakes.
pub struct Turn {
    /// The newest revision.
    pub scene: Arc<Scene>,
    /// What was asked.
    pub requests: VecDeque<Request>,
    /// Whether to end.
    pub stop: bool,
}

/// The meeting place. No lock is held for longer than it takes to move a few pointers.
pub struct Shared {
    inner: Mutex<Inner>,
    wake: Condvar,
}

impl Shared {
    /// With the first revision.
    pub fn new(scene: Arc<Scene>) -> Arc<Self> {
        let inner = Inner { scene, waiters: Vec::new(), requests: VecDeque::new(), stirred: true, stop: false };
        Arc::new(Self { inner: Mutex::new(inner), wake: Condvar::new() })
    }

    /// For [`Request::Prepare`].
    pub fn lease(self: &Arc<Self>) -> Arc<Lease> {
        Arc::new(Lease(self.clone()))
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        // Nothing that is done under the lock can leave it half done.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Something that a frame may show has changed.
    pub fn stir(&self) {
        self.lock().stirred = true;
        self.wake.notify_all();
    }

    /// Ends the frame thread after what it does now. Whoever waits for it, or will, hears that nobody answers any more.
    pub fn stop(&self) {
        let mut inner = self.lock();
        inner.stop = true;
        inner.waiters.clear();
        inner.requests.clear();
        drop(inner);
        self.wake.notify_all();
    }

    /// Whether it was told to stop.
    pub fn stopping(&self) -> bool {
        self.lock().stop
    }

    /// Publishes a revision, if it is newer than the one there. The receiver gets the number of the first frame that shows it.
    pub fn publish(&self, scene: Arc<Scene>) -> Receiver<Result<u64, Refusal>> {
        let (reply, shown) = sync_channel(1);
        let mut inner = self.lock();
        if inner.stop {
            return shown;
        }
        inner.waiters.push(Waiter { revision: scene.revision, reply });
        if scene.revision > inner.scene.revision {
            inner.scene = scene;
        }
        inner.stirred = true;
        drop(inner);
        self.wake.notify_all();
        shown
    }

    /// Publishes a revision that the frame thread has made itself, and so need not be told of.
    pub fn publish_shown(&self, scene: &Arc<Scene>) {
        let mut inner = self.lock();
        if scene.revision > inner.scene.revision {
            inner.scene = scene.clone();
        }
    }

    /// Queues a request; false where too many wait already.
    pub fn request(&self, request: Request) -> bool {
        let mut inner = self.lock();
        if inner.requests.len() >= MAX_REQUESTS || inner.stop {
            return false;
        }
        inner.requests.push_back(request);
        inner.stirred = true;
        drop(inner);
        self.wake.notify_all();
        true
    }

    /// The frame thread sleeps here until something changes, or until `until`.
    pub fn wait(&self, until: Option<Instant>) -> Turn {
        let mut inner = self.lock();
        while !inner.stirred && !inner.stop {
            inner = match until {
                None => self.wake.wait(inner).unwrap_or_else(PoisonError::into_inner),
                Some(until) => {
                    let left = until.saturating_duration_since(Instant::now());
                    if left.is_zero() {
                        break;
                    }
                    self.wake.wait_timeout(inner, left).unwrap_or_else(PoisonError::into_inner).0
                }
            };
        }
        inner.stirred = false;
        Turn { scene: inner.scene.clone(), requests: std::mem::take(&mut inner.requests), stop: inner.stop }
    }

    /// Sleeps until `until` or the end.
    pub fn pause(&self, until: Instant) {
        let mut inner = self.lock();
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() || inner.stop {
                return;
            }
            inner = self.wake.wait_timeout(inner, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// The newest revision, which a frame that begins now takes.
    pub fn newest(&self) -> Arc<Scene> {
        self.lock().scene.clone()
    }

    /// Tells those who wait that `revision` is shown since `frame`, or why it cannot be; false where nobody waits.
    pub fn shown(&self, revision: u64, frame: Result<u64, Refusal>) -> bool {
        let mut inner = self.lock();
        let waiters = std::mem::take(&mut inner.waiters);
        let (done, waiting): (Vec<_>, Vec<_>) = waiters.into_iter().partition(|w| w.revision <= revision);
        inner.waiters = waiting;
        drop(inner);
        for waiter in &done {
            // Nobody may be there any more to hear it.
            let _ = waiter.reply.send(frame.clone());
        }
        !done.is_empty()
    }
}
