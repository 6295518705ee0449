// A projector's picture and its depth into a buffer that another process reads: a plane of colour, and one of depth.
#version 460

layout(local_size_x = 8, local_size_y = 8) in;

layout(push_constant) uniform Push {
    uint columns;
    uint rows;
    uint row_words;        // from one row of a plane to the next
    uint depth_first_word; // where depth begins
    uint reversed;         // whether the projector's own depth falls with distance
} push;

layout(std430, binding = 24) readonly buffer DepthAndNode { uvec2 depth_and_node[]; }; // bits of window z, of the scene node
layout(std430, binding = 25) readonly buffer Color { uint color[]; };                  // RGBA8, sRGB
layout(std430, binding = 43) writeonly buffer Exported { uint exported[]; };

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (pixel.x >= push.columns || pixel.y >= push.rows) {
        return;
    }
    uint index = pixel.y * push.columns + pixel.x;
    uint place = pixel.y * push.row_words + pixel.x;
    exported[place] = color[index];

    // Bits are copied as they are; a miss is 1 in either convention.
    uvec2 at = depth_and_node[index];
    bool turned = push.reversed != 0u && uintBitsToFloat(at.y) >= 0.0;
    exported[push.depth_first_word + place] = turned ? floatBitsToUint(1.0 - uintBitsToFloat(at.x)) : at.x;
}
