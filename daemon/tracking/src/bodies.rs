//! The bodies and their latest poses, shared by those who hear and those who render.

use crate::pose::{BodyPose, MAX_DISTANCE_M, SOURCE_CONFIG, Update, is_place};
use crate::predict::Predictor;
use crate::protocol::NORM_TOLERANCE;
use glam::{DQuat, DVec3};
use lantern_config::{Body, Drives};
use lantern_proto::status::BodyStatus;
use std::collections::BTreeMap;
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Called after a body that drives something, or the configuration, has changed, on the thread that changed it; it must not wait for anything.
type Waker = Arc<dyn Fn() + Send + Sync>;

/// Called with every pose that differs from the one before, after the waker and under the same terms.
type Listener = Arc<dyn Fn(&str, &BodyPose) + Send + Sync>;

/// A pose that was refused; nothing has changed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PoseError {
    /// No such body.
    #[error("there is no body `{body}`; hint: {}", hint(.known))]
    UnknownBody {
        /// What was asked for.
        body: String,
        /// The bodies there are.
        known: Vec<String>,
    },
    /// A position that is no place.
    #[error("position {position_m} is not finite or beyond {MAX_DISTANCE_M:e} m; hint: give metres in the world frame")]
    Position {
        /// What was given.
        position_m: DVec3,
    },
    /// An orientation that is no rotation.
    #[error("orientation has norm {norm}; hint: give a unit quaternion x, y, z, w")]
    Orientation {
        /// What was given.
        norm: f64,
    },
}

fn hint(known: &[String]) -> String {
    match known {
        [] => "add it to the configuration as a [[body]]".to_owned(),
        _ => format!("there are {}", known.join(", ")),
    }
}

struct Entry {
    drives: Option<Drives>,
    /// As it was said last.
    pose: BodyPose,
    /// Where its tracker's poses are to be predicted.
    predictor: Option<Predictor>,
}

/// A body that drives something, where it will be at the time that was asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// Its name.
    pub body: String,
    /// What it drives.
    pub drives: Drives,
    /// Position and orientation as predicted, where they are; everything else is of the pose that was said last.
    pub pose: BodyPose,
    /// How far ahead of what was last measured that is. Of a body at rest that its tracker goes on seeing as well: that it stays
    /// is a prediction, though the pose is the said one. `None` where nothing is predicted, and of a body that has been silent for
    /// so long that its prediction has faded: it is shown as of then.
    pub ahead: Option<Duration>,
}

/// All bodies of the configuration, by name.
pub struct Bodies {
    entries: Mutex<BTreeMap<String, Entry>>,
    generation: AtomicU64,
    waker: Mutex<Option<Waker>>,
    listener: Mutex<Option<Listener>>,
}

impl fmt::Debug for Bodies {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Bodies").field("generation", &self.generation()).finish_non_exhaustive()
    }
}

impl Bodies {
    /// Each body where the configuration has it.
    pub fn new(bodies: &[Body]) -> Self {
        let this = Self {
            entries: Mutex::default(),
            generation: AtomicU64::new(0),
            waker: Mutex::default(),
            listener: Mutex::default(),
        };
        this.configure(bodies);
        this
    }

    /// Takes another configuration over: bodies that it does not have go, those that are new stand where it says, and
    /// those that a source has placed already stay there.
    pub fn configure(&self, bodies: &[Body]) {
        let now = Instant::now();
        let mut entries = self.lock();
        let mut old = std::mem::take(&mut *entries);
        *entries = bodies.iter().map(|body| (body.name.clone(), entry(body, old.remove(&body.name), now))).collect();
        drop(entries);
        self.changed(true);
    }

    /// Calls `waker` after every change of what bodies drive from now on, instead of the one before.
    pub fn set_waker(&self, waker: Waker) {
        *self.waker.lock().unwrap_or_else(PoisonError::into_inner) = Some(waker);
    }

