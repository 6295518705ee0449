// This projector's share of the light at the point that each pixel shows: its weight over the sum of all that light the point.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/primary_hit.glsl"
#include "include/weight.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(std430, binding = 16) readonly buffer Closest { uvec4 closest[]; };
layout(std430, binding = 19) writeonly buffer Weight { float weight[]; };

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (outside_image(pixel)) {
        return;
    }
    uint index = pixel_index(pixel);
    uvec4 nearest = closest[index];
    if (isinf(uintBitsToFloat(nearest.x))) {
        weight[index] = 0.0;
        return;
    }
    if (frame.blend == 0u || frame.projector_count < 2u) {
        weight[index] = 1.0;
        return;
    }
    bool inside;
    Surface s = lit_surface(sample_ray(pixel, nearest.y), nearest.zw, inside);

    // That this projector sees the point needs no ray: its primary ray has found it.
    float mine = share_of(frame.projector_index, s.position, s.normal_geometric, false);
    float sum = mine;
    uint i = frame.projector_index == 0u ? 1u : 0u;
    while (true) {
        sum += share_of(i, s.position, s.normal_geometric, true);
        i += i + 1u == frame.projector_index ? 2u : 1u;
        if (i >= frame.projector_count) {
            break;
        }
    }
    weight[index] = sum > 0.0 ? mine / sum : 1.0;
    publish_counts(0u, frame.projector_count - 1u);
}
