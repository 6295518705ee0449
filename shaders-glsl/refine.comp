// Which of the pixels that were shaded once must be looked at sample by sample after all: those whose look differs from a
// neighbour's on the same thing by more than a bound (adaptive sampling: Whitted, CACM 23(6), 1980, section 4).
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/live.glsl"
#include "include/look.glsl"
#include "include/primary_hit.glsl"

layout(local_size_x = 64) in;

layout(std430, binding = 28) readonly buffer Once {
    uvec3 once_groups;
    uint once_count;
    uint once_rest; // 0
    uint once[];
};
layout(std430, binding = 29) buffer Each {
    uvec3 each_groups; // of the indirect dispatch
    uint each_count;
    uint each_rest;
    uint each[];
};
layout(std430, binding = 30) readonly buffer Class { uint classes[]; };

// How far neighbours may lie apart, in roots of radiance.
const float BOUND = 1.0 / 24.0;

void main() {
    uint at = gl_GlobalInvocationID.y * gl_NumWorkGroups.x * gl_WorkGroupSize.x + gl_GlobalInvocationID.x;
    if (at >= once_count) {
        return;
    }
    uint index = once[at];
    ivec2 pixel = ivec2(pixel_of(index));
    ivec2 last = ivec2(frame.frustum.resolution_px) - 1;
    uint pixel_class = classes[index];
    uint mine = look[index].code;
    float most = 0.0;
    for (int i = 0; i < 4; ++i) {
        int step = (i & 1) * 2 - 1;
        ivec2 beside = clamp(pixel + ((i & 2) == 0 ? ivec2(step, 0) : ivec2(0, step)), ivec2(0), last);
        uint other = pixel_index(uvec2(beside));
        most = max(most, classes[other] == pixel_class ? apart(look[other].code, mine) : 0.0);
    }
    if (most > BOUND) {
        uint to = atomicAdd(each_rest, 1u);
        each[rest_place(to)] = index;
        uint pixels = LIVE_GROUP / rest_lanes();
        if (to % pixels == 0u) {
            uvec2 groups = live_groups_for(groups_of(each_count, each_pixels_a_group()) + to / pixels);
            atomicMax(each_groups.x, groups.x);
            atomicMax(each_groups.y, groups.y);
        }
    }
}
