//! Pictures on their way to one client: which of its images it holds, and what it has yet to be told.
//!
//! Each client has images of its own, so that none can hold up another, nor see or spoil what another sees. The frame thread writes
//! to images that the client does not hold; it never waits for one.

use std::collections::VecDeque;
use std::os::fd::OwnedFd;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use lantern_proto::event::{ExportEnd, ExportEvent};
use lantern_proto::{Event, ExportOpened};
use tokio::sync::Notify;

/// Images of one client: one that it reads, one that it is being told of, one that is being written.
pub const IMAGES: usize = 3;

/// Wakes the frame thread.
pub type Wake = Arc<dyn Fn() + Send + Sync>;

/// What a client gets that opens an export.
pub struct Lent {
    /// What it is told.
    pub opened: ExportOpened,
    /// What comes with that.
    pub descriptors: Vec<OwnedFd>,
    /// Its end of the pictures.
    pub reader: Reader,
}

/// What both sides know.
#[derive(Default)]
struct State {
    held: [bool; IMAGES],
    /// At most one for each image that is held, and the end.
    told: VecDeque<Event>,
    /// Pictures since the last that was told for which no image was free.
    missed: u64,
    /// The client has gone.
    is_closed: bool,
    /// There will be no more pictures.
    has_ended: bool,
}

/// One client's images.
pub struct Feed {
    state: Mutex<State>,
    more: Notify,
    wake: Wake,
}

impl Feed {
    /// With nothing in them, and the client's end of it.
    pub fn new(wake: Wake) -> (Arc<Self>, Reader) {
        let feed = Arc::new(Self { state: Mutex::default(), more: Notify::new(), wake });
        (feed.clone(), Reader(feed))
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // Nothing that is done under the lock can leave it half done.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// An image that the client does not hold. Where it holds all, it misses a picture.
    pub fn free(&self) -> Option<usize> {
        let mut state = self.lock();
        let free = state.held.iter().position(|held| !held);
        state.missed += u64::from(free.is_none());
        free
    }

    /// Whether the client has missed the newest picture and has room for it now.
    pub fn wants_newest(&self) -> bool {
        let state = self.lock();
        state.missed > 0 && state.held.contains(&false)
    }

    /// Tells of a picture in an image, which is the client's from now on.
    pub fn tell(&self, mut event: ExportEvent) {
        let mut state = self.lock();
        state.held[event.image] = true;
        event.missed = std::mem::take(&mut state.missed);
        state.told.push_back(Event::Export(event));
        drop(state);
        self.more.notify_one();
    }

    /// Tells that there will be no more.
    pub fn end(&self, end: ExportEnd) {
        let mut state = self.lock();
        if !std::mem::replace(&mut state.has_ended, true) {
            state.told.push_back(Event::ExportEnd(end));
        }
        drop(state);
        self.more.notify_one();
    }

    /// Whether the client has gone.
    pub fn is_closed(&self) -> bool {
        self.lock().is_closed
    }
}

/// The client's end. Dropped, it gives everything back.
pub struct Reader(Arc<Feed>);

impl Reader {
    /// The next event. May be dropped while it waits; nothing is lost.
    pub async fn next(&self) -> Event {
        loop {
            if let Some(event) = self.0.lock().told.pop_front() {
                return event;
            }
            self.0.more.notified().await;
        }
    }

    /// Gives an image back; false where the client does not hold it.
    pub fn release(&self, image: usize) -> bool {
        let mut state = self.0.lock();
        // What it was not told of yet it cannot have read.
        let is_told = !state.told.iter().any(|event| matches!(event, Event::Export(of) if of.image == image));
        let held = is_told && state.held.get_mut(image).is_some_and(std::mem::take);
        let wake = held && state.missed > 0;
        drop(state);
        if wake {
            (self.0.wake)();
        }
        held
    }

    /// Whether there will be no more pictures.
    pub fn has_ended(&self) -> bool {
        self.0.lock().has_ended
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        self.0.lock().is_closed = true;
        (self.0.wake)();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};

    fn picture(image: usize) -> ExportEvent {
        ExportEvent { image, ..ExportEvent::default() }
    }

    #[tokio::test]
    async fn a_client_that_holds_all_misses_pictures_and_gets_the_newest_when_it_releases() {
        let woken = Arc::new(AtomicU32::new(0));
        let of_wake = woken.clone();
        let (feed, reader) = Feed::new(Arc::new(move || {
            of_wake.fetch_add(1, Ordering::Relaxed);
        }));
        for image in 0..IMAGES {
            assert_eq!(feed.free(), Some(image));
            feed.tell(picture(image));
        }
        assert!(!reader.release(0), "it has not heard of it");
        for image in 0..IMAGES {
            assert_eq!(reader.next().await, Event::Export(picture(image)));
        }
        assert_eq!((feed.free(), feed.free(), feed.wants_newest()), (None, None, false));
        assert!(reader.release(1) && !reader.release(1) && !reader.release(IMAGES));
        assert_eq!((woken.load(Ordering::Relaxed), feed.wants_newest(), feed.free()), (1, true, Some(1)));
        feed.tell(picture(1));
        assert_eq!(reader.next().await, Event::Export(ExportEvent { missed: 2, ..picture(1) }));
        drop(reader);
        assert!(feed.is_closed() && woken.load(Ordering::Relaxed) == 2);
    }

    #[tokio::test]
    async fn the_end_is_told_once_and_last() {
        let (feed, reader) = Feed::new(Arc::new(|| {}));
        let end = ExportEnd { projector: "left".into(), detail: "it went".into() };
        feed.tell(picture(0));
        feed.end(end.clone());
        feed.end(end.clone());
        assert_eq!(reader.next().await, Event::Export(picture(0)));
        assert_eq!(reader.next().await, Event::ExportEnd(end));
        assert!(reader.has_ended() && feed.lock().told.is_empty());
    }
}
