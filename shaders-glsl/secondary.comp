// The part of a point's look that depends on the eye: rays start from the eye's line of sight, never from the projector's ray
// (PAPER.md, Figure 8). Whitted's tree (CACM 23(6), 1980) with glTF's materials, as a loop over a bounded stack of waiting rays.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/primary_hit.glsl"
#include "include/light.glsl"
#include "include/hits.glsl"
#include "include/live.glsl"

#include "include/waiting.glsl"

#define LOOK_ACCESS
#include "include/look.glsl"

layout(local_size_x = 64) in; // LIVE_GROUP

// The naive method, which reflects the projector's own ray; for the test that shows it to be wrong.
layout(constant_id = 0) const uint EYE_AT_PROJECTOR = 0u;

// The pixels to visit; no other one is.
layout(std430, binding = 28) readonly buffer Live {
    uvec3 live_groups; // of the indirect dispatch
    uint live_count;
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

// A surface as a ray sees it.
struct Sight {
    Surface s;
    vec3 v;                // back along the ray
    vec3 throughput;
    vec3 absorption_per_m; // of the body that the ray came through
    uint depth;
    bool inside;           // the ray is about to leave a body that refracts
    bool is_point;         // the projector's point, whose diffuse light and emission another pass has
    bool takes_back;       // the same, to be taken back
};

// The nearest viewer that stands in front of the surface; false where none does.
bool viewer_of(Surface s, out vec3 eye) {
    float nearest = 3.0e38;
    for (uint i = 0u; i < setup.viewer_count; ++i) {
        vec3 way = frame.viewers[i].xyz - s.position;
        float d = length(way);
        if (d < nearest && dot(way, s.normal) > 0.0) {
            nearest = d;
            eye = frame.viewers[i].xyz;
        }
    }
    return nearest < 3.0e38;
}

// The direction in which a lobe sends the ray that arrived along −v, and the share that masking leaves; black below the surface.
vec3 lobe_direction(Surface s, vec3 v, float roughness, uvec2 pixel, uint s_index, out float share, out float cos_i) {
    share = 1.0;
    cos_i = max(dot(s.normal, v), 0.0);
    vec3 m = s.normal;
    float alpha = roughness * roughness;
    if (roughness >= MIRROR_ROUGHNESS) {
        m = sample_visible_normal(s.normal, v, alpha, secondary_random(pixel, s_index, rays_made));
        cos_i = max(dot(m, v), 0.0);
    }
    vec3 d = reflect(-v, m);
    float n_d = dot(d, s.normal);
    if (roughness >= MIRROR_ROUGHNESS) {
        // G2/G1, what is left of the estimator when visible normals are sampled (Heitz 2018, section 3).
        float lambda_v = ggx_lambda(dot(s.normal, v), alpha);
        share = n_d > 0.0 ? (1.0 + lambda_v) / (1.0 + lambda_v + ggx_lambda(n_d, alpha)) : 0.0;
    } else if (dot(d, s.normal_geometric) <= 0.0) {
        // A bent shading normal may send a mirror ray below the true surface: lift it to the horizon.
        d = normalize(d - s.normal_geometric * (dot(d, s.normal_geometric) - 1e-3));
    }
    if (dot(d, s.normal_geometric) <= 0.0) {
        share = 0.0;
    }
    return d;
}

// What a sight sends to the eye by itself, times its throughput; the rays that it needs besides are put among the waiting ones.
vec3 shade(Sight sight, uvec2 pixel, uint s_index) {
    Surface s = sight.s;
    vec3 v = sight.v;
    vec3 throughput = sight.throughput;
    bool inside = sight.inside;
    vec3 radiance = vec3(0.0);
    float n_v = max(dot(s.normal, v), 1e-4);
    vec3 outside_origin = offset_origin(s.position, s.normal_geometric);

    // The coat reflects first; the specular lobe below it gets the rest.
    float coat = COATED != 0u && s.clearcoat > 0.0 && !inside && !sight.takes_back ? s.clearcoat * fresnel_dielectric(n_v, 1.5) : 0.0;

    // Reflection by the base layer.
    LookRay ray;
    ray.depth = sight.depth + 1u;
    ray.origin = outside_origin;
    ray.absorption_per_m = sight.absorption_per_m;
    vec3 below = throughput * (1.0 - coat);
    vec3 f = base_fresnel(s, n_v, inside);
    if (!sight.takes_back && max(f.x, max(f.y, f.z)) > 0.0) {
        float share, cos_i;
        ray.direction = lobe_direction(s, v, s.roughness, pixel, s_index, share, cos_i);
        vec3 f_lobe = s.roughness >= MIRROR_ROUGHNESS ? base_fresnel(s, cos_i, inside) : f;
        ray.throughput = below * f_lobe * share;
        if (is_worth_following(ray)) {
            next = ray;
            has_next = true;
        }
    }

    // Reflection by the coat.
    bool reflects_twice = false;
    LookRay by_coat = ray;
    if (COATED != 0u && coat > 0.0) {
        float share, cos_i;
        by_coat.direction = lobe_direction(s, v, s.clearcoat_roughness, pixel, s_index, share, cos_i);
        by_coat.throughput = throughput * coat * share;
        reflects_twice = is_worth_following(by_coat);
    }

    // Transmission: bent where the body is closed, straight through a thin sheet.
    bool passes = false;
    LookRay passing = ray;
    if (TRANSMISSIVE != 0u && !sight.takes_back && s.transmission > 0.0) {
        bool solid = s.thickness > 0.0;
        float eta = inside ? 1.0 / s.ior : s.ior;
        float reflected = fresnel_dielectric(n_v, solid ? eta : s.ior);
        passing.throughput = below * s.base * (s.transmission * (1.0 - s.metallic) * (1.0 - reflected));
        vec3 d = solid ? refract(-v, s.normal, 1.0 / eta) : -v;
        if (dot(d, d) > 0.0) {
            bool enters = solid && !inside;
            passing.origin = offset_origin(s.position, -s.normal_geometric);
            passing.direction = normalize(d);
            passing.absorption_per_m = enters ? s.absorption_per_m : (solid ? vec3(0.0) : sight.absorption_per_m);
            passes = is_worth_following(passing);
        }
    }
    follow_besides(reflects_twice, by_coat, passes, passing);

    // Lights: one shadow ray each serves the diffuse part (not at the point: another pass has it) and the highlights.
    vec3 diffuse = sight.is_point && !sight.takes_back ? vec3(0.0) : diffuse_color(s);
    bool has_lobe = !sight.takes_back && (specular_scale(s) > 0.0 && s.roughness >= MIRROR_ROUGHNESS ||
                                          COATED != 0u && s.clearcoat > 0.0 && s.clearcoat_roughness >= MIRROR_ROUGHNESS);
    if (!sight.is_point || sight.takes_back) {
        radiance += throughput * (under_coat(s) * s.emissive + diffuse * irradiance_over_pi(s.normal));
    }
    uint light_count = has_lobe || max(diffuse.x, max(diffuse.y, diffuse.z)) > 0.0 ? setup.light_count : 0u;
    uint i = 0u;
    while (true) {
        if (i < light_count) {
            Ray to_light;
            vec3 lux = unshadowed(light_of(i), s, outside_origin, to_light);
            vec3 l = to_light.direction;
            vec3 response = diffuse * (max(dot(s.normal, l), 0.0) / PI);
            if (has_lobe) {
                float v_h = max(dot(v, normalize(v + l)), 0.0);
                response += (1.0 - coat) * highlight(s.normal, v, l, s.roughness, base_fresnel(s, v_h, inside));
                if (COATED != 0u) {
                    response += s.clearcoat * highlight(s.normal, v, l, s.clearcoat_roughness, vec3(fresnel_dielectric(v_h, 1.5)));
                }
            }
            vec3 brings = throughput * lux * response;
            if (brings != vec3(0.0)) {
                ask(ShadowRay(outside_origin, l, to_light.t_max, brings));
                ++shadow_rays_made;
            }
        }
        if (MANY_LIGHTS == 0u || ++i >= light_count) {
            break;
        }
    }
    return radiance;
}

// What the eye sees of a sample beside its eye-independent light. `on`: instance and triangle that its primary ray met.
vec3 look_of(uvec2 pixel, uint s_index, uvec2 on) {
    vec3 radiance = vec3(0.0);
    begin_waiting();

    // The point, and the eye that it is shown to. Of the samples of a listed pixel some may land on what stays dark, or what looks the same
    // to every eye.
    Ray primary = sample_ray(pixel, s_index);
    vec2 on_barycentric = meet_again(primary, on.x, on.y);
    Sight sight;
    sight.s = surface_at(on.x, on.y, on_barycentric);
    sight.inside = turn_to(sight.s, primary.direction);
    vec3 eye = vec3(0.0);
    bool seen = viewer_of(sight.s, eye) && (sight.s.flags & ROLE_MASK) == 0u;
    vec3 point = sight.s.position;
    int turn = FOLLOW;
    if (LOOKS_FIRST) {
        turn = seen ? SEARCH : FOLLOW;
    } else {
        sight.v = EYE_AT_PROJECTOR == 0u ? normalize(eye - point) : -primary.direction;
        sight.throughput = vec3(1.0);
        sight.absorption_per_m = vec3(0.0);
        sight.depth = 0u;
        sight.is_point = true;
        sight.takes_back = false;
        if ((EYE_AT_PROJECTOR != 0u ? (sight.s.flags & ROLE_MASK) == 0u : seen) && depends_on_eye(sight.s)) {
            radiance += shade(sight, pixel, s_index);
        }
    }

    // Every turn of this loop walks one ray, if any, and looks at one surface: what the ray met, or the point once more. Rays of every
    // kind share the turn's one walk, because a driver that runs both sides of a branch would make each lane wait for all kinds. What is
    // done once for a sample stands above, and what waits and is next is in registers. The loop ends at its bottom, as traverse.glsl says.
    while (true) {
        bool searches = LOOKS_FIRST && turn == SEARCH;
        bool takes_back = LOOKS_FIRST && turn == TAKE_BACK;
        bool for_light = !searches && !takes_back && shadow_count > 0u;
        bool follows = !searches && !takes_back && shadow_count == 0u && has_next;
        LookRay w = next;
        Ray ray = Ray(w.origin, w.direction, 0.0, follows ? 3.0e38 : -1.0);
        if (for_light) {
            ray = Ray(shadow.origin, shadow.direction, shadow_from, shadow.t_max);
        }
        if (searches) {
            ray = Ray(eye, normalize(point - eye), 0.0, length(point - eye) * (1.0 - 1e-5));
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
            hit.instance = on.x;
            hit.triangle = on.y;
            hit.barycentric = on_barycentric;
            came = primary.direction;
        }
        uint instance = met || at_point ? hit.instance : on.x;
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
        sight.v = at_point ? normalize(eye - sight.s.position) : -came;
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
    uint planes = ONE_FOR_ALL != 0u ? 1u : setup.planes_a_group;
    uint pixels = LIVE_GROUP / planes;
    uint lane = gl_LocalInvocationIndex;
    uint at = (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * pixels + lane / planes;
    bool is_listed = lane < pixels * planes && at < live_count;
    uint index = live[is_listed ? at : 0u];
    uvec2 pixel = pixel_of(index);
    uint middle = middle_sample(pixel);
    uint s_index = ONE_FOR_ALL != 0u ? middle : push.sample_index + lane % planes;

    // The sample that was shaded for all, and did not do, is not shaded again.
    PixelLook before = look[index];
    bool has_middle = ONE_FOR_ALL == 0u && before.code != NOT_BEGUN;
    record_for(index, s_index);
    uvec2 on = hits[hit_index(index, s_index)];
    vec3 mine = vec3(0.0);
    if (is_listed && on.x != NO_INSTANCE && !(has_middle && s_index == middle)) {
        mine = look_of(pixel, s_index, on);
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
