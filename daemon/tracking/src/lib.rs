//! Trackers: UDP sources, bodies and their poses.
