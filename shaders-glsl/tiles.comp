// Which tiles of the image are to be made anew, by pass. What has moved is given as boxes; what a tile shows, as the box around what
// its samples have met. One invocation a tile.
#version 460
#extension GL_GOOGLE_include_directive : require

#define TILES_ACCESS
#include "include/frame.glsl"
#include "include/scene.glsl"
#include "include/primary_ray.glsl"
#include "include/closest.glsl"
#include "include/edge.glsl"
#include "include/reach.glsl"
#include "include/tiles.glsl"

layout(local_size_x = 64) in;

layout(push_constant) uniform Push {
    uint whole;           // a bit a list: every tile
    uint reached;         // a bit a list: the tiles that the boxes reach
    uint physical_count;  // boxes of props and masks, which come first
    uint moved_count;     // and of virtual things
} push;

struct GpuMovedBox {
    vec3 low;
    vec3 high;
};

// Where a box may show in a projector's image.
struct GpuShown {
    ivec4 tiles;   // first column and row, and those after the last; in the real image
    vec4 edged_px; // around the tiles whose occlusion edges may differ for it: low and high, in the ideal image
};

layout(std430, binding = 34) readonly buffer Moved {
    GpuMovedBox moved[2u * MAX_BOXES];
    GpuShown shown_boxes[]; // a projector after the other, of each physical box
};

// Where the corners of each tile lie in the ideal image, px: low and high; for projectors with a lens.
layout(std430, binding = 38) readonly buffer IdealTiles { vec4 ideal_tiles[]; };

layout(std430, binding = 13) readonly buffer Projectors { GpuFrustum projectors[]; };
layout(std430, binding = 16) readonly buffer Closest { uvec4 closest[]; };

const uint BOUNDS_UNKNOWN = 0u;
const uint BOUNDS_EMPTY = 1u; // no sample has met anything
const uint BOUNDS_KNOWN = 2u;
const uint BOUNDS_ENDLESS = 3u;

struct GpuTileBounds {
    vec3 low;
    uint state;
    vec3 high;
};

// Around what the samples of each tile have met; unknown again once the tile is traced anew.
layout(std430, binding = 33) buffer TileBounds { GpuTileBounds tile_bounds[]; };

// What rounding can do to a point of a tile, m, and as a share of a coordinate; as for the boxes, daemon/render/src/moved.rs.
const float PAD_M = 1e-4;
const float PAD_SHARE = 1e-4;
// What rounding, and reading a map between its pixels, can do to a place in another projector's image, px.
const float PAD_PX = 2.0;

void append(uint list, uvec2 tile, uint tile_count) {
    uint at = atomicAdd(tile_heads[list].w, 1u);
    tiles[list * tile_count + at] = tile.x | tile.y << 16u;
    atomicMax(tile_heads[list].x, min(at + 1u, TILE_GROUPS_X));
    if (at % TILE_GROUPS_X == 0u) {
        atomicMax(tile_heads[list].y, at / TILE_GROUPS_X + 1u);
    }
}

// How many tiles lie between a tile and a rectangle of tiles, on each axis; 0 inside.
ivec2 tiles_between(ivec2 tile, ivec4 rectangle) {
    return max(max(rectangle.xy - tile, tile - (rectangle.zw - 1)), 0);
}

bool is_empty(ivec4 rectangle) {
    return rectangle.x >= rectangle.z || rectangle.y >= rectangle.w;
}

// The box around what the samples of a tile have met: between the rays of its corners, from the nearest hit to the farthest.
GpuTileBounds bounds_of(uvec2 tile) {
    uvec2 size = uvec2(frame.frustum.resolution_px);
    float nearest = uintBitsToFloat(0x7f800000u);
    float farthest = 0.0;
    for (uint i = 0u; i < TILE_PX * TILE_PX; ++i) {
        uvec2 pixel = tile * TILE_PX + uvec2(i % TILE_PX, i / TILE_PX);
        if (all(lessThan(pixel, size))) {
            uvec4 found = closest[pixel.y * size.x + pixel.x];
            nearest = min(nearest, uintBitsToFloat(found.x));
            farthest = max(farthest, farthest_m(found));
        }
    }
    if (isinf(nearest)) {
        return GpuTileBounds(vec3(0.0), BOUNDS_EMPTY, vec3(0.0));
    }

    vec3 origins[4];
    vec3 directions[4];
    vec3 middle = vec3(0.0);
    bool endless = false;
    for (uint i = 0u; i < 4u; ++i) {
        float t_max;
        vec2 corner_px = vec2((tile + uvec2(i & 1u, i >> 1u)) * TILE_PX);
        if (OWN_LENS != 0u) {
            // The tile is no rectangle in the ideal image, but it lies in one.
            vec4 around = ideal_tiles[tile.y * image_tiles().x + tile.x];
            corner_px = vec2((i & 1u) == 0u ? around.x : around.z, (i & 2u) == 0u ? around.y : around.w);
        }
        frustum_ray(frame.frustum, corner_px, origins[i], directions[i], t_max);
        endless = endless || t_max < 0.0;
        middle += directions[i];
    }

    // A ray between those of the corners is a mean of theirs, made one long again: by no more than the reciprocal of the least cosine
    // to their middle.
    middle = normalize(middle);
    float cosine = 1.0;
    for (uint i = 0u; i < 4u; ++i) {
        cosine = min(cosine, dot(middle, directions[i]));
    }
    if (endless || !(cosine > 0.5)) {
        return GpuTileBounds(vec3(0.0), BOUNDS_ENDLESS, vec3(0.0));
    }
    farthest /= cosine;
    vec3 origin_low = origins[0], origin_high = origins[0];
    vec3 low = vec3(3.0e38), high = vec3(-3.0e38);
    for (uint i = 0u; i < 4u; ++i) {
        origin_low = min(origin_low, origins[i]);
        origin_high = max(origin_high, origins[i]);
        low = min(low, min(directions[i] * nearest, directions[i] * farthest));
        high = max(high, max(directions[i] * nearest, directions[i] * farthest));
    }
    low += origin_low;
    high += origin_high;
    float pad_m = PAD_M + PAD_SHARE * 0.01 * farthest;
    return GpuTileBounds(low - pad_m - PAD_SHARE * abs(low), BOUNDS_KNOWN, high + pad_m + PAD_SHARE * abs(high));
}

