//! Lanternd, the render daemon, and lanternctl, the operator's hand.
