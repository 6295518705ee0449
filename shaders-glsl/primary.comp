// Which physical thing each pixel lands on: one jittered sample of every pixel. Depends on the projector and the props, never on
// the eye (PAPER.md, View-dependent Rendering).
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/primary_hit.glsl"

#define HITS_ACCESS writeonly
#include "include/hits.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

// Of the samples so far, the closest: distance (f32 bits, +inf where all missed), sample, instance, triangle.
layout(std430, binding = 16) buffer Closest { uvec4 closest[]; };

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (outside_image(pixel)) {
        return;
    }
    uint index = pixel_index(pixel);
    record_for(index, push.sample_index);
    Ray ray = sample_ray(pixel, push.sample_index);
    Hit hit = trace_closest(ray, PHYSICAL);
    hits[hit_index(index, push.sample_index)] = uvec2(hit.instance, hit.triangle);

    // The closest sample, never a mean: a mean lies on no surface (PAPER.md, Hybrid Rendering).
    bool found = hit.instance != NO_INSTANCE;
    uvec4 mine = uvec4(floatBitsToUint(found ? hit.t : uintBitsToFloat(0x7f800000u)), push.sample_index, hit.instance, hit.triangle);
    if (push.sample_index == 0u || (found && hit.t < uintBitsToFloat(closest[index].x))) {
        closest[index] = mine;
    }
    publish_counts(1u, 0u);
}
