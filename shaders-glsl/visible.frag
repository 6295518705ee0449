// Which triangle of which raster node the ideal image shows.
#version 460
#extension GL_GOOGLE_include_directive : require

layout(push_constant) uniform Push {
    vec2 low_px;
    vec2 texels_a_px;
    vec2 size;
    uint instance;
} push;

layout(location = 0) flat in uint triangle;

layout(location = 0) out uint instance_and_one;
layout(location = 1) out uint triangle_seen;

void main() {
    instance_and_one = push.instance + 1u;
    triangle_seen = triangle;
}
