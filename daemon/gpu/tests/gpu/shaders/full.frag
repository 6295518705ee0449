#version 460
// Colour from a storage buffer that compute has written, depth that leans along x.
layout(set = 0, binding = 0, std430) readonly buffer Source { uint source[]; };
layout(push_constant) uniform Push { float depth; float shade; } push;
layout(location = 0) out vec4 color;
layout(location = 1) out uint word;
void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    color = vec4(push.shade, gl_FragCoord.xy, source[0]);
    word = source[uint(at.x) % uint(source.length())];
    gl_FragDepth = push.depth + gl_FragCoord.x / 1024.0;
}
