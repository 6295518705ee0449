// The rays of one sample that still have to be followed. The one that is next stands in registers; others wait on stacks, which are memory
// that lanes index differently: lavapipe goes lane by lane and word by word through each access, wanted or not. So where a scene's rays
// cannot branch, as pipelines know when they are made, nothing of the stacks is left.
#ifndef WAITING_GLSL
#define WAITING_GLSL

#include "traverse.glsl"

// Whether any material has a clear coat, whether anything virtual is shown, and whether there is no light, one, or more (2). They are
// compared for equality alone: Mesa 22.3 compiles no shader with an order of specialisation constants.
layout(constant_id = 6) const uint COATED = 1u;
layout(constant_id = 7) const uint VIRTUAL = 1u;
layout(constant_id = 12) const uint LIGHTS = 2u;

// A sample follows at most this many rays, and none that carries less than this.
const uint MAX_RAYS = 24u;
const float MIN_THROUGHPUT = 1.0 / 256.0;
// Shadow rays of a virtual surface, and of the point behind it, wait together.
const uint MAX_SHADOWS = 64u;

// A ray that is sent for the look of what it meets.
struct LookRay {
    vec3 origin;
    vec3 direction;
    vec3 throughput;
    vec3 absorption_per_m; // of the body that it travels in
    uint depth;
};

// A ray toward a light.
struct ShadowRay {
    vec3 origin;
    vec3 direction;
    float t_max;
    vec3 brings; // where nothing stands between
};

// Rays for looks may branch; rays toward lights may be more than one.
const bool LOOKS_WAIT = COATED != 0u || TRANSMISSIVE != 0u;
const bool SHADOWS_WAIT = LIGHTS == 2u || VIRTUAL != 0u;

// Shadow rays are followed before any other, the last one first, so that there are never those of two surfaces, but where a virtual one
// hides the point.
ShadowRay shadow;
uint shadow_count; // with `shadow`
vec3 shadow_left;  // the share of `shadow` that is left where it has come
float shadow_from; // distance there, m
ShadowRay shadows[MAX_SHADOWS];

LookRay next;
bool has_next;
LookRay looks_waiting[MAX_RAYS];
uint look_count; // without `next`
uint rays_made;

void begin_waiting() {
    next = LookRay(vec3(0.0), vec3(0.0, 0.0, 1.0), vec3(1.0), vec3(0.0), 0u);
    has_next = false;
    look_count = 0u;
    rays_made = 0u;
    shadow = ShadowRay(vec3(0.0), vec3(0.0, 0.0, 1.0), -1.0, vec3(0.0));
    shadow_count = 0u;
}

// Whether this ray is to be followed, which counts it.
bool is_worth_following(LookRay ray) {
    bool is_worth = ray.depth <= setup.max_depth && rays_made < MAX_RAYS &&
                    !(max(ray.throughput.x, max(ray.throughput.y, ray.throughput.z)) < MIN_THROUGHPUT);
    rays_made += is_worth ? 1u : 0u;
    return is_worth;
}

// Up to two more rays from where `next` starts: what was next waits, and the last of them is next. In a loop, so that a surface that
// sends two rays, as most that send more than one do, pays for one access to the stack.
void follow_besides(bool has_second, LookRay second, bool has_third, LookRay third) {
    if (!LOOKS_WAIT) {
        return;
    }
    if (!has_second) {
        second = third;
        has_second = has_third;
        has_third = false;
    }
    while (true) {
        if (has_second) {
            if (has_next) {
                looks_waiting[look_count++] = next;
            }
            next = second;
            has_next = true;
            second = third;
            has_second = has_third;
            has_third = false;
        }
        if (!has_second) {
            break;
        }
    }
}

// What is followed when `next` has been, and no shadow ray waits.
void take_next() {
    if (LOOKS_WAIT && !has_next && look_count > 0u) {
        next = looks_waiting[--look_count];
        has_next = true;
    }
}

// One more toward a light.
void ask(ShadowRay ray) {
    if (SHADOWS_WAIT && shadow_count > 0u) {
        shadows[shadow_count - 1u] = shadow;
    }
    shadow = ray;
    ++shadow_count;
    shadow_left = vec3(1.0);
    shadow_from = 0.0;
}

// `shadow` has come to its end.
void end_shadow() {
    --shadow_count;
    if (SHADOWS_WAIT && shadow_count > 0u) {
        shadow = shadows[shadow_count - 1u];
    }
    shadow_left = vec3(1.0);
    shadow_from = 0.0;
}

#endif
