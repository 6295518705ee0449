#version 460
// One step of a recurrence in place: each depends on the one before.
layout(local_size_x = 64) in;
layout(set = 0, binding = 0, std430) buffer Data { uint data[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < data.length()) data[i] = data[i] * 3 + i;
}
