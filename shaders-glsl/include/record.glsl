// The rays themselves, written down on request, for another tracer to be measured on. Without the request nothing is left of this.
// Included by traverse.glsl, which knows what a ray and a hit are.
#ifndef RECORD_GLSL
#define RECORD_GLSL

layout(constant_id = 8) const uint RECORD_RAYS = 0u;

// Kinds of rays, by what they can meet and what ends them; those below `RAY_SHADOW` look for the nearest hit, the others for any.
const uint RAY_PRIMARY = 0u;   // physical things
const uint RAY_SECONDARY = 1u; // everything
const uint RAY_VIRTUAL = 2u;   // virtual things
const uint RAY_SHADOW = 3u;    // everything
const uint RAY_BLEND = 4u;     // physical things
const uint RAY_KINDS = 5u;

struct RecordedRay {
    float origin[3];
    float t_min;
    float direction[3];
    float t_max;
    float t;
    uint instance; // NO_INSTANCE: a miss
    uint triangle;
    uint pixel;
    uint sample_index;
    uint turn; // of one sample's rays in one pass, in the order in which they were traced
};

// Twin of `RecordHead` in daemon/render/src/record.rs, and the rays that were kept, in no order.
layout(std430, binding = 32) buffer Records {
    uint wanted_kind;
    uint wanted_part; // of the rays of that kind, parted by a hash of their bits: what one buffer cannot hold comes in several frames
    uint part_count;
    uint record_room;
    uint records_kept; // more than `record_room` where some did not fit
    uint rays_traced[RAY_KINDS];
    RecordedRay recorded[];
};

uint record_pixel = 0u;
uint record_sample = 0u;
uint record_turn = 0u;

// Said before a sample's first ray: for whom its rays are.
void record_for(uint pixel, uint sample_index) {
    record_pixel = pixel;
    record_sample = sample_index;
    record_turn = 0u;
}

uint record_hash(Ray ray) {
    uvec3 o = floatBitsToUint(ray.origin);
    uvec3 d = floatBitsToUint(ray.direction);
    uint h = floatBitsToUint(ray.t_min);
    for (int i = 0; i < 3; ++i) {
        h = (h ^ o[i]) * 0x9e3779b1u;
        h = (h ^ (h >> 15u) ^ d[i]) * 0x85ebca77u;
    }
    return h ^ (h >> 13u);
}

// Called wherever a walk has ended, with what it found: the nearest hit, or for shadows and blending any.
void record_ray(uint kind, Ray ray, Hit hit) {
    if (RECORD_RAYS == 0u) {
        return;
    }
    atomicAdd(rays_traced[kind], 1u);
    uint turn = record_turn++;
    if (kind == wanted_kind && record_hash(ray) % part_count == wanted_part) {
        uint at = atomicAdd(records_kept, 1u);
        if (at < record_room) {
            bool met = hit.instance != NO_INSTANCE;
            recorded[at] = RecordedRay(float[3](ray.origin.x, ray.origin.y, ray.origin.z), ray.t_min,
                                       float[3](ray.direction.x, ray.direction.y, ray.direction.z), ray.t_max,
                                       met ? hit.t : uintBitsToFloat(0x7f800000u), hit.instance, hit.triangle, record_pixel,
                                       record_sample, turn);
        }
    }
}

// A ray that looks for the nearest of what has one of these roles.
void record_closest(uint roles, Ray ray, Hit hit) {
    record_ray(roles == PHYSICAL ? RAY_PRIMARY : (roles == EVERYTHING ? RAY_SECONDARY : RAY_VIRTUAL), ray, hit);
}

#endif
