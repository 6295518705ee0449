// Triangles as any rasteriser draws them: world corners times one matrix.
#version 460

layout(std430, binding = 0) readonly buffer Corners { vec4 corners[]; }; // xyz, m; w, the node

layout(push_constant) uniform Push { mat4 clip_from_world; } push;

layout(location = 0) flat out float node;

void main() {
    vec4 corner = corners[gl_VertexIndex];
    node = corner.w;
    gl_Position = push.clip_from_world * vec4(corner.xyz, 1.0);
}
