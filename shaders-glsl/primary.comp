// Which physical thing each pixel lands on: one jittered sample of every pixel, or four at once. Depends on the projector and the props,
// never on the eye (PAPER.md, View-dependent Rendering).
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/primary_beam.glsl"
#include "include/tiles.glsl"

#define HITS_ACCESS writeonly
#include "include/hits.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

// Samples that one invocation traces, 1 or up to 4, a group's: they share the work on nodes, at the price of fewer invocations with
// more registers.
layout(constant_id = 4) const uint SAMPLES_TOGETHER = 4u;

// The hits of a pixel's samples from push.sample_index on.
BeamHits hits_of(uvec2 pixel, uint count) {
    uint index = pixel_index(pixel);
    if (SAMPLES_TOGETHER == 1u) {
        record_for(index, push.sample_index);
        Hit hit = trace_closest(sample_ray(pixel, push.sample_index), PHYSICAL);
        return BeamHits(vec4(hit.t), uvec4(hit.instance), uvec4(hit.triangle));
    }
    Ray rays[4];
    for (uint i = 0u; i < 4u; ++i) {
        rays[i] = sample_ray(pixel, push.sample_index + min(i, count - 1u));
        rays[i].t_max = i < count ? rays[i].t_max : -1.0;
    }
    BeamHits found = trace_primary(rays);
    for (uint i = 0u; i < count; ++i) {
        record_for(index, push.sample_index + i);
        record_closest(PHYSICAL, rays[i], Hit(found.t[i], found.instance[i], found.triangle[i], vec2(0.0)));
    }
    return found;
}

void find(uvec2 pixel) {
    uint index = pixel_index(pixel);
    uint count = min(SAMPLES_TOGETHER, setup.planes_a_group);
    BeamHits found = hits_of(pixel, count);
    for (uint i = 0u; i < SAMPLES_TOGETHER; ++i) {
        if (i < count) {
            hits[hit_index(index, push.sample_index + i)] = uvec2(found.instance[i], found.triangle[i]);
        }
    }

    uvec4 nearest = push.sample_index == 0u ? CLOSEST_OF_NONE : closest[index];
    for (uint i = 0u; i < SAMPLES_TOGETHER; ++i) {
        if (i < count) {
            take_sample(nearest, push.sample_index + i, found.t[i], found.instance[i], found.triangle[i]);
        }
    }
    closest[index] = nearest;
    publish_counts(count, 0u);
}

void main() {
    uvec2 pixel = listed_pixel(TILES_SEEN);
    if (!outside_image(pixel)) {
        find(pixel);
    }
}
