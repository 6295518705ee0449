// This projector's share of the light at the point that each pixel shows: its weight over the sum of all that light the point.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/primary_hit.glsl"
#include "include/weight.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(std430, binding = 15) readonly buffer Hits { uvec2 hits[]; };
layout(std430, binding = 16) readonly buffer Closest { uvec2 closest[]; };
layout(std430, binding = 19) buffer Weight { float weight[]; };

// Runs once for each sample plane and writes where that plane holds the pixel's closest sample.
void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (outside_image(pixel)) {
        return;
    }
    uint index = pixel_index(pixel);
    uvec2 nearest = closest[index];
    bool missed = isinf(uintBitsToFloat(nearest.x));
    if (missed || (nearest.y >> 24u) != push.sample_index) {
        if (missed) {
            weight[index] = 0.0;
        }
        return;
    }
    if (frame.blend == 0u || frame.projector_count < 2u) {
        weight[index] = 1.0;
        return;
    }
    bool inside;
    Surface s = lit_surface(sample_ray(pixel, push.sample_index), hits[index], inside);
    float sum = 0.0;
    float mine = 0.0;
    uint rays = 0u;
    for (uint i = 0u; i < frame.projector_count; ++i) {
        // That this projector sees the point needs no ray: its primary ray has found it.
        bool self = i == frame.projector_index;
        float share = share_of(i, s.position, s.normal_geometric, !self);
        sum += share;
        rays += self ? 0u : 1u;
        mine = self ? share : mine;
    }
    weight[index] = sum > 0.0 ? mine / sum : 1.0;
    publish_counts(0u, rays);
}
