// What one frame of one projector knows; twin of daemon/render/src/frame.rs.
#ifndef FRAME_GLSL
#define FRAME_GLSL

// Homogeneous corners of the frustum as an affine map of the pixel, relative to the scene's origin; twin of
// daemon/calibration/src/frustum.rs, where its arithmetic is derived.
struct GpuFrustum {
    vec4 near_00;
    vec4 near_dx;
    vec4 near_dy;
    vec4 far_00;
    vec4 far_dx;
    vec4 far_dy;
    vec4 clip_x;
    vec4 clip_y;
    vec4 clip_w;
    vec4 depth_row;
    vec2 resolution_px;
    float z_base;
    float y_sign;
};

const uint MAX_VIEWERS = 4u;

layout(std140, binding = 12) uniform Frame {
    GpuFrustum frustum;
    vec4 irradiance[9];        // spherical harmonics of what a white diffuse surface shows
    vec4 viewers[MAX_VIEWERS]; // eyes, m, relative to the origin
} frame;

// What decides where a shader goes.
struct GpuSetup {
    uvec2 environment_px;     // level 0
    uint viewer_count;
    uint light_count;
    uint samples;             // n² a pixel
    uint strata;              // n
    uint max_depth;           // secondary rays deep
    uint tlas_node_count;     // 0: nothing can be hit
    uint virtual_count;       // instances of role virtual that are visible
    uint projector_count;     // rows of Projectors
    uint projector_index;     // this one's row
    uint blend;               // 0: every weight is 1
    uint planes_a_group;      // sample planes that a buffer of hits holds
    uint shade_once;          // 0: every sample of every pixel is shaded
    uint pattern;             // what is shown instead of the scene; one of the PATTERN_ constants
    uint environment_first;   // texel
};

// It is a storage block, though it is the same for all: lavapipe 22.3 makes a shader anew, and keeps the old one, each time that a uniform
// block which a condition hangs on is bound; that would be some milliseconds and a megabyte a pass and frame. So no condition may hang on
// `frame` alone.
layout(std430, binding = 36) readonly buffer Setup { GpuSetup shared_setup; };

// Each word of it is read once an invocation, and not at all where none asks: lavapipe reads storage blocks lane by lane.
GpuSetup setup = shared_setup;

#endif
