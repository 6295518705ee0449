//! Every shader with its binding table, reflected from its SPIR-V by `build.rs`.
#![allow(clippy::unreadable_literal, reason = "generated words")]

use lantern_gpu::{Binding, BindingKind, Shader, Stage};

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));
