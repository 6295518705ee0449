//! The only unsafe code: Vulkan objects as safe, named, reference-counted values.
