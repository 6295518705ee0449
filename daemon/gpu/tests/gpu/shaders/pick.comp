#version 460
// Reads an image through the sampler, at pixel centres and beyond the edge.
layout(local_size_x = 8, local_size_y = 8) in;
layout(constant_id = 0) const int CHANNEL = 2;
layout(set = 0, binding = 0) uniform sampler2D picture;
layout(set = 0, binding = 1, std430) writeonly buffer Target { float target[]; };
void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    ivec2 size = textureSize(picture, 0);
    // One more column than the picture has: the sampler clamps it to the last.
    if (at.x > size.x || at.y >= size.y) return;
    target[at.y * (size.x + 1) + at.x] = textureLod(picture, (vec2(at) + 0.5) / vec2(size), 0)[CHANNEL];
}
