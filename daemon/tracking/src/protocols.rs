//! The protocols that there are.

use crate::dtrack::Dtrack;
use crate::freed::Freed;
use crate::lantern::Lantern;
use crate::natnet::Natnet;
use crate::opentrack::Opentrack;
use crate::osc::Osc;
use crate::protocol::Protocol;
use crate::psn::Psn;
use lantern_config::Tracker;

/// What reads a tracker's datagrams.
pub(crate) fn new(tracker: &Tracker) -> Box<dyn Protocol> {
    match &tracker.protocol {
        lantern_config::Protocol::Lantern => Box::new(Lantern),
        lantern_config::Protocol::Osc(kind) => Box::new(Osc::new(kind.clone(), tracker.bodies.keys())),
        lantern_config::Protocol::Natnet(settings) => {
            Box::new(Natnet::new(settings, tracker.listen.ip().is_multicast()))
        }
        lantern_config::Protocol::Freed => Box::new(Freed),
        lantern_config::Protocol::Psn => Box::new(Psn::new(tracker.bodies.keys())),
        lantern_config::Protocol::Opentrack(settings) => Box::new(Opentrack { signs: settings.signs }),
        lantern_config::Protocol::Dtrack(settings) => Box::new(Dtrack::new(settings.axes, tracker.bodies.keys())),
    }
}