    /// Tells `listener` of every pose that is new from now on, instead of the one before.
    pub fn set_listener(&self, listener: Listener) {
        *self.listener.lock().unwrap_or_else(PoisonError::into_inner) = Some(listener);
    }

    /// Grows with each change of any pose; equal numbers mean equal poses.
    pub fn generation(&self) -> u64 {
        self.generation.load(Ordering::Acquire)
    }

    /// A body's latest pose.
    pub fn get(&self, body: &str) -> Option<BodyPose> {
        self.lock().get(body).map(|entry| entry.pose.clone())
    }

    /// The bodies that drive something, all of the same moment, in the order of their names: where they will be at `time`, as
    /// far as that is known `now`.
    pub fn placed(&self, time: Instant, now: Instant) -> Vec<Placed> {
        let placed = |(body, entry): (&String, &Entry)| {
            let (pose, ahead) = match &entry.predictor {
                Some(predictor) => predictor.at(&entry.pose, time, now),
                None => (entry.pose.clone(), None),
            };
            Some(Placed { body: body.clone(), drives: entry.drives.clone()?, pose, ahead })
        };
        self.lock().iter().filter_map(placed).collect()
    }

    /// Whether something that is driven moves on by itself, because it is predicted, if nothing more is heard.
    pub fn are_moving(&self, now: Instant) -> bool {
        let driven = |entry: &&Entry| entry.drives.is_some();
        self.lock().values().filter(driven).filter_map(Entry::moves_until).any(|until| now < until)
    }

    /// The viewer's eye in the world, m; `None` where no body drives it.
    pub fn eye_m(&self) -> Option<DVec3> {
        self.lock().values().find(|entry| entry.drives == Some(Drives::Viewer)).map(|entry| entry.pose.driven_m())
    }

    /// Places a body, as if a tracker had said it. `orientation` is world from body; without it, it stays.
    ///
    /// # Errors
    /// [`PoseError`]: an unknown body, a position that is not finite or beyond 10⁸ m, an orientation whose norm is off by
    /// more than 1 %.
    pub fn set_pose(
        &self,
        body: &str,
        position_m: DVec3,
        orientation: Option<DQuat>,
        source: &str,
    ) -> Result<(), PoseError> {
        if !is_place(position_m) {
            return Err(PoseError::Position { position_m });
        }
        if let Some(norm) = orientation.map(DQuat::length)
            && (!norm.is_finite() || (norm - 1.0).abs() > NORM_TOLERANCE)
        {
            return Err(PoseError::Orientation { norm });
        }
        let orientation = orientation.map(DQuat::normalize);
        let update = Update { position_m: Some(position_m), orientation, ..Update::default() };
        if self.apply(body, &update, &Arc::from(source), Instant::now()) {
            return Ok(());
        }
        Err(PoseError::UnknownBody { body: body.to_owned(), known: self.lock().keys().cloned().collect() })
    }

    /// Takes what a source says; false if there is no such body. The values have been checked.
    pub(crate) fn apply(&self, body: &str, update: &Update, source: &Arc<str>, received: Instant) -> bool {
        let mut entries = self.lock();
        let Some(entry) = entries.get_mut(body) else { return false };
        // A tracker that has lost the body says so by neither: the last pose stays, and shows its age.
        if update.position_m.is_none() && update.orientation.is_none() {
            return true;
        }
        let moved_until = entry.moves_until();
        entry.predict(update, source, received);
        let pose = &mut entry.pose;
        let before = (pose.position_m, pose.orientation, pose.velocity_m_s);
        pose.position_m = update.position_m.unwrap_or(pose.position_m);
        pose.orientation = update.orientation.unwrap_or(pose.orientation);
        pose.velocity_m_s = update.velocity_m_s.or(pose.velocity_m_s);
        pose.source = source.clone();
        pose.received = received;
        pose.sequence = update.sequence;
        pose.measured_ns = update.measured_ns;
        pose.measured = update.timing.measured;
        let same = before == (pose.position_m, pose.orientation, pose.velocity_m_s);
        // Whoever shows a body that moves by itself is awake as long as it did before, and has to hear if it goes on.
        let goes_on = entry.moves_until().is_some() && moved_until.is_none_or(|until| until <= received);
        let pose = (!same).then(|| entry.pose.clone());
        let is_driven = entry.drives.is_some();
        drop(entries);

        // A tracker that says the same again, of a body at rest, wakes nobody, nor does a body that drives nothing: nothing has to
        // be rendered anew.
        if !same || goes_on {
            self.changed(is_driven);
        }
        let listener = self.listener.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let (Some(pose), Some(listener)) = (pose, listener) {
            listener(body, &pose);
        }
        true
    }

