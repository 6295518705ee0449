//! The scene: glTF, materials, instances, edits and acceleration structures.
