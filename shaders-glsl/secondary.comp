// The part of a point's look that depends on the eye: rays start from the eye's line of sight, never from the projector's ray
// (PAPER.md, Figure 8). Whitted's tree (CACM 23(6), 1980) with glTF's materials, as a loop over a bounded stack of waiting rays.
#version 460
#extension GL_GOOGLE_include_directive : require

#define MATERIALS_KNOWN
#include "include/frame.glsl"
#include "include/primary_hit.glsl"
#include "include/light.glsl"

layout(local_size_x = 64) in;

// The naive method, which reflects the projector's own ray; for the test that shows it to be wrong.
layout(constant_id = 0) const uint EYE_AT_PROJECTOR = 0u;

layout(std430, binding = 15) readonly buffer Hits { uvec2 hits[]; };

// Mean over the samples so far of what is to be added to the eye-independent light; starts at 0.
layout(std430, binding = 18) buffer Look { vec4 look[]; };

// The pixels whose look depends on the eye, in this plane: no other one is visited.
layout(std430, binding = 28) readonly buffer Live {
    uvec3 live_groups; // of the indirect dispatch
    uint live_count;
    uint live[];
};

// A sample follows at most this many rays, and none that carries less than this.
const uint MAX_RAYS = 24u;
const float MIN_THROUGHPUT = 1.0 / 256.0;

// What a turn of the loop looks at.
const int POINT = 0;
const int MET = 1;
const int TAKE_BACK = 2;

// A surface as a ray sees it.
struct Sight {
    Surface s;
    vec3 v;                // back along the ray
    vec3 throughput;
    vec3 absorption_per_m; // of the body that the ray came through
    uint depth;
    bool inside;           // the ray is about to leave a body that refracts
};

struct Waiting {
    vec3 origin;
    vec3 direction;
    vec3 throughput;
    uint depth;
    uint roles;
    float t_max;
    vec3 absorption_per_m; // of the body that the ray travels in
};

// The nearest viewer that stands in front of the surface; false where none does.
bool viewer_of(Surface s, out vec3 eye) {
    float nearest = 3.0e38;
    for (uint i = 0u; i < frame.viewer_count; ++i) {
        vec3 way = frame.viewers[i].xyz - s.position;
        float d = length(way);
        if (d < nearest && dot(way, s.normal) > 0.0) {
            nearest = d;
            eye = frame.viewers[i].xyz;
        }
    }
    return nearest < 3.0e38;
}

Waiting waiting[MAX_RAYS];
uint waiting_count;
uint rays_made;

void follow(Waiting w) {
    if (w.depth > frame.max_depth || rays_made >= MAX_RAYS || max(w.throughput.x, max(w.throughput.y, w.throughput.z)) < MIN_THROUGHPUT) {
        return;
    }
    waiting[waiting_count++] = w;
    ++rays_made;
}

