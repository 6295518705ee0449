// Numbers on the fly: a counter-based generator keyed by a small per-projector state buffer, so that the same seed gives the
// same image and no thread shares a state (PAPER.md, Ray Generation).
#ifndef RANDOM_GLSL
#define RANDOM_GLSL

layout(std430, binding = 14) readonly buffer SampleState { uint sample_state[]; };

// Jarzynski and Olano, Hash Functions for GPU Rendering, JCGT 9(3), 2020.
uvec3 pcg3d(uvec3 v) {
    v = v * 1664525u + 1013904223u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v ^= v >> 16u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    return v;
}

// 24 bits each, in [0, 1).
vec2 unit_square(uvec3 key) {
    return vec2(pcg3d(key).xy >> 8u) * (1.0 / 16777216.0);
}

// Where sample s of a pixel lies, px from the pixel's corner: a jittered grid of strata; the centre for a single sample.
vec2 sample_offset(uvec2 pixel, uint s) {
    if (setup.samples == 1u) {
        return vec2(0.5);
    }
    vec2 stratum = vec2(s % setup.strata, s / setup.strata);
    return (stratum + unit_square(uvec3(pixel, s ^ sample_state[s]))) / float(setup.strata);
}

const uint NO_SAMPLE = 0xffffffffu;

// A sample near its pixel's middle: of a grid of 2 × 2 whose hits all lie in one group the nearest, else the one of the stratum there.
uint middle_sample(uvec2 pixel) {
    uint low = (setup.strata - 1u) / 2u;
    uint high = setup.strata == 2u && setup.planes_a_group == 4u ? 1u : low;
    uint nearest = low * setup.strata + low;
    float distance2 = 2.0;
    for (uint i = 0u; i < 4u; ++i) {
        uint s = ((i & 2u) == 0u ? low : high) * setup.strata + ((i & 1u) == 0u ? low : high);
        vec2 off = sample_offset(pixel, s) - 0.5;
        nearest = dot(off, off) < distance2 ? s : nearest;
        distance2 = min(distance2, dot(off, off));
    }
    return nearest;
}

// Two numbers for the ray-th secondary ray of a sample.
vec2 secondary_random(uvec2 pixel, uint s, uint ray) {
    return unit_square(uvec3(pixel, ((s << 16u) | (ray << 8u) | 1u) ^ sample_state[s]));
}

#endif
