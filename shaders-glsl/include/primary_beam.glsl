// Primary rays as beams, and what a pixel keeps of its samples' hits.
#ifndef PRIMARY_BEAM_GLSL
#define PRIMARY_BEAM_GLSL

#include "primary_hit.glsl"
#include "closest.glsl"
#include "beam.glsl"

// Of the samples so far.
layout(std430, binding = 16) buffer Closest { uvec4 closest[]; };

// What four rays hit that start close together and run much the same way. One whose t_max is negative hits nothing.
BeamHits trace_primary(Ray rays[4]) {
    Ray some = Ray(vec3(0.0), vec3(0.0, 0.0, 1.0), 0.0, -1.0);
    for (uint i = 0u; i < 4u; ++i) {
        if (rays[i].t_max >= 0.0) {
            some = rays[i];
        }
    }
    Beam beam;
    vec4 t_max;
    for (uint i = 0u; i < 4u; ++i) {
        t_max[i] = rays[i].t_max;
        Ray ray = rays[i];
        if (ray.t_max < 0.0) {
            ray = some;
        }
        beam.origin_x[i] = ray.origin.x;
        beam.origin_y[i] = ray.origin.y;
        beam.origin_z[i] = ray.origin.z;
        beam.direction_x[i] = ray.direction.x;
        beam.direction_y[i] = ray.direction.y;
        beam.direction_z[i] = ray.direction.z;
    }
    return trace_closest(beam, 0.0, t_max, PHYSICAL);
}

// What a pixel knows before its first sample.
const uvec4 CLOSEST_OF_NONE = uvec4(0x7f800000u, 0u, NO_INSTANCE, 0u);

// The closest sample, never a mean: a mean lies on no surface (PAPER.md, Hybrid Rendering).
void take_sample(inout uvec4 nearest, uint s, float t, uint instance, uint triangle) {
    if (instance != NO_INSTANCE) {
        // Distances are not negative, so their bits are in their order.
        uint distance = floatBitsToUint(t);
        uint farthest = max(farthest_bits(t), nearest.y & ~CLOSEST_SAMPLE);
        nearest.y = farthest | (nearest.y & CLOSEST_SAMPLE);
        if (distance < nearest.x) {
            nearest = uvec4(distance, farthest | s, instance, triangle);
        }
    }
}

#endif
