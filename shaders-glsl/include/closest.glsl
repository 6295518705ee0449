// A texel of Closest: of a pixel's samples the nearest hit's distance (f32 bits, +inf where all missed), its sample with the distance
// of the farthest hit, its instance, its triangle.
#ifndef CLOSEST_GLSL
#define CLOSEST_GLSL

// The second word: a sample's number, of which there are at most 256, below the upper bits of a distance.
const uint CLOSEST_SAMPLE = 0xffu;

uint closest_sample(uvec4 closest) {
    return closest.y & CLOSEST_SAMPLE;
}

// At least the distance of the pixel's farthest hit, m, by a share of 2⁻¹⁵ more; 0 where all missed.
float farthest_m(uvec4 closest) {
    return uintBitsToFloat(closest.y & ~CLOSEST_SAMPLE);
}

// A distance, rounded up to what is kept of the farthest.
uint farthest_bits(float distance_m) {
    return (floatBitsToUint(distance_m) + CLOSEST_SAMPLE) & ~CLOSEST_SAMPLE;
}

#endif
