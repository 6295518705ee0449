//! Every shader with its binding table, reflected from its SPIR-V by `build.rs`.
#![allow(clippy::unreadable_literal, reason = "generated words")]

use lantern_gpu::{Binding, BindingKind, Shader, Stage};

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));

/// The shader as a device runs it that traces by ray queries or by walking the scene's structures; the same for one that does not trace.
pub fn traced_by(shader: &'static Shader, ray_queries: bool) -> &'static Shader {
    let pair = BY_RAY_QUERY.iter().find(|(own, _)| ray_queries && std::ptr::eq(*own, shader));
    pair.map_or(shader, |(_, by_ray_query)| by_ray_query)
}
