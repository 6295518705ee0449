// The conservative tests of what a moved box can reach, case by case.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "../../shaders-glsl/include/reach.glsl"

layout(local_size_x = 64) in;

struct Case {
    vec4 from_low;
    vec4 from_high;
    vec4 target; // w: 1 where directional
    vec4 box_low;
    vec4 box_high;
};

layout(std430, binding = 0) readonly buffer Cases { Case cases[]; };
layout(std430, binding = 1) writeonly buffer Answers { uint answers[]; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    Case c = cases[i];
    Bounds from = Bounds(c.from_low.xyz, c.from_high.xyz);
    Bounds box = Bounds(c.box_low.xyz, c.box_high.xyz);
    answers[i] = reaches(from, c.target.xyz, c.target.w > 0.5, box) ? 1u : 0u;
}