// Whether light on its way to the tile can meet a box.
bool is_shadow_reached(GpuTileBounds tile) {
    bool found = false;
    for (uint i = 0u; i < setup.light_count; ++i) {
        GpuLight l = light_of(i);
        bool directional = l.kind == LIGHT_DIRECTIONAL;
        for (uint k = 0u; k < push.moved_count; ++k) {
            Bounds box = Bounds(moved[k].low, moved[k].high);
            found = found || reaches(Bounds(tile.low, tile.high), directional ? -l.direction : l.position, directional, box);
        }
    }
    return found;
}

// Whether another projector's view of what the tile shows, or its occlusion edges there, can have changed.
bool is_share_reached(GpuTileBounds tile, uint projector) {
    // What is around the tile's box is around its corners' places, unless the box reaches the plane of the projector's centre.
    GpuFrustum f = projectors[projector];
    vec2 low_px = vec2(3.0e38), high_px = vec2(-3.0e38);
    float least_w = 3.0e38, most_w = -3.0e38;
    for (uint i = 0u; i < 8u; ++i) {
        vec3 corner = vec3((i & 1u) == 0u ? tile.low.x : tile.high.x, (i & 2u) == 0u ? tile.low.y : tile.high.y,
                           (i & 4u) == 0u ? tile.low.z : tile.high.z);
        float clip_w;
        vec2 at_px = project_px(f, corner, clip_w);
        least_w = min(least_w, clip_w);
        most_w = max(most_w, clip_w);
        low_px = min(low_px, at_px);
        high_px = max(high_px, at_px);
    }
    if (most_w <= 0.0) {
        return false;
    }
    bool anywhere = !(least_w > 1e-3 * most_w);
    low_px -= PAD_PX;
    high_px += PAD_PX;
    bool found = false;
    for (uint k = 0u; k < push.physical_count; ++k) {
        GpuShown shown = shown_boxes[projector * MAX_BOXES + k];
        bool apart = any(greaterThan(shown.edged_px.xy, high_px)) || any(greaterThanEqual(low_px, shown.edged_px.zw));
        found = found || !is_empty(shown.tiles) && (anywhere || !apart);
    }
    return found;
}

void main() {
    uvec2 size = image_tiles();
    uint index = gl_GlobalInvocationID.x;
    if (index >= size.x * size.y) {
        return;
    }
    uvec2 tile = uvec2(index % size.x, index / size.x);

    // Where a box shows, and around there, on the image alone. Distances to edges are measured along rows and then along columns, so
    // they need the marks of as many tiles again around those that they may differ in.
    uint lists = push.whole;
    for (uint k = 0u; k < push.physical_count; ++k) {
        ivec4 shown = shown_boxes[setup.projector_index * MAX_BOXES + k].tiles;
        if (!is_empty(shown)) {
            ivec2 between = tiles_between(ivec2(tile), shown);
            uint reached = all(equal(between, ivec2(0))) ? 1u << TILES_SEEN | 1u << TILES_LIT : 0u;
            reached |= all(lessThanEqual(between, ivec2(2 * EDGE_TILES))) ? 1u << TILES_MARKED : 0u;
            reached |= all(lessThanEqual(between, ivec2(EDGE_TILES))) ? 1u << TILES_EDGED | 1u << TILES_SHARED : 0u;
            lists |= reached & push.reached;
        }
    }

    // What the tile shows may be reached in the room.
    uint asked = push.reached & ~lists & (1u << TILES_LIT | 1u << TILES_SHARED);
    if ((lists & 1u << TILES_SEEN) != 0u) {
        tile_bounds[index].state = BOUNDS_UNKNOWN;
    } else if (asked != 0u) {
        GpuTileBounds bounds = tile_bounds[index];
        if (bounds.state == BOUNDS_UNKNOWN) {
            bounds = bounds_of(tile);
            tile_bounds[index] = bounds;
        }
        if (bounds.state == BOUNDS_ENDLESS) {
            lists |= asked;
        } else if (bounds.state == BOUNDS_KNOWN) {
            uint reached = is_shadow_reached(bounds) ? 1u << TILES_LIT : 0u;
            for (uint p = 0u; p < setup.projector_count; ++p) {
                if (p != setup.projector_index && is_share_reached(bounds, p)) {
                    reached |= 1u << TILES_SHARED;
                }
            }
            lists |= reached & asked;
        }
    }

    for (uint list = 0u; list < TILE_LISTS; ++list) {
        if ((lists & 1u << list) != 0u) {
            append(list, tile, size.x * size.y);
        }
    }
}
