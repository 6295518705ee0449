//! The bodies as frames show them: at the time at which their light leaves.

use std::cell::RefCell;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use glam::DVec3;
use lantern_config::Drives;
use lantern_render::{FrameReport, RenderError, Renderer};
use lantern_scene::{Editor, Place, Scene};
use lantern_tracking::{Bodies, Placed};

use super::lead::Lead;

/// A frame that was rendered.
pub struct Frame {
    /// What it cost.
    pub report: FrameReport,
    /// When its light was expected to leave.
    pub light: Instant,
    /// The bodies that it shows: eyes as they were read for it, those whose nodes stand in its revision, and those that carry
    /// projectors.
    pub placed: Vec<Placed>,
}

/// What is read of the bodies for a frame.
#[derive(Clone, Debug)]
struct Seen {
    light: Instant,
    placed: Vec<Placed>,
}

/// Reads the bodies for frames.
pub struct Sight {
    bodies: Arc<Bodies>,
    lead: Lead,
    /// Whether bodies have yet to move their nodes, because an edit in the making has the editor.
    behind: bool,
    /// Whether a body was predicted to move on by itself when that was last asked.
    moving: bool,
    /// The bodies that were last given nodes to move, and the revision in which these stand there.
    newest_nodes: (u64, Vec<Placed>),
    /// Those of the revision that is shown.
    shown_nodes: Vec<Placed>,
    /// The bodies that carry projectors, as these were last held.
    carrying: Vec<Placed>,
}

impl Sight {
    /// `output_latency` is what the slowest output takes from a frame's completion to its light.
    pub fn new(bodies: Arc<Bodies>, output_latency: Duration) -> Self {
        let lead = Lead::new(output_latency);
        Self {
            bodies,
            lead,
            behind: false,
            moving: false,
            newest_nodes: Default::default(),
            shown_nodes: Vec::new(),
            carrying: Vec::new(),
        }
    }

    /// Another time for the slowest output.
    pub fn set_output_latency(&mut self, output_latency: Duration) {
        self.lead.set_output_latency(output_latency);
    }

    /// Whether there is to be another look at the next refresh, though nobody has said anything: a node has yet to follow its
    /// body, or a body is predicted to move on. Once none is, one more frame shows where they rest.
    pub fn is_restless(&mut self, now: Instant) -> bool {
        let before = std::mem::replace(&mut self.moving, self.bodies.are_moving(now));
        before || self.moving || self.behind
    }

    /// Moves the nodes that bodies drive, and gives the revision in which they stand there. Where an edit in the making has the
    /// editor, the nodes follow at a later refresh.
    pub fn place_nodes(&mut self, editor: &Mutex<Editor>, began: Instant) -> Option<Arc<Scene>> {
        let mut placed = self.bodies.placed(self.lead.light_of_frame(began), began);
        placed.retain(|placed| place(placed).is_some());
        self.behind = false;
        if placed.is_empty() {
            self.newest_nodes.1.clear();
            return None;
        }
        let mut editor = match editor.try_lock() {
            Ok(editor) => editor,
            Err(std::sync::TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(std::sync::TryLockError::WouldBlock) => {
                self.behind = true;
                return None;
            }
        };
        let places: Vec<_> = placed.iter().filter_map(place).collect();
        let scene = editor.place_all(&places);
        self.newest_nodes = (scene.revision, placed);
        Some(scene)
    }

    /// The bodies that carry projectors, as they will be when the light of a frame that begins now leaves: as nodes are placed.
    pub fn carrying(&mut self, began: Instant) -> &[Placed] {
        let mut placed = self.bodies.placed(self.lead.light_of_frame(began), began);
        placed.retain(|placed| matches!(placed.drives, Drives::Projector(_)));
        self.carrying = placed;
        &self.carrying
    }

    /// No body carries a projector any more.
    pub fn carry_nothing(&mut self) {
        self.carrying.clear();
    }

    /// Renders what is stale, for the eyes as they will be when its light leaves.
    ///
    /// # Errors
    /// What the renderer says.
    pub fn render(&mut self, renderer: &mut Renderer, began: Instant) -> Result<Option<Frame>, RenderError> {
        // The renderer looks twice, and shows what it sees last.
        let seen = RefCell::new(Seen { light: began, placed: Vec::new() });
        let Some(report) = renderer.render(|| {
            let now = self.look();
            let eyes = eyes(&now.placed);
            *seen.borrow_mut() = now;
            eyes
        })?
        else {
            return Ok(None);
        };
        let Seen { light, mut placed } = seen.into_inner();

        if report.revision >= self.newest_nodes.0 {
            self.shown_nodes.clone_from(&self.newest_nodes.1);
        }
        placed.retain(|placed| placed.drives == Drives::Viewer);
        placed.extend(self.shown_nodes.iter().chain(&self.carrying).cloned());
        if let Some(completed) = report.projectors.iter().map(|p| p.completed).max() {
            self.lead.completed(began, report.read, completed);
        }
        Ok(Some(Frame { report, light, placed }))
    }

    /// Where the eyes are, world frame, m.
    pub fn eyes(&self) -> Vec<DVec3> {
        eyes(&self.look().placed)
    }

    /// The bodies as they will be when the light of what is submitted now leaves.
    fn look(&self) -> Seen {
        let now = Instant::now();
        let light = self.lead.light_of_submission(now);
        Seen { light, placed: self.bodies.placed(light, now) }
    }
}

/// Where a body holds its node, if it drives one.
fn place(placed: &Placed) -> Option<Place<'_>> {
    match &placed.drives {
        Drives::Node(node) => {
            Some(Place { node, translation_m: placed.pose.driven_m(), rotation: placed.pose.orientation })
        }
        Drives::Viewer | Drives::Projector(_) => None,
    }
}

fn eyes(placed: &[Placed]) -> Vec<DVec3> {
    let viewers = placed.iter().filter(|placed| placed.drives == Drives::Viewer);
    viewers.map(|placed| placed.pose.driven_m()).collect()
}
