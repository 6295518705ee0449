//! Projectors that bodies carry.
//!
//! A projector's calibration holds where everything stood when it was made: the body that carries it at its `position_m`, unturned.
//! When the body is elsewhere, the projector is with it:
//!
//! ```text
//! clip_from_world = clip_from_home · home_from_body · body_from_world
//! ```

use std::collections::BTreeMap;

use glam::{DMat4, DVec3};
use lantern_config::Drives;
use lantern_render::ProjectorSpec;
use lantern_tracking::Placed;

/// The projectors as they were calibrated, and where the bodies stood that carry them.
#[derive(Clone, Debug)]
pub struct Carried {
    at_home: Vec<ProjectorSpec>,
    homes_m: BTreeMap<String, DVec3>,
}

impl Carried {
    /// `homes_m` says of each projector that is carried where its body stood.
    pub fn new(at_home: Vec<ProjectorSpec>, homes_m: BTreeMap<String, DVec3>) -> Self {
        Self { at_home, homes_m }
    }

    /// Whether any is.
    pub fn any(&self) -> bool {
        !self.homes_m.is_empty()
    }

    /// All projectors, in order, where these bodies hold those that they carry.
    pub fn at(&self, placed: &[Placed]) -> Vec<ProjectorSpec> {
        let carrying = |name: &str| {
            let home_m = self.homes_m.get(name)?;
            let carries = |p: &&Placed| matches!(&p.drives, Drives::Projector(projector) if projector == name);
            Some((home_m, placed.iter().find(carries)?))
        };
        let held = |home: &ProjectorSpec| match carrying(&home.name) {
            Some((home_m, placed)) => {
                let world_from_body =
                    DMat4::from_rotation_translation(placed.pose.orientation.normalize(), placed.pose.position_m);
                let home_from_world = DMat4::from_translation(*home_m) * world_from_body.inverse();
                ProjectorSpec { name: home.name.clone(), calibration: home.calibration.carried(home_from_world) }
            }
            None => home.clone(),
        };
        self.at_home.iter().map(held).collect()
    }
}
