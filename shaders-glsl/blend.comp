// This projector's share of the light at the point that each pixel shows: its weight over the sum of all that light the point. One
// dispatch a projector adds that projector's part, since each has a map of occlusion edges of its own.
#version 460
#extension GL_GOOGLE_include_directive : require

#define OCCLUSION_EDGES
#include "include/frame.glsl"
#include "include/primary_hit.glsl"
#include "include/weight.glsl"
#include "include/closest.glsl"
#include "include/tiles.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(std430, binding = 16) readonly buffer Closest { uvec4 closest[]; };

// The sum of all shares over this projector's own: the reciprocal of its weight; +inf where there is nothing to light.
layout(std430, binding = 19) buffer Weight { float inverse_weight[]; };

// This projector's own occlusion edges.
layout(std430, binding = 30) readonly buffer Edge { float edge_px[]; };

void main() {
    uvec2 pixel = listed_pixel(TILES_SHARED);
    if (outside_image(pixel)) {
        return;
    }
    uint index = pixel_index(pixel);
    uvec4 nearest = closest[index];
    record_for(index, nearest.y);
    bool missed = isinf(uintBitsToFloat(nearest.x));

    // Its own part comes first, and is 1.
    if (push.projector == setup.projector_index) {
        inverse_weight[index] = missed ? uintBitsToFloat(0x7f800000u) : 1.0;
        return;
    }
    if (missed) {
        return;
    }
    bool inside;
    Surface s = lit_surface(sample_ray(pixel, closest_sample(nearest)), nearest.zw, inside);

    // That this projector sees the point needs no ray: its primary ray has found it.
    float mine = share_of(setup.projector_index, s.position, s.normal_geometric, false) * edge_fade(edge_px[index]);
    float other = share_of(push.projector, s.position, s.normal_geometric, true);
    other *= edge_fade(edge_at(push.projector, s.position));
    inverse_weight[index] += other / max(mine, 1e-30);
    publish_counts(0u, blend_rays_made);
}
