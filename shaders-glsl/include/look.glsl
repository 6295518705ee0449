// What the eye adds to a pixel's eye-independent light.
#ifndef LOOK_GLSL
#define LOOK_GLSL

#ifndef LOOK_ACCESS
#define LOOK_ACCESS readonly
#endif

// Linear radiance, and NOT_BEGUN or, where one sample was shaded for all, the code of its radiance.
struct PixelLook {
    vec3 radiance;
    uint code;
};

layout(std430, binding = 18) LOOK_ACCESS buffer Look { PixelLook look[]; };

const uint NOT_BEGUN = 0u;
const uint BEGUN = 0x40000000u;

// Codes of neighbours tell how far their looks lie apart: roots of radiance, near enough as sRGB codes it and on beyond 1, from −4 to 4 in
// 10 bits a channel.
uint code_of(vec3 radiance) {
    uvec3 steps = uvec3(clamp(sign(radiance) * sqrt(abs(radiance)), -4.0, 4.0) * 127.5 + 511.5);
    return BEGUN | steps.x | (steps.y << 10u) | (steps.z << 20u);
}

// The largest difference of any channel, in roots of radiance.
float apart(uint a, uint b) {
    ivec3 steps = abs(ivec3(a & 1023u, (a >> 10u) & 1023u, (a >> 20u) & 1023u) - ivec3(b & 1023u, (b >> 10u) & 1023u, (b >> 20u) & 1023u));
    return float(max(steps.x, max(steps.y, steps.z))) / 127.5;
}

#endif
