// How far each pixel is from where this projector's light ends on the surface that it shows, because something nearer stands before
// it: a weight that falls to zero toward there hides the seam (DESIGN section 2, Light from many projectors).
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/edge.glsl"
#include "include/tiles.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(push_constant) uniform Push {
    uint pass; // 0: mark edges; 1: distance along the row; 2: distance to the nearest edge at all
} push;

layout(std430, binding = 16) readonly buffer Closest { uvec4 closest[]; };
layout(std430, binding = 29) buffer EdgeScratch { vec2 scratch[]; }; // 1 at an edge; px to the nearest edge of the row
layout(std430, binding = 30) writeonly buffer Edge { float edge_px[]; };

ivec2 size;

uint index_of(ivec2 at) {
    at = clamp(at, ivec2(0), size - 1);
    return uint(at.y) * uint(size.x) + uint(at.x);
}

// 1/distance, which is nearly linear across a plane's image; 0 for a miss.
float nearness(ivec2 at) {
    float d = uintBitsToFloat(closest[index_of(at)].x);
    return isinf(d) ? 0.0 : 1.0 / max(d, 1e-6);
}

// Whether the neighbour is nearer by a jump: by more than the surface's own slope on the other side explains.
bool jumps(ivec2 at, ivec2 step, float mine) {
    float slope = abs(mine - nearness(at - step));
    return nearness(at + step) - mine > max(4.0 * slope, 0.01 * mine);
}

void main() {
    uvec2 listed = listed_pixel(push.pass == 2u ? TILES_EDGED : TILES_MARKED);
    if (any(greaterThanEqual(listed, uvec2(frame.frustum.resolution_px)))) {
        return;
    }
    ivec2 pixel = ivec2(listed);
    size = ivec2(frame.frustum.resolution_px);
    uint index = index_of(pixel);
    if (push.pass == 0u) {
        float mine = nearness(pixel);
        bool marked = mine > 0.0 && (jumps(pixel, ivec2(1, 0), mine) || jumps(pixel, ivec2(-1, 0), mine) ||
                                     jumps(pixel, ivec2(0, 1), mine) || jumps(pixel, ivec2(0, -1), mine));
        scratch[index].x = marked ? 1.0 : 0.0;
        return;
    }

    // Rows first, then columns over what the rows found: a Euclidean distance, exact as far as it reaches.
    ivec2 step = push.pass == 1u ? ivec2(1, 0) : ivec2(0, 1);
    float nearest2 = EDGE_REACH_PX * EDGE_REACH_PX;
    for (int i = -int(EDGE_REACH_PX); i <= int(EDGE_REACH_PX); ++i) {
        vec2 there = scratch[index_of(pixel + i * step)];
        float along = push.pass == 1u ? (there.x > 0.5 ? 0.0 : EDGE_REACH_PX) : there.y;
        nearest2 = min(nearest2, along * along + float(i * i));
    }
    if (push.pass == 1u) {
        scratch[index].y = sqrt(nearest2);
    } else {
        edge_px[index] = sqrt(nearest2);
    }
}
