// The part of a point's look that depends on the eye: rays start from the eye's line of sight, never from the projector's ray
// (PAPER.md, Figure 8). Whitted's tree (CACM 23(6), 1980) with glTF's materials, as a loop over a bounded stack of waiting rays.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/primary_hit.glsl"
#include "include/light.glsl"
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
    uint live[];
};

// One sample stands for its pixel: the one nearest to the middle.
layout(constant_id = 5) const uint ONE_FOR_ALL = 0u;

// A sample follows at most this many rays, and none that carries less than this.
const uint MAX_RAYS = 24u;
const float MIN_THROUGHPUT = 1.0 / 256.0;
// Shadow rays of one surface wait together.
const uint MAX_LIGHTS = 32u;

// What a turn of the loop begins with.
const int START = 0;     // the lit point of the next sample
const int FOLLOW = 1;    // a waiting ray
const int SEARCH = 2;    // the line of sight, on which a virtual thing may stand before the point
const int TAKE_BACK = 3; // the point once more: what the eye-independent pass has put there is hidden by a virtual thing

// What a ray is sent for.
const uint FOR_LOOK = 0u;    // the look of what it meets
const uint FOR_LIGHT = 1u;   // whether a light is seen

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

struct Waiting {
    vec3 origin;
    vec3 direction;
    vec3 throughput;  // toward a light: what it brings where nothing stands between
    vec3 along;       // absorption of the body that the ray travels in, 1/m; toward a light: transmittance so far
    float t_min;
    float t_max;
    uint depth;
    uint purpose;
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

Waiting waiting[MAX_RAYS + MAX_LIGHTS];
uint waiting_count;
uint rays_made;

void follow(Waiting w) {
    if (w.depth > setup.max_depth || rays_made >= MAX_RAYS || max(w.throughput.x, max(w.throughput.y, w.throughput.z)) < MIN_THROUGHPUT) {
        return;
    }
    waiting[waiting_count++] = w;
    ++rays_made;
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
    float coat = s.clearcoat > 0.0 && !inside && !sight.takes_back ? s.clearcoat * fresnel_dielectric(n_v, 1.5) : 0.0;

    // Reflection by the base layer.
    vec3 below = throughput * (1.0 - coat);
    vec3 f = base_fresnel(s, n_v, inside);
    if (!sight.takes_back && max(f.x, max(f.y, f.z)) > 0.0) {
        float share, cos_i;
        vec3 d = lobe_direction(s, v, s.roughness, pixel, s_index, share, cos_i);
        vec3 f_lobe = s.roughness >= MIRROR_ROUGHNESS ? base_fresnel(s, cos_i, inside) : f;
        follow(Waiting(outside_origin, d, below * f_lobe * share, sight.absorption_per_m, 0.0, 3.0e38, sight.depth + 1u, FOR_LOOK));
    }

    // Reflection by the coat.
    if (coat > 0.0) {
        float share, cos_i;
        vec3 d = lobe_direction(s, v, s.clearcoat_roughness, pixel, s_index, share, cos_i);
        follow(Waiting(outside_origin, d, throughput * coat * share, sight.absorption_per_m, 0.0, 3.0e38, sight.depth + 1u, FOR_LOOK));
    }

    // Transmission: bent where the body is closed, straight through a thin sheet.
    if (!sight.takes_back && s.transmission > 0.0) {
        bool solid = s.thickness > 0.0;
        float eta = inside ? 1.0 / s.ior : s.ior;
        float reflected = fresnel_dielectric(n_v, solid ? eta : s.ior);
        vec3 through = below * s.base * (s.transmission * (1.0 - s.metallic) * (1.0 - reflected));
        vec3 d = solid ? refract(-v, s.normal, 1.0 / eta) : -v;
        if (dot(d, d) > 0.0) {
            bool enters = solid && !inside;
            follow(Waiting(offset_origin(s.position, -s.normal_geometric), normalize(d), through,
                           enters ? s.absorption_per_m : (solid ? vec3(0.0) : sight.absorption_per_m), 0.0, 3.0e38, sight.depth + 1u,
                           FOR_LOOK));
        }
    }

    // Lights: one shadow ray each serves the diffuse part (not at the point: another pass has it) and the highlights. They wait on
    // top, so that no other surface's are among them.
    vec3 diffuse = sight.is_point && !sight.takes_back ? vec3(0.0) : diffuse_color(s);
    bool has_lobe = !sight.takes_back && (specular_scale(s) > 0.0 && s.roughness >= MIRROR_ROUGHNESS ||
                                          s.clearcoat > 0.0 && s.clearcoat_roughness >= MIRROR_ROUGHNESS);
    if (!sight.is_point || sight.takes_back) {
        radiance += throughput * (under_coat(s) * s.emissive + diffuse * irradiance_over_pi(s.normal));
    }
    uint light_count = has_lobe || max(diffuse.x, max(diffuse.y, diffuse.z)) > 0.0 ? setup.light_count : 0u;
    uint i = 0u;
    while (true) {
        if (i < light_count) {
            Ray ray;
            vec3 lux = unshadowed(light_of(i), s, outside_origin, ray);
            vec3 l = ray.direction;
            vec3 response = diffuse * (max(dot(s.normal, l), 0.0) / PI);
            if (has_lobe) {
                float v_h = max(dot(v, normalize(v + l)), 0.0);
                response += (1.0 - coat) * highlight(s.normal, v, l, s.roughness, base_fresnel(s, v_h, inside));
                response += s.clearcoat * highlight(s.normal, v, l, s.clearcoat_roughness, vec3(fresnel_dielectric(v_h, 1.5)));
            }
            vec3 brings = throughput * lux * response;
            if (brings != vec3(0.0)) {
                waiting[waiting_count++] = Waiting(ray.origin, l, brings, vec3(1.0), 0.0, ray.t_max, sight.depth, FOR_LIGHT);
                ++shadow_rays_made;
            }
        }
        if (++i >= light_count) {
            break;
        }
    }
    return radiance;
}

// What the eye sees of a sample beside its eye-independent light. `on`: instance and triangle that its primary ray met.
vec3 look_of(uvec2 pixel, uint s_index, uvec2 on) {
    vec3 radiance = vec3(0.0);
    vec3 eye = vec3(0.0); // that the point is shown to
    vec3 point = vec3(0.0);
    waiting_count = 0u;
    rays_made = 0u;

    // Every turn of this loop walks one ray, if any, and looks at one surface: the point itself, what the ray met, or the point once
    // more. Rays of every kind share the turn's one walk, because a driver that runs both sides of a branch would make each lane
    // wait for all kinds. The loop ends at its bottom, as traverse.glsl says.
    int turn = START;
    while (true) {
        // The ray: one that waits, or the eye's way to the point.
        Waiting w = Waiting(vec3(0.0), vec3(0.0, 0.0, 1.0), vec3(1.0), vec3(0.0), 0.0, -1.0, 0u, FOR_LOOK);
        if (turn == FOLLOW) {
            w = waiting[--waiting_count];
        }
        bool searches = turn == SEARCH;
        if (searches) {
            w.origin = eye;
            w.direction = normalize(point - eye);
            w.t_max = length(point - eye) * (1.0 - 1e-5);
        }
        bool for_light = w.purpose == FOR_LIGHT;
        Hit hit;
        Ray ray = Ray(w.origin, w.direction, w.t_min, w.t_max);
        bool blocked = traverse(ray, searches ? ROLE_VIRTUAL : EVERYTHING, for_light ? SHADOW : CLOSEST, hit);
        if (RECORD_RAYS != 0u && (turn == FOLLOW || searches)) {
            record_ray(for_light ? RAY_SHADOW : (searches ? RAY_VIRTUAL : RAY_SECONDARY), ray, hit);
        }
        secondary_rays_made += (turn == FOLLOW && !for_light) || searches ? 1u : 0u;

        // The surface that this turn is about. Where no virtual thing was met, the line of sight ends at the point.
        bool met = hit.instance != NO_INSTANCE;
        bool at_point = turn != FOLLOW && !met;
        Ray primary = sample_ray(pixel, s_index);
        Sight sight;
        uvec2 found = met ? uvec2(hit.instance, hit.triangle) : on;
        vec2 barycentric = met ? hit.barycentric : meet_again(primary, found.x, found.y);
        sight.s = surface_at(found.x, found.y, barycentric);
        vec3 came = met ? w.direction : primary.direction;

        // Light that a thing lets through goes on behind it, unbent.
        if (TRANSMISSIVE != 0u && for_light && met && !blocked) {
            vec3 left = w.along * shadow_crossing(sight.s, came);
            if (max(left.x, max(left.y, left.z)) > MIN_TRANSMITTANCE) {
                waiting[waiting_count].along = left;
                waiting[waiting_count].t_min = hit.t;
                ++waiting_count;
            }
        }

        sight.inside = turn_to(sight.s, came);
        bool seen = true;
        if (turn == START) {
            seen = viewer_of(sight.s, eye);
            point = sight.s.position;
        }
        sight.v = at_point && EYE_AT_PROJECTOR == 0u ? normalize(eye - sight.s.position) : -came;
        sight.throughput = turn == TAKE_BACK ? vec3(-1.0) : w.throughput * exp(-w.along * (met ? hit.t : 0.0));
        sight.absorption_per_m = w.along;
        sight.depth = w.depth;
        sight.is_point = at_point;
        sight.takes_back = turn == TAKE_BACK;

        // What comes of it. Of the samples of a listed pixel some may land on what stays dark, or what looks the same to every eye.
        bool dark = (sight.s.flags & ROLE_MASK) != 0u;
        bool eye_light = depends_on_eye(sight.s);
        bool looks_first = turn == START && seen && !dark && setup.virtual_count > 0u && EYE_AT_PROJECTOR == 0u;
        bool shades = met ? !for_light && !dark
                          : turn == START && (EYE_AT_PROJECTOR != 0u || seen) && !dark && eye_light && !looks_first ||
                                turn == TAKE_BACK || searches && eye_light;
        if (turn == FOLLOW && !met) {
            radiance += w.throughput * (for_light ? w.along : environment_radiance(w.direction));
        }
        if (shades) {
            radiance += shade(sight, pixel, s_index);
        }

        // What is next.
        turn = looks_first ? SEARCH : (searches && met ? TAKE_BACK : FOLLOW);
        if (waiting_count == 0u && turn == FOLLOW) {
            break;
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