    /// For `status`.
    pub fn status(&self) -> BTreeMap<String, BodyStatus> {
        let now = Instant::now();
        let status = |pose: &BodyPose| BodyStatus {
            position_m: pose.position_m.to_array(),
            orientation: pose.orientation.to_array(),
            source: pose.source.to_string(),
            age_ms: now.saturating_duration_since(pose.received).as_secs_f64() * 1e3,
        };
        self.lock().iter().map(|(name, entry)| (name.clone(), status(&entry.pose))).collect()
    }

    fn lock(&self) -> MutexGuard<'_, BTreeMap<String, Entry>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a change, and wakes whoever renders where that has to be shown.
    fn changed(&self, is_shown: bool) {
        self.generation.fetch_add(1, Ordering::AcqRel);
        let waker = self.waker.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(waker) = waker.filter(|_| is_shown) {
            waker();
        }
    }
}

impl Entry {
    /// Lets the prediction hear of an update, or ends it where the source of that does not want any.
    fn predict(&mut self, update: &Update, source: &Arc<str>, received: Instant) {
        let Some(lead) = update.timing.predict_lead else {
            self.predictor = None;
            return;
        };
        // What another source has said is no part of this one's motion.
        let predictor = self.predictor.take().filter(|_| self.pose.source == *source).unwrap_or_default();
        let oldest = received.checked_sub(lead).unwrap_or(received);
        self.predictor.insert(predictor).hear(update, update.timing.measured.unwrap_or(oldest), received);
    }

    /// Until when it moves by itself, if nothing more is heard; `None` where it does not.
    fn moves_until(&self) -> Option<Instant> {
        self.predictor.as_ref().and_then(Predictor::changes_until)
    }
}

