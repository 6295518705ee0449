// Places through a lens, each way.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "../../shaders-glsl/include/lens.glsl"

layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Places { vec2 places[]; };
layout(std430, binding = 1) writeonly buffer Found { vec4 found[]; }; // where it leads, and 1 where it leads anywhere

layout(push_constant) uniform Push {
    uint lens;
    uint to_real_place;
    uint count;
} push;

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= push.count) {
        return;
    }
    vec2 at = places[i];
    bool leads = push.to_real_place != 0u ? to_real(lenses[push.lens], at) : to_ideal(lenses[push.lens], at);
    found[i] = vec4(at, leads ? 1.0 : 0.0, 0.0);
}
