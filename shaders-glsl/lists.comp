// Lists of the pixels whose look depends on the eye, for the passes that follow the eye: they visit no other. `Once`: all samples show
// the same thing, and one may stand for all. `Each`: every sample is looked at.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/live.glsl"

#define LOOK_ACCESS writeonly
#include "include/look.glsl"

layout(local_size_x = 64) in;

layout(std430, binding = 28) buffer Once {
    uvec3 once_groups; // of the indirect dispatch
    uint once_count;
    uint once_rest; // 0
    uint once[];
};
layout(std430, binding = 29) buffer Each {
    uvec3 each_groups;
    uint each_count;
    uint each_rest; // those of which one sample was shaded before: none yet
    uint each[];
};
layout(std430, binding = 30) readonly buffer Class { uint classes[]; };

void main() {
    uvec2 size = uvec2(frame.frustum.resolution_px);
    uint index = gl_GlobalInvocationID.y * gl_NumWorkGroups.x * gl_WorkGroupSize.x + gl_GlobalInvocationID.x;
    if (index >= size.x * size.y) {
        return;
    }
    uint pixel_class = classes[index];
    if (may_shade_once(pixel_class)) {
        uint at = atomicAdd(once_count, 1u);
        once[at] = index;
        if (at % LIVE_GROUP == 0u) {
            uvec2 groups = live_groups_for(at / LIVE_GROUP);
            atomicMax(once_groups.x, groups.x);
            atomicMax(once_groups.y, groups.y);
        }
        return;
    }
    look[index] = PixelLook(vec3(0.0), NOT_BEGUN);
    if ((pixel_class & CLASS_EYE) != 0u) {
        uint at = atomicAdd(each_count, 1u);
        each[at] = index;
        if (at % each_pixels_a_group() == 0u) {
            uvec2 groups = live_groups_for(at / each_pixels_a_group());
            atomicMax(each_groups.x, groups.x);
            atomicMax(each_groups.y, groups.y);
        }
    }
}