fn entry(body: &Body, old: Option<Entry>, now: Instant) -> Entry {
    let offset_m = DVec3::from_array(body.offset_m);
    let placed = old.filter(|old| old.pose.is_heard());
    if let Some(Entry { pose, predictor, .. }) = placed {
        return Entry { drives: body.drives.clone(), pose: BodyPose { offset_m, ..pose }, predictor };
    }
    let pose = BodyPose {
        position_m: DVec3::from_array(body.position_m),
        orientation: DQuat::IDENTITY,
        velocity_m_s: None,
        offset_m,
        source: Arc::from(SOURCE_CONFIG),
        received: now,
        sequence: None,
        measured_ns: None,
        measured: None,
    };
    Entry { drives: body.drives.clone(), pose, predictor: None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::Timing;
    use std::f64::consts::FRAC_1_SQRT_2;
    use std::sync::atomic::AtomicUsize;

    fn body(name: &str, drives: Option<Drives>) -> Body {
        Body { name: name.into(), drives, position_m: [0.0, 1.7, 2.5], offset_m: [0.0, 0.0, -0.1] }
    }

    fn two() -> Bodies {
        Bodies::new(&[body("head", Some(Drives::Viewer)), body("car", Some(Drives::Node("car".into())))])
    }

    #[test]
    fn stands_where_the_configuration_says_until_anyone_speaks() {
        let bodies = two();
        let head = bodies.get("head").unwrap();
        assert_eq!((&*head.source, head.position_m), ("config", DVec3::new(0.0, 1.7, 2.5)));
        assert_eq!(bodies.eye_m(), Some(DVec3::new(0.0, 1.7, 2.4)));
        assert_eq!(bodies.get("hat"), None);
        assert_eq!(Bodies::new(&[body("car", None)]).eye_m(), None);
        let now = Instant::now();
        let placed: Vec<_> = bodies.placed(now, now).into_iter().map(|p| (p.body, p.drives, p.ahead)).collect();
        let driven = [("car".to_owned(), Drives::Node("car".into()), None), ("head".to_owned(), Drives::Viewer, None)];
        assert_eq!(placed, driven);
    }

    #[test]
    fn the_offset_turns_with_the_body() {
        let bodies = two();
        // A quarter turn to the left about +Y: what was ahead (-Z) is now at -X.
        let left = DQuat::from_xyzw(0.0, FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2);
        bodies.set_pose("head", DVec3::ZERO, Some(left), "socket").unwrap();
        assert!((bodies.eye_m().unwrap() - DVec3::new(-0.1, 0.0, 0.0)).length() < 1e-12);
        assert_eq!(&*bodies.get("head").unwrap().source, "socket");
        // Without an orientation it stays as it was.
        bodies.set_pose("head", DVec3::Y, None, "socket").unwrap();
        assert!((bodies.eye_m().unwrap() - DVec3::new(-0.1, 1.0, 0.0)).length() < 1e-12);
    }

    #[test]
    fn changes_wake_and_repetitions_do_not() {
        let bodies = two();
        let woken = Arc::new(AtomicUsize::new(0));
        let count = woken.clone();
        bodies.set_waker(Arc::new(move || {
            count.fetch_add(1, Ordering::SeqCst);
        }));
        let start = bodies.generation();
        bodies.set_pose("head", DVec3::X, None, "socket").unwrap();
        bodies.set_pose("head", DVec3::X, None, "socket").unwrap();
        assert_eq!((woken.load(Ordering::SeqCst), bodies.generation()), (1, start + 1));
        bodies.set_pose("car", DVec3::X, None, "socket").unwrap();
        assert_eq!((woken.load(Ordering::SeqCst), bodies.generation()), (2, start + 2));
    }

    #[test]
    fn bodies_that_drive_nothing_wake_nobody() {
        let bodies = Bodies::new(&[body("head", Some(Drives::Viewer)), body("wand", None)]);
        let (woken, told) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
        let (wakes, tells) = (woken.clone(), told.clone());
        bodies.set_waker(Arc::new(move || {
            wakes.fetch_add(1, Ordering::SeqCst);
        }));
        bodies.set_listener(Arc::new(move |_, _| {
            tells.fetch_add(1, Ordering::SeqCst);
        }));
        let start = bodies.generation();
        bodies.set_pose("wand", DVec3::X, None, "socket").unwrap();
        // No frame is rendered for it; its pose is new all the same, and told.
        let counts = || (woken.load(Ordering::SeqCst), told.load(Ordering::SeqCst), bodies.generation() - start);
        assert_eq!(counts(), (0, 1, 1));
        bodies.set_pose("head", DVec3::X, None, "socket").unwrap();
        assert_eq!(counts(), (1, 2, 2));
    }

    #[test]
    fn only_what_is_predicted_moves_on_until_it_rests() {
        let bodies = two();
        let (source, start) = (Arc::from("optitrack"), Instant::now());
        let at = |ms: u64| start + Duration::from_millis(ms);
        let say = |x: f64, ms: u64, predict_lead| {
            let timing = Timing { measured: Some(at(ms)), predict_lead, ..Timing::default() };
            let update = Update { position_m: Some(DVec3::X * x), timing, ..Update::default() };
            bodies.apply("head", &update, &source, at(ms));
            bodies.generation()
        };
        let head = |ms: u64| bodies.placed(at(ms + 50), at(ms)).pop().unwrap();
        for step in 0..100 {
            say(f64::from(step) / 100.0, u64::from(step as u32) * 10, None);
        }
        assert_eq!((head(990).pose.position_m.x, head(990).ahead, bodies.are_moving(at(990))), (0.99, None, false));

        // The same, predicted: 1 m/s.
        for step in 0..100 {
            say(f64::from(step) / 100.0, 1000 + step as u64 * 10, Some(Duration::ZERO));
        }
        let placed = head(1995);
        assert!((placed.pose.position_m.x - 1.045).abs() < 4e-3, "{placed:?}");
        assert_eq!(placed.ahead, Some(Duration::from_millis(55)));
        assert!(bodies.are_moving(at(2100)) && !bodies.are_moving(at(3000)));
        // Silent for longer than predictions fade, it is shown where it was said to be: as of then, and not ahead.
        assert_eq!((head(3000).pose.position_m.x, head(3000).ahead), (0.99, None));
        assert!(head(1990 + 499).ahead.is_some() && head(1990 + 500).ahead.is_none());

        // It is heard again where it was: nobody is woken, then or later.
        let before = bodies.generation();
        for ms in [3000, 3010, 3020] {
            assert_eq!(say(0.99, ms, Some(Duration::ZERO)), before);
        }
        assert!(!bodies.are_moving(at(3021)));
        // That it rests is a prediction as well.
        assert!(head(3021).ahead.is_some());
        // The socket's word is taken as it is.
        say(2.0, 3030, Some(Duration::ZERO));
        say(3.0, 3040, Some(Duration::ZERO));
        bodies.set_pose("head", DVec3::Y, None, "socket").unwrap();
        assert_eq!((head(3041).pose.position_m, bodies.are_moving(at(3041))), (DVec3::Y, false));
    }

    #[test]
    fn what_is_no_pose_is_refused_and_changes_nothing() {
        let bodies = two();
        let (before, generation) = (bodies.get("head"), bodies.generation());
        let place = |x| bodies.set_pose("head", DVec3::new(x, 0.0, 0.0), None, "socket");
        for x in [f64::NAN, f64::INFINITY, 1e9, -1e300] {
            assert!(matches!(place(x), Err(PoseError::Position { .. })), "{x}");
        }
        for w in [f64::NAN, f64::INFINITY, 0.0, 1.02] {
            let turned = bodies.set_pose("head", DVec3::ZERO, Some(DQuat::from_xyzw(0.0, 0.0, 0.0, w)), "socket");
            assert!(matches!(turned, Err(PoseError::Orientation { .. })), "{w}");
        }
        let unknown = bodies.set_pose("hat", DVec3::ZERO, None, "socket").unwrap_err();
        assert_eq!(unknown.to_string(), "there is no body `hat`; hint: there are car, head");
        assert_eq!((bodies.get("head"), bodies.generation()), (before, generation));
    }

    #[test]
    fn another_configuration_keeps_what_sources_said() {
        let bodies = two();
        bodies.set_pose("head", DVec3::X, None, "socket").unwrap();
        let moved = Body { offset_m: [0.0; 3], position_m: [9.0; 3], ..body("head", Some(Drives::Viewer)) };
        bodies.configure(&[moved, body("hand", None)]);
        assert_eq!(bodies.eye_m(), Some(DVec3::X));
        assert_eq!(bodies.get("car"), None);
        assert_eq!(bodies.get("hand").unwrap().position_m, DVec3::new(0.0, 1.7, 2.5));
        // A body that nobody has placed follows the configuration.
        let hand = Body { position_m: [1.0; 3], ..body("hand", None) };
        bodies.configure(&[hand]);
        assert_eq!(bodies.get("hand").unwrap().position_m, DVec3::ONE);
    }
}
