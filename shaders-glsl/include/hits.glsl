// Where a sample's hit lies. A buffer holds a *group* of sample planes, a pixel's samples side by side, so that whoever looks at all
// samples of a pixel reads one place; there are as many groups as keep every buffer below the device's limit.
#ifndef HITS_GLSL
#define HITS_GLSL

#include "frame.glsl"

#ifndef HITS_ACCESS
#define HITS_ACCESS readonly
#endif

// Instance and triangle; NO_INSTANCE where the sample missed.
layout(std430, binding = 15) HITS_ACCESS buffer Hits { uvec2 hits[]; };

uint hit_index(uint pixel, uint s) {
    return pixel * setup.planes_a_group + s % setup.planes_a_group;
}

#endif
