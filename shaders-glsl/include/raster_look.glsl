// A raster node's look: the same material model without any ray, hence without shadows or reflections.
#ifndef RASTER_LOOK_GLSL
#define RASTER_LOOK_GLSL

#include "light.glsl"
#include "weight.glsl"

// Linear radiance, and the share of the blend, of a surface that is turned to the projector.
vec4 raster_look(Surface s) {
    vec3 sum = under_coat(s) * s.emissive + diffuse_color(s) * irradiance_over_pi(s.normal);
    for (uint i = 0u; i < setup.light_count; ++i) {
        vec3 l;
        float distance_m;
        vec3 lux = light_at(light_of(i), s.position, l, distance_m);
        float n_l = dot(s.normal, l);
        if (n_l > 0.0) {
            sum += lux * diffuse_color(s) * (n_l / PI);
            vec3 v = normalize(frame.viewers[0].xyz - s.position);
            if (setup.viewer_count > 0u && dot(s.normal, v) > 0.0) {
                sum += lux * highlight(s.normal, v, l, s.roughness, base_fresnel(s, max(dot(v, normalize(v + l)), 0.0), false));
            }
        }
    }

    // Its share, with no regard to what stands between: no ray knows this node. Projectors whose maps say their share are not asked.
    float mine = 1.0;
    if (setup.blend != 0u && lenses[setup.projector_index].has_alpha == 0u) {
        float total = 0.0;
        for (uint i = 0u; i < setup.projector_count; ++i) {
            float share = lenses[i].has_alpha != 0u ? 0.0 : share_of(i, s.position, s.normal_geometric, false);
            total += share;
            mine = i == setup.projector_index ? share : mine;
        }
        mine = total > 0.0 ? mine / total : 1.0;
    }
    return vec4(sum, mine);
}

#endif
