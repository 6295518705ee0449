//! Every shader with its binding table, reflected from its SPIR-V by `build.rs`.
#![allow(clippy::unreadable_literal, reason = "generated words")]

use lantern_gpu::{Binding, BindingKind, Shader, Stage};

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));

/// The shader that reads the scene through storage buffers, and traces by ray queries where these are wanted; the same one, where it
/// does neither.
pub(crate) fn by_storage(shader: &'static Shader, ray_queries: bool) -> &'static Shader {
    let of = |pairs: &[(&'static Shader, &'static Shader)]| {
        pairs.iter().find(|(own, _)| std::ptr::eq(*own, shader)).map(|(_, other)| *other)
    };
    let by_ray_query = if ray_queries { of(BY_RAY_QUERY) } else { None };
    by_ray_query.or_else(|| of(BY_STORAGE)).unwrap_or(shader)
}

/// The most storage buffers that one of them binds.
pub(crate) fn most_storage_buffers() -> u32 {
    let count =
        |shader: &Shader| shader.bindings.iter().filter(|b| b.kind == BindingKind::StorageBuffer).count() as u32;
    BY_STORAGE.iter().chain(BY_RAY_QUERY).map(|(_, shader)| count(shader)).max().unwrap_or(0)
}
