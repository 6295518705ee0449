#version 460
// target[i] = source[i] * FACTOR + push.add, for i below push.count.
layout(local_size_x = 64) in;
layout(constant_id = 3) const uint FACTOR = 1;
layout(set = 0, binding = 0, std430) readonly buffer Source { uint source[]; };
layout(set = 0, binding = 2, std430) writeonly buffer Target { uint target[]; };
layout(push_constant) uniform Push { uint count; uint add; } push;
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < push.count) target[i] = source[i] * FACTOR + push.add;
}
