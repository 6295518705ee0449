// The part of a point's look that depends on the eye: rays start from the eye's line of sight, never from the projector's ray
// (PAPER.md, Figure 8). Whitted's tree (CACM 23(6), 1980) with glTF's materials, as a loop over a bounded stack of waiting rays.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/primary_hit.glsl"
#include "include/sight.glsl"
#include "include/hits.glsl"
#include "include/live.glsl"

#define LOOK_ACCESS
#include "include/look.glsl"

layout(local_size_x = 64) in; // LIVE_GROUP

// The naive method, which reflects the projector's own ray; for the test that shows it to be wrong.
layout(constant_id = 0) const uint EYE_AT_PROJECTOR = 0u;

// The pixels to visit; no other one is.
layout(std430, binding = 28) readonly buffer Live {
    uvec3 live_groups; // of the indirect dispatch
    uint live_count;
    uint live_rest;    // those at the list's end, of which one sample was shaded before
    uint live[];
};

// One sample stands for its pixel: the one nearest to the middle.
layout(constant_id = 5) const uint ONE_FOR_ALL = 0u;

// Whether a virtual thing is looked for on the eye's way to the point before the point is.
const bool LOOKS_FIRST = VIRTUAL != 0u && EYE_AT_PROJECTOR == 0u;

// What a turn of the loop begins with.
const int FOLLOW = 0;    // a waiting ray
const int SEARCH = 1;    // the line of sight, on which a virtual thing may stand before the point
const int TAKE_BACK = 2; // the point once more: what the eye-independent pass has put there is hidden by a virtual thing

// A sample's point, and the eye that it is shown to.
struct Point {
    uvec2 on; // instance and triangle
    vec2 barycentric;
    vec3 position;
    vec3 came; // the way of the projector's ray
    vec3 eye;
};

// What the sample's point shows to the eye at once; what it needs rays for is among the waiting ones. The loop begins with `turn`.
vec3 first_look(uvec2 pixel, uint s_index, uvec2 on, out Point point, out int turn) {
    // Of the samples of a listed pixel some may land on what stays dark, or what looks the same to every eye.
    Ray primary = sample_ray(pixel, s_index);
    Sight sight;
    point.on = on;
    point.barycentric = meet_again(primary, on.x, on.y);
    point.came = primary.direction;
    sight.s = surface_at(on.x, on.y, point.barycentric);
    sight.inside = turn_to(sight.s, primary.direction);
    point.position = sight.s.position;
    point.eye = vec3(0.0);
    bool seen = viewer_of(sight.s, point.eye) && (sight.s.flags & ROLE_MASK) == 0u;
    turn = LOOKS_FIRST && seen ? SEARCH : FOLLOW;
    vec3 radiance = vec3(0.0);
    if (!LOOKS_FIRST) {
        sight.v = EYE_AT_PROJECTOR == 0u ? normalize(point.eye - point.position) : -primary.direction;
        sight.throughput = vec3(1.0);
        sight.absorption_per_m = vec3(0.0);
        sight.depth = 0u;
        sight.is_point = true;
        sight.takes_back = false;
        if ((EYE_AT_PROJECTOR != 0u ? (sight.s.flags & ROLE_MASK) == 0u : seen) && depends_on_eye(sight.s)) {
            radiance = shade(sight, pixel, s_index);
        }
    }
    return radiance;
}

