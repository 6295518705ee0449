#version 460
// Every pixel says where it is.
layout(local_size_x = 8, local_size_y = 8) in;
layout(set = 0, binding = 0, rgba32f) writeonly uniform image2D canvas;
void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    if (all(lessThan(at, imageSize(canvas)))) imageStore(canvas, at, vec4(at, at.x * 100 + at.y, 1));
}
