// Rays by kind, counted on request: benches and the tests of what is stale read them. Without the request nothing is left of this.
#ifndef COUNTERS_GLSL
#define COUNTERS_GLSL

layout(constant_id = 1) const uint COUNT_RAYS = 0u;

layout(std430, binding = 27) buffer Counters {
    uint primary_rays;
    uint secondary_rays;
    uint shadow_rays;
    uint blend_rays;
    uint most_steps; // of one invocation, all its loops together: lavapipe 22.3 ends them silently at 65,535
};

uint steps_taken = 0u;
uint shadow_rays_made = 0u;
uint secondary_rays_made = 0u;
uint blend_rays_made = 0u;

void count_step() {
    if (COUNT_RAYS != 0u) {
        ++steps_taken;
    }
}

// Called once at the end of an invocation.
void publish_counts(uint primary, uint blend) {
    if (COUNT_RAYS != 0u) {
        atomicAdd(primary_rays, primary);
        atomicAdd(blend_rays, blend);
        atomicAdd(secondary_rays, secondary_rays_made);
        atomicAdd(shadow_rays, shadow_rays_made);
        atomicMax(most_steps, steps_taken);
    }
}

#endif
