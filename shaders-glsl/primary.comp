// Which physical thing each pixel lands on: one jittered sample of every pixel. Depends on the projector and the props, never on
// the eye (PAPER.md, View-dependent Rendering).
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/primary_hit.glsl"
#include "include/closest.glsl"
#include "include/tiles.glsl"

#define HITS_ACCESS writeonly
#include "include/hits.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

// Of the samples so far.
layout(std430, binding = 16) buffer Closest { uvec4 closest[]; };

void main() {
    uvec2 pixel = listed_pixel(TILES_SEEN);
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
    uint distance = found ? floatBitsToUint(hit.t) : 0x7f800000u;
    uint farthest = found ? farthest_bits(hit.t) : 0u;
    if (push.sample_index == 0u) {
        closest[index] = uvec4(distance, farthest, hit.instance, hit.triangle);
    } else if (found) {
        // Distances are not negative, so their bits are in their order.
        uvec2 before = closest[index].xy;
        farthest = max(farthest, before.y & ~CLOSEST_SAMPLE);
        if (distance < before.x) {
            closest[index] = uvec4(distance, farthest | push.sample_index, hit.instance, hit.triangle);
        } else {
            closest[index].y = farthest | (before.y & CLOSEST_SAMPLE);
        }
    }
    publish_counts(1u, 0u);
}
