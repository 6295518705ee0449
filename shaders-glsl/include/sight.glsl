// What a surface sends along a ray that looks at it, and the rays that it needs for that: glTF's materials in Whitted's tree.
#ifndef SIGHT_GLSL
#define SIGHT_GLSL

#include "primary_hit.glsl"
#include "light.glsl"
#include "waiting.glsl"

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

// The nearest viewer that stands in front of the surface; false, and `eye` as it was, where none does.
bool viewer_of(Surface s, inout vec3 eye) {
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
        if (LIGHTS != 0u && i < light_count) {
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
        if (LIGHTS != 2u || ++i >= light_count) {
            break;
        }
    }
    return radiance;
}

#endif
