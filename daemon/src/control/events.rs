//! Events for subscribers: told in passing by whoever makes them, kept in bounded queues, and written by each subscriber's
//! session. Nobody who tells ever waits; who reads too slowly loses events, and is told how many.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicIsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use lantern_proto::EventKind;
use lantern_proto::event::{Event, Lost};
use tokio::sync::Notify;

/// Events that wait for one subscriber: several seconds' worth of a busy daemon, and about a MiB.
const MAX_WAITING: usize = 2048;

/// How many kinds there are.
const KINDS: usize = EventKind::ALL.len();

/// All who tell and all who hear.
#[derive(Debug, Default)]
pub struct Events {
    /// How many want each kind.
    wanted: [AtomicIsize; KINDS],
    queues: Mutex<Vec<Arc<Queue>>>,
    /// Somebody has subscribed.
    subscribed: Notify,
}

/// What waits for one subscriber.
#[derive(Debug)]
struct Queue {
    kinds: [bool; KINDS],
    waiting: Mutex<Waiting>,
    more: Notify,
}

#[derive(Debug, Default)]
struct Waiting {
    events: VecDeque<Arc<Event>>,
    lost: u64,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Nothing that is done under these locks can leave it half done.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Events {
    /// Whether anybody wants to hear of a kind: where nobody does, none need be made.
    pub fn are_wanted(&self, kind: EventKind) -> bool {
        self.wanted[kind as usize].load(Ordering::Relaxed) > 0
    }

    /// Waits until somebody does. For one who waits.
    pub async fn wanted(&self, kind: EventKind) {
        while !self.are_wanted(kind) {
            self.subscribed.notified().await;
        }
    }

    /// Tells all who want to hear of it.
    pub fn tell(&self, kind: EventKind, event: Event) {
        let event = Arc::new(event);
        for queue in lock(&self.queues).iter().filter(|queue| queue.kinds[kind as usize]) {
            queue.push(event.clone());
        }
    }

    /// From now on, until it is dropped.
    pub fn subscribe(self: &Arc<Self>, kinds: &[EventKind]) -> Subscription {
        let mut wanted = [false; KINDS];
        kinds.iter().for_each(|kind| wanted[*kind as usize] = true);
        let queue = Arc::new(Queue { kinds: wanted, waiting: Mutex::default(), more: Notify::new() });
        lock(&self.queues).push(queue.clone());
        self.count(&queue, 1);
        self.subscribed.notify_one();
        Subscription { events: self.clone(), queue }
    }

    fn count(&self, queue: &Queue, change: isize) {
        for (count, _) in self.wanted.iter().zip(queue.kinds).filter(|(_, wanted)| *wanted) {
            count.fetch_add(change, Ordering::Relaxed);
        }
    }
}

impl Queue {
    fn push(&self, event: Arc<Event>) {
        let mut waiting = lock(&self.waiting);
        // What waits is told in order and whole. Once something is lost, so is what comes until all that waits is told: then the
        // word of it stands where it is missing.
        if waiting.events.len() < MAX_WAITING && waiting.lost == 0 {
            waiting.events.push_back(event);
        } else {
            waiting.lost += 1;
        }
        drop(waiting);
        self.more.notify_one();
    }

    fn pop(&self) -> Option<Arc<Event>> {
        let mut waiting = lock(&self.waiting);
        let event = waiting.events.pop_front();
        if event.is_none() && waiting.lost > 0 {
            let count = std::mem::take(&mut waiting.lost);
            return Some(Arc::new(Event::Lost(Lost { count })));
        }
        event
    }
}

/// One subscriber's place.
#[derive(Debug)]
pub struct Subscription {
    events: Arc<Events>,
    queue: Arc<Queue>,
}

impl Subscription {
    /// The next event. May be dropped while it waits; nothing is lost.
    pub async fn next(&self) -> Arc<Event> {
        loop {
            if let Some(event) = self.queue.pop() {
                return event;
            }
            self.queue.more.notified().await;
        }
    }
}

impl Drop for Subscription {
    fn drop(&mut self) {
        self.events.count(&self.queue, -1);
        lock(&self.events.queues).retain(|queue| !Arc::ptr_eq(queue, &self.queue));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lantern_proto::event::SceneEvent;

    fn scene(revision: u64) -> Event {
        Event::Scene(SceneEvent { revision, ..SceneEvent::default() })
    }

    #[tokio::test]
    async fn each_hears_what_it_wants_and_nothing_after_it_has_gone() {
        let events = Arc::new(Events::default());
        events.tell(EventKind::Scene, scene(1));
        let both = events.subscribe(&[EventKind::Scene, EventKind::Pose]);
        let poses = events.subscribe(&[EventKind::Pose]);
        events.tell(EventKind::Scene, scene(2));
        assert_eq!(*both.next().await, scene(2));
        assert!(poses.queue.pop().is_none());
        drop(both);
        assert!(!events.are_wanted(EventKind::Scene) && events.are_wanted(EventKind::Pose));
        drop(poses);
        assert!(lock(&events.queues).is_empty() && !events.are_wanted(EventKind::Pose));
    }

    #[tokio::test]
    async fn who_reads_too_slowly_loses_the_newest_and_is_told() {
        let events = Arc::new(Events::default());
        let (slow, quick) = (events.subscribe(&[EventKind::Scene]), events.subscribe(&[EventKind::Scene]));
        let told = MAX_WAITING as u64 + 7;
        for revision in 0..told {
            events.tell(EventKind::Scene, scene(revision));
            assert_eq!(*quick.next().await, scene(revision));
        }
        for revision in 0..MAX_WAITING as u64 {
            assert_eq!(*slow.next().await, scene(revision));
            if revision == 5 {
                // There is room for it, and it is newer than what is missing.
                events.tell(EventKind::Scene, scene(told));
            }
        }
        assert_eq!(*slow.next().await, Event::Lost(Lost { count: 8 }));
        events.tell(EventKind::Scene, scene(told));
        assert_eq!(*slow.next().await, scene(told));
    }
}
