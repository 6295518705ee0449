// The image in tiles of a workgroup's size, and lists of those that are to be made anew, by pass. What is not listed is not visited.
#ifndef TILES_GLSL
#define TILES_GLSL

// Side of a tile, px. Twins of what daemon/render/src/moved.rs and tiles.rs name.
const uint TILE_PX = 8u;

// Tiles around a changed one in which the distance to occlusion edges may differ: EDGE_REACH_PX and a pixel, since an edge is found from the
// next pixel's distance, in whole tiles.
const int EDGE_TILES = 2;

// One list a pass, the k-th after k times as many words as the image has tiles.
const uint TILES_SEEN = 0u;   // what the pixels land on
const uint TILES_MARKED = 1u; // where occlusion edges are looked for again
const uint TILES_EDGED = 2u;  // where the distance to them may differ
const uint TILES_LIT = 3u;    // light that does not depend on the eye
const uint TILES_SHARED = 4u; // blend weights
const uint TILE_LISTS = 5u;

// Workgroups in x, after which they go on in y: every device takes 65,535 in each.
const uint TILE_GROUPS_X = 32768u;

#ifndef TILES_ACCESS
#define TILES_ACCESS readonly
#endif

layout(std430, binding = 35) TILES_ACCESS buffer Tiles {
    uvec4 tile_heads[TILE_LISTS]; // the workgroups of an indirect dispatch, and how long the list is
    uint tiles[];                 // column, and row in the upper half
};

uvec2 image_tiles() {
    return (uvec2(frame.frustum.resolution_px) + (TILE_PX - 1u)) / TILE_PX;
}

// The first pixel of the tile that this workgroup has from a list; one outside of any image where there is none.
uvec2 listed_corner(uint list) {
    uint number = gl_WorkGroupID.y * TILE_GROUPS_X + gl_WorkGroupID.x;
    if (number >= tile_heads[list].w) {
        return uvec2(0xffff0000u);
    }
    uvec2 size = image_tiles();
    uint tile = tiles[list * size.x * size.y + number];
    return uvec2(tile & 0xffffu, tile >> 16u) * TILE_PX;
}

// The pixel of this invocation, where each has one.
uvec2 listed_pixel(uint list) {
    return listed_corner(list) + gl_LocalInvocationID.xy;
}

#endif