// `radiance`, and what the waiting rays bring and those that come of them.
vec3 follow(vec3 radiance, uvec2 pixel, uint s_index, Point point, int turn) {
    Sight sight;

    // Every turn of this loop walks one ray, if any, and looks at one surface: what the ray met, or the point once more. Rays of every
    // kind share the turn's one walk, because a driver that runs both sides of a branch would make each lane wait for all kinds. What is
    // done once for a sample stands above, and what waits and is next is in registers. The loop ends at its bottom, as traverse.glsl says.
    while (true) {
        bool searches = LOOKS_FIRST && turn == SEARCH;
        bool takes_back = LOOKS_FIRST && turn == TAKE_BACK;
        bool for_light = LIGHTS != 0u && !searches && !takes_back && shadow_count > 0u;
        bool follows = !searches && !takes_back && shadow_count == 0u && has_next;
        LookRay w = next;
        Ray ray = Ray(w.origin, w.direction, 0.0, follows ? 3.0e38 : -1.0);
        if (for_light) {
            ray = Ray(shadow.origin, shadow.direction, shadow_from, shadow.t_max);
        }
        if (searches) {
            vec3 way = point.position - point.eye;
            ray = Ray(point.eye, normalize(way), 0.0, length(way) * (1.0 - 1e-5));
        }
        Hit hit;
        bool blocked = traverse(ray, searches ? ROLE_VIRTUAL : EVERYTHING, for_light ? SHADOW : CLOSEST, hit);
        if (RECORD_RAYS != 0u && (follows || for_light || searches)) {
            record_ray(for_light ? RAY_SHADOW : (searches ? RAY_VIRTUAL : RAY_SECONDARY), ray, hit);
        }
        secondary_rays_made += follows || searches ? 1u : 0u;

        // The surface that this turn is about. Where no virtual thing was met, the line of sight ends at the point.
        bool met = hit.instance != NO_INSTANCE;
        bool at_point = (searches || takes_back) && !met;
        vec3 came = ray.direction;
        if (at_point) {
            hit.instance = point.on.x;
            hit.triangle = point.on.y;
            hit.barycentric = point.barycentric;
            came = point.came;
        }
        uint instance = met || at_point ? hit.instance : point.on.x;
        sight.s = surface_at(instance, hit.triangle, hit.barycentric);

        // Light that a thing lets through goes on behind it, unbent.
        bool goes_on = false;
        if (TRANSMISSIVE != 0u && for_light && met && !blocked) {
            shadow_left *= shadow_crossing(sight.s, came);
            shadow_from = hit.t;
            goes_on = max(shadow_left.x, max(shadow_left.y, shadow_left.z)) > MIN_TRANSMITTANCE;
        }

        // What comes of it.
        if (for_light && !met) {
            radiance += shadow.brings * shadow_left;
        }
        if (follows && !met) {
            radiance += w.throughput * environment_radiance(w.direction);
        }
        if (for_light && !goes_on) {
            end_shadow();
        }
        if (follows) {
            has_next = false;
        }
        sight.inside = turn_to(sight.s, came);
        sight.v = at_point ? normalize(point.eye - sight.s.position) : -came;
        sight.throughput = w.throughput;
        sight.absorption_per_m = w.absorption_per_m;
        if (TRANSMISSIVE != 0u) {
            sight.throughput *= exp(-w.absorption_per_m * (met ? hit.t : 0.0));
        }
        sight.depth = w.depth;
        if (searches || takes_back) {
            sight.throughput = vec3(takes_back ? -1.0 : 1.0);
            sight.absorption_per_m = vec3(0.0);
            sight.depth = 0u;
        }
        sight.is_point = at_point;
        sight.takes_back = takes_back;
        bool dark = (sight.s.flags & ROLE_MASK) != 0u;
        if (met ? !for_light && !dark : takes_back || searches && depends_on_eye(sight.s)) {
            radiance += shade(sight, pixel, s_index);
        }

        // What is next.
        turn = searches && met ? TAKE_BACK : FOLLOW;
        if (turn == FOLLOW) {
            take_next();
            if (!has_next && shadow_count == 0u) {
                break;
            }
        }
    }
    return radiance;
}

shared vec3 looks[LIVE_GROUP];

void main() {
    // A lane a sample, so that lanes beside each other follow nearly the same paths.
    uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    uint planes = ONE_FOR_ALL != 0u ? 1u : setup.planes_a_group;
    uint groups = groups_of(live_count, LIVE_GROUP / planes);
    bool has_middle = ONE_FOR_ALL == 0u && group >= groups;
    if (has_middle) {
        group -= groups;
        planes = rest_lanes();
    }
    uint pixels = LIVE_GROUP / planes;
    uint lane = gl_LocalInvocationIndex;
    uint at = group * pixels + lane / planes;
    bool is_listed = lane < pixels * planes && at < (has_middle ? live_rest : live_count);
    uint index = is_listed ? live[has_middle ? rest_place(at) : at] : 0u;
    uvec2 pixel = pixel_of(index);

    // The sample that was shaded for all, and did not do, is not shaded again.
    uint middle = middle_sample(pixel);
    uint s_index = ONE_FOR_ALL != 0u ? middle : push.sample_index + lane % planes;
    if (has_middle && planes < setup.planes_a_group && s_index >= middle) {
        ++s_index;
    }
    PixelLook before = look[index];
    uvec2 on = hits[hit_index(index, s_index)];
    bool has_look = is_listed && on.x != NO_INSTANCE && !(has_middle && s_index == middle);
    vec3 mine = vec3(0.0);
    record_for(index, s_index);
    if (has_look) {
        Point point;
        int turn;
        begin_waiting();
        mine = first_look(pixel, s_index, on, point, turn);
        mine = follow(mine, pixel, s_index, point, turn);
    }
    looks[lane] = mine;
    barrier();

    // The pixel's first lane gathers; sums go on from one group of planes to the next.
    if (is_listed && lane % planes == 0u) {
        bool goes_on = push.sample_index != 0u;
        vec3 sum = goes_on ? before.radiance * float(setup.samples) : (has_middle ? before.radiance : vec3(0.0));
        for (uint i = 0u; i < planes; ++i) {
            sum += looks[lane + i];
        }
        look[index] = ONE_FOR_ALL != 0u ? PixelLook(sum, code_of(sum)) : PixelLook(sum / float(setup.samples), before.code);
    }
    publish_counts(0u, 0u);
}
