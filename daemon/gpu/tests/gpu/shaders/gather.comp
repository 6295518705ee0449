#version 460
// Texel buffers of three formats and a uniform block, summed into words.
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) uniform usamplerBuffer words;
layout(set = 0, binding = 1) uniform samplerBuffer floats;
layout(set = 0, binding = 2) uniform usamplerBuffer numbers;
layout(set = 0, binding = 3) uniform Params { uvec4 weights; } params;
layout(set = 0, binding = 4, std430) writeonly buffer Target { uint target[]; };
void main() {
    int i = int(gl_GlobalInvocationID.x);
    if (i >= textureSize(words)) return;
    uvec4 w = texelFetch(words, i) * params.weights;
    uint f = uint(texelFetch(floats, i).y);
    uint n = texelFetch(numbers, i).x;
    target[i] = w.x + w.y + w.z + w.w + f * 1000u + n * 1000000u;
}
