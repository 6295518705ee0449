// Triangles of a raster node through the projector's matrix, pulled from the buffers that rays read.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/raster_corner.glsl"

layout(push_constant) uniform Push {
    vec2 offset_px; // from the pixel's centre to the sample
    uint instance;
} push;

layout(location = 0) out vec3 position;
layout(location = 1) out vec3 barycentric;
layout(location = 2) flat out uint triangle;

void main() {
    triangle = uint(gl_VertexIndex) / 3u;
    uint corner = uint(gl_VertexIndex) % 3u;
    position = raster_corner(push.instance, triangle, corner);
    barycentric = vec3(corner == 0u, corner == 1u, corner == 2u);

    // The projector's own clip space turned into Vulkan's: y down, window z in [0, 1].
    GpuFrustum f = frame.frustum;
    vec4 h = vec4(position, 1.0);
    float w = dot(f.clip_w, h);
    vec2 xy = vec2(dot(f.clip_x, h), dot(f.clip_y, h) * f.y_sign);
    gl_Position = vec4(xy - 2.0 * push.offset_px / f.resolution_px * w, f.z_base * w + dot(f.depth_row, h), w);
}
