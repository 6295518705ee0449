// The same as primary.comp, of one sample plane, with the rays of 2 × 2 pixels as a beam: an invocation has four pixels, a workgroup a tile.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/primary_beam.glsl"
#include "include/tiles.glsl"

#define HITS_ACCESS writeonly
#include "include/hits.glsl"

layout(local_size_x = 4, local_size_y = 4) in;

void main() {
    // Corners of a tile are even, so that no beam reaches into another. Pixels outside the image, or of no tile, have no ray.
    uvec2 first = listed_corner(TILES_SEEN) + 2u * gl_LocalInvocationID.xy;
    if (outside_image(first)) {
        return;
    }
    Ray rays[4];
    for (uint i = 0u; i < 4u; ++i) {
        uvec2 pixel = first + uvec2(i & 1u, i >> 1u);
        rays[i] = sample_ray(pixel, push.sample_index);
        rays[i].t_max = outside_image(pixel) ? -1.0 : rays[i].t_max;
    }
    BeamHits found = trace_primary(rays);
    uint count = 0u;
    for (uint i = 0u; i < 4u; ++i) {
        uvec2 pixel = first + uvec2(i & 1u, i >> 1u);
        if (!outside_image(pixel)) {
            uint index = pixel_index(pixel);
            record_for(index, push.sample_index);
            record_closest(PHYSICAL, rays[i], Hit(found.t[i], found.instance[i], found.triangle[i], vec2(0.0)));
            hits[hit_index(index, push.sample_index)] = uvec2(found.instance[i], found.triangle[i]);
            uvec4 nearest = push.sample_index == 0u ? CLOSEST_OF_NONE : closest[index];
            take_sample(nearest, push.sample_index, found.t[i], found.instance[i], found.triangle[i]);
            closest[index] = nearest;
            ++count;
        }
    }
    publish_counts(count, 0u);
}
