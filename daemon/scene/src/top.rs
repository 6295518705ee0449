//! The top level as the CPU walks it.

use obvhs::aabb::Aabb;

use crate::bvh::Bvh;

/// The structure over the instances that rays can meet.
#[derive(Clone, Debug, Default)]
pub(crate) struct Top {
    pub(crate) bvh: Bvh,
    /// What it was built over, relative to the origin, and the instance of each.
    pub(crate) boxes: Vec<Aabb>,
    pub(crate) instances: Vec<u32>,
}
