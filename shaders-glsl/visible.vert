// Triangles of a raster node by the projector's matrix, onto the ideal image behind a lens: what is straight is straight there.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/raster_corner.glsl"

layout(push_constant) uniform Push {
    vec2 low_px;       // of the part of the ideal image that is drawn
    vec2 texels_a_px;
    vec2 size;         // texels
    uint instance;
} push;

layout(location = 0) flat out uint triangle;

void main() {
    triangle = uint(gl_VertexIndex) / 3u;
    GpuFrustum f = frame.frustum;
    vec4 h = vec4(raster_corner(push.instance, triangle, uint(gl_VertexIndex) % 3u), 1.0);
    float w = dot(f.clip_w, h);
    vec2 ideal_px_w = 0.5 * (vec2(dot(f.clip_x, h), dot(f.clip_y, h) * f.y_sign) + w) * f.resolution_px;
    vec2 texel_w = (ideal_px_w - push.low_px * w) * push.texels_a_px;
    gl_Position = vec4(2.0 * texel_w / push.size - w, f.z_base * w + dot(f.depth_row, h), w);
}
