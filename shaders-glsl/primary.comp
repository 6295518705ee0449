// Which physical thing each pixel lands on: one jittered sample of every pixel, or four at once. Depends on the projector and the props,
// never on the eye (PAPER.md, View-dependent Rendering).
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/primary_hit.glsl"
#include "include/closest.glsl"
#include "include/tiles.glsl"
#include "include/beam.glsl"

#define HITS_ACCESS writeonly
#include "include/hits.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

// Samples that one invocation traces, 1 or up to 4, a group's: they share the work on nodes, at the price of fewer invocations with
// more registers.
layout(constant_id = 4) const uint SAMPLES_TOGETHER = 4u;

// Of the samples so far.
layout(std430, binding = 16) buffer Closest { uvec4 closest[]; };

// The hits of a pixel's samples from push.sample_index on.
BeamHits hits_of(uvec2 pixel, uint count) {
    uint index = pixel_index(pixel);
    if (SAMPLES_TOGETHER == 1u) {
        record_for(index, push.sample_index);
        Hit hit = trace_closest(sample_ray(pixel, push.sample_index), PHYSICAL);
        return BeamHits(vec4(hit.t), uvec4(hit.instance), uvec4(hit.triangle));
    }
    vec4 t_max;
    Ray rays[4];
    Ray some = Ray(vec3(0.0), vec3(0.0, 0.0, 1.0), 0.0, -1.0);
    for (uint i = 0u; i < 4u; ++i) {
        rays[i] = sample_ray(pixel, push.sample_index + min(i, count - 1u));
        t_max[i] = i < count ? rays[i].t_max : -1.0;
        if (rays[i].t_max >= 0.0) {
            some = rays[i];
        }
    }
    Beam beam;
    for (uint i = 0u; i < 4u; ++i) {
        if (t_max[i] < 0.0) {
            rays[i] = Ray(some.origin, some.direction, some.t_min, t_max[i]);
        }
        beam.origin_x[i] = rays[i].origin.x;
        beam.origin_y[i] = rays[i].origin.y;
        beam.origin_z[i] = rays[i].origin.z;
        beam.direction_x[i] = rays[i].direction.x;
        beam.direction_y[i] = rays[i].direction.y;
        beam.direction_z[i] = rays[i].direction.z;
    }
    BeamHits found = trace_closest(beam, 0.0, t_max, PHYSICAL);
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

    // The closest sample, never a mean: a mean lies on no surface (PAPER.md, Hybrid Rendering).
    uvec4 nearest = push.sample_index == 0u ? uvec4(0x7f800000u, 0u, NO_INSTANCE, 0u) : closest[index];
    for (uint i = 0u; i < SAMPLES_TOGETHER; ++i) {
        if (i < count && found.instance[i] != NO_INSTANCE) {
            // Distances are not negative, so their bits are in their order.
            uint distance = floatBitsToUint(found.t[i]);
            uint farthest = max(farthest_bits(found.t[i]), nearest.y & ~CLOSEST_SAMPLE);
            nearest.y = farthest | (nearest.y & CLOSEST_SAMPLE);
            if (distance < nearest.x) {
                nearest = uvec4(distance, farthest | (push.sample_index + i), found.instance[i], found.triangle[i]);
            }
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
