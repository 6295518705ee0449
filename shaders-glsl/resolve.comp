// From attachments to what is shown. Where rasterised and traced things mix, every sample is composited and drawn on its own and
// this pass takes their mean colour and their closest depth; it ends with the projector's 8-bit sRGB, its alpha and beta maps applied.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/pattern.glsl"
#include "include/sent.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(push_constant) uniform Push {
    uint pass;   // this one
    uint passes; // of so many
} push;

layout(binding = 20) uniform sampler2D radiance_image;
layout(binding = 21) uniform sampler2D node_image;
layout(binding = 22) uniform sampler2D depth_image;

layout(std430, binding = 23) buffer Shown { vec4 shown[]; };                   // linear radiance, weight
layout(std430, binding = 24) buffer DepthAndNode { vec2 depth_and_node[]; };   // window z, scene node
layout(std430, binding = 25) writeonly buffer Color { uint color[]; };         // RGBA8, sRGB

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    uvec2 size = uvec2(frame.frustum.resolution_px);
    if (pixel.x >= size.x || pixel.y >= size.y) {
        return;
    }
    uint index = pixel.y * size.x + pixel.x;
    vec4 mine = texelFetch(radiance_image, ivec2(pixel), 0) / float(push.passes);
    vec2 at = vec2(texelFetch(depth_image, ivec2(pixel), 0).x, texelFetch(node_image, ivec2(pixel), 0).x);
    if (push.pass > 0u) {
        mine += shown[index];
        if (depth_and_node[index].x <= at.x) {
            at = depth_and_node[index];
        }
    }
    shown[index] = mine;
    depth_and_node[index] = at;
    if (push.pass + 1u == push.passes) {
        vec3 encoded = encode_srgb(sent_light(index, mine));
        if (setup.pattern != PATTERN_OFF) {
            encoded = pattern_color(setup.pattern, ivec2(pixel), ivec2(size), setup.projector_index);
        }
        color[index] = packUnorm4x8(vec4(encoded, 1.0));
    }
}
