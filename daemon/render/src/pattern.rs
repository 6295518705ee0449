//! Test patterns: what a projector shows instead of the scene while it is being set up.

/// A test pattern; the numbers are the `PATTERN_` constants of `shaders-glsl/include/pattern.glsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum Pattern {
    /// None: the scene.
    #[default]
    Off = 0,
    /// Lines every 64 px, a frame and a cross in the middle.
    Grid = 1,
    /// White everywhere.
    White = 2,
    /// Black everywhere.
    Black = 3,
    /// Squares of 64 px, white at the top left.
    Checker = 4,
    /// The projector's number, from 1 in the configuration's order.
    Identify = 5,
}
