//! Where an image goes, and when it is due.

mod headless;

pub use headless::Headless;
