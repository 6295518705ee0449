#version 460
// Reads a buffer and makes nothing of it.
layout(local_size_x = 1) in;
layout(set = 0, binding = 0, std430) readonly buffer Data { uint data[]; };
shared uint seen;
void main() {
    seen = data[0];
}