// The direction in which a lobe sends the ray that arrived along −v, and the share that masking leaves; black below the surface.
vec3 lobe_direction(Surface s, vec3 v, float roughness, uvec2 pixel, out float share, out float cos_i) {
    share = 1.0;
    cos_i = max(dot(s.normal, v), 0.0);
    vec3 m = s.normal;
    float alpha = roughness * roughness;
    if (roughness >= MIRROR_ROUGHNESS) {
        m = sample_visible_normal(s.normal, v, alpha, secondary_random(pixel, push.sample_index, rays_made));
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
vec3 shade(Sight sight, const uvec2 pixel, int turn) {
    Surface s = sight.s;
    vec3 v = sight.v;
    vec3 throughput = sight.throughput;
    bool inside = sight.inside;
    vec3 radiance = vec3(0.0);
    float n_v = max(dot(s.normal, v), 1e-4);

    // The coat reflects first; the specular lobe below it gets the rest.
    float coat = s.clearcoat > 0.0 && !inside && turn != TAKE_BACK ? s.clearcoat * fresnel_dielectric(n_v, 1.5) : 0.0;

    // Lights: one shadow ray each serves the diffuse part (not at the point: another pass has it) and the highlights.
    vec3 diffuse = turn == POINT ? vec3(0.0) : diffuse_color(s);
    bool has_lobe = turn != TAKE_BACK && (specular_scale(s) > 0.0 && s.roughness >= MIRROR_ROUGHNESS ||
                                          s.clearcoat > 0.0 && s.clearcoat_roughness >= MIRROR_ROUGHNESS);
    if (turn != POINT) {
        radiance += throughput * (under_coat(s) * s.emissive + diffuse * irradiance_over_pi(s.normal));
    }
    uint light_count = has_lobe || max(diffuse.x, max(diffuse.y, diffuse.z)) > 0.0 ? frame.light_count : 0u;
    uint i = 0u;
    while (true) {
        vec3 l;
        vec3 lux = i < light_count ? arriving(light_of(i), s, l) : vec3(0.0);
        if (max(lux.x, max(lux.y, lux.z)) > 0.0) {
            vec3 response = diffuse * (max(dot(s.normal, l), 0.0) / PI);
            if (has_lobe) {
                float v_h = max(dot(v, normalize(v + l)), 0.0);
                response += (1.0 - coat) * highlight(s.normal, v, l, s.roughness, base_fresnel(s, v_h, inside));
                response += s.clearcoat * highlight(s.normal, v, l, s.clearcoat_roughness, vec3(fresnel_dielectric(v_h, 1.5)));
            }
            radiance += throughput * lux * response;
        }
        if (++i >= light_count) {
            break;
        }
    }
    if (turn == TAKE_BACK) {
        return radiance;
    }

    // Reflection by the base layer.
    vec3 outside_origin = offset_origin(s.position, s.normal_geometric);
    vec3 below = throughput * (1.0 - coat);
    vec3 f = base_fresnel(s, n_v, inside);
    if (max(f.x, max(f.y, f.z)) > 0.0) {
        float share, cos_i;
        vec3 d = lobe_direction(s, v, s.roughness, pixel, share, cos_i);
        vec3 f_lobe = s.roughness >= MIRROR_ROUGHNESS ? base_fresnel(s, cos_i, inside) : f;
        follow(Waiting(outside_origin, d, below * f_lobe * share, sight.depth + 1u, EVERYTHING, 3.0e38, sight.absorption_per_m));
    }

    // Reflection by the coat.
    if (coat > 0.0) {
        float share, cos_i;
        vec3 d = lobe_direction(s, v, s.clearcoat_roughness, pixel, share, cos_i);
        follow(Waiting(outside_origin, d, throughput * coat * share, sight.depth + 1u, EVERYTHING, 3.0e38, sight.absorption_per_m));
    }

    // Transmission: bent where the body is closed, straight through a thin sheet.
    if (s.transmission > 0.0) {
        bool solid = s.thickness > 0.0;
        float eta = inside ? 1.0 / s.ior : s.ior;
        float reflected = fresnel_dielectric(n_v, solid ? eta : s.ior);
        vec3 through = below * s.base * (s.transmission * (1.0 - s.metallic) * (1.0 - reflected));
        vec3 d = solid ? refract(-v, s.normal, 1.0 / eta) : -v;
        if (dot(d, d) > 0.0) {
            bool enters = solid && !inside;
            follow(Waiting(offset_origin(s.position, -s.normal_geometric), normalize(d), through, sight.depth + 1u, EVERYTHING, 3.0e38,
                           enters ? s.absorption_per_m : (solid ? vec3(0.0) : sight.absorption_per_m)));
        }
    }
    return radiance;
}

void main() {
    uint at = gl_GlobalInvocationID.y * gl_NumWorkGroups.x * gl_WorkGroupSize.x + gl_GlobalInvocationID.x;
    if (at >= live_count) {
        return;
    }
    uint index = live[at];
    record_for(index, push.sample_index);
    uvec2 pixel = pixel_of(index);
    Ray primary = sample_ray(pixel, push.sample_index);
    Sight point;
    point.s = lit_surface(primary, hits[index], point.inside);
    vec3 eye;
    if (EYE_AT_PROJECTOR == 0u && !viewer_of(point.s, eye)) {
        return;
    }
    point.v = EYE_AT_PROJECTOR != 0u ? -primary.direction : normalize(eye - point.s.position);
    point.throughput = vec3(1.0);
    point.absorption_per_m = vec3(0.0);
    point.depth = 0u;
    bool eye_light = depends_on_eye(point.s);
    vec3 radiance = vec3(0.0);
    waiting_count = 0u;
    rays_made = 0u;

    // A virtual thing on the line of sight stands in front of the point: the first ray looks for one, and finds the point itself
    // where there is none.
    bool at_point = frame.virtual_count == 0u || EYE_AT_PROJECTOR != 0u;
    if (!at_point) {
        follow(Waiting(eye, -point.v, vec3(1.0), 0u, ROLE_VIRTUAL, length(eye - point.s.position) * (1.0 - 1e-5), vec3(0.0)));
    }
    bool hidden = false;

    // Every turn of this loop looks at one surface: the point itself, what the next waiting ray meets, or the point once more to take
    // back what the eye-independent pass has put there, because a virtual thing hides it. It ends at its bottom, as traverse.glsl says.
    while (true) {
        Sight sight = point;
        int turn = POINT;
        bool shades = true;
        if (hidden) {
            turn = TAKE_BACK;
            hidden = false;
            sight.throughput = vec3(-1.0);
        } else if (!at_point) {
            Waiting w = waiting[--waiting_count];
            Hit hit = trace_closest(Ray(w.origin, w.direction, 0.0, w.t_max), w.roles);
            ++secondary_rays_made;
            bool looks_for_virtual = w.roles == ROLE_VIRTUAL;
            if (hit.instance != NO_INSTANCE) {
                turn = MET;
                sight.s = surface_at(hit.instance, hit.triangle, hit.barycentric);
                sight.inside = turn_to(sight.s, w.direction);
                sight.v = -w.direction;
                sight.throughput = w.throughput * exp(-w.absorption_per_m * hit.t);
                sight.absorption_per_m = w.absorption_per_m;
                sight.depth = w.depth;
                shades = (sight.s.flags & ROLE_MASK) == 0u;
                hidden = looks_for_virtual;
            } else {
                // A miss sees the environment; but where a virtual thing was looked for, the line of sight is free.
                shades = looks_for_virtual && eye_light;
                radiance += looks_for_virtual ? vec3(0.0) : w.throughput * environment_radiance(w.direction);
            }
        }
        at_point = false;
        if (shades) {
            radiance += shade(sight, pixel, turn);
        }
        if (waiting_count == 0u && !hidden) {
            break;
        }
    }
    look[index] += vec4(radiance, 1.0) / float(frame.samples);
    publish_counts(0u, 0u);
}
