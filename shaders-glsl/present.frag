// A projector's picture into an image of its output, pixel by pixel: the very bytes of the picture where the output has eight bits a
// channel, else the light that they stand for, more finely.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/sent.glsl"

const uint PIXELS_8_BIT = 0u;
const uint PIXELS_10_BIT = 1u;
const uint PIXELS_HDR10 = 2u;
layout(constant_id = 12) const uint PIXELS = PIXELS_8_BIT;

// Nothing that the host writes for a frame is bound: the next frame begins while this one is still on its way to the screen.
layout(push_constant) uniform Push {
    float white_nits; // for HDR10: how bright white is, cd/m²
    uint columns;     // of the picture
    uint is_pattern;  // whether the picture is a test pattern
} push;

layout(std430, binding = 23) readonly buffer Shown { vec4 shown[]; }; // linear radiance, weight
layout(std430, binding = 25) readonly buffer Color { uint color[]; }; // RGBA8, sRGB

layout(location = 0) out vec4 pixel_color;

// ITU-R BT.2087: linear BT.709 in BT.2020's primaries; columns.
const mat3 BT2020_FROM_BT709 =
    mat3(0.6274, 0.0691, 0.0164, 0.3293, 0.9195, 0.0880, 0.0433, 0.0114, 0.8956);

// SMPTE ST 2084, the inverse of its electro-optical transfer function; from 0 to 10,000 cd/m².
vec3 encode_pq(vec3 nits) {
    vec3 y = pow(max(nits, vec3(0.0)) / 10000.0, vec3(0.1593017578125));
    return pow((0.8359375 + 18.8515625 * y) / (1.0 + 18.6875 * y), vec3(78.84375));
}

void main() {
    uint index = uint(gl_FragCoord.y) * push.columns + uint(gl_FragCoord.x);
    if (PIXELS == PIXELS_8_BIT) {
        pixel_color = vec4(unpackUnorm4x8(color[index]).rgb, 1.0);
        return;
    }

    // A test pattern stands in the picture alone, and is black and white.
    vec3 light = sent_light(index, shown[index]);
    if (push.is_pattern != 0u) {
        light = unpackUnorm4x8(color[index]).rgb;
    }
    vec3 encoded = PIXELS == PIXELS_10_BIT ? encode_srgb(light) : encode_pq(BT2020_FROM_BT709 * light * push.white_nits);
    pixel_color = vec4(encoded, 1.0);
}
