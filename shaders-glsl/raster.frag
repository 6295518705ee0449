// A raster node's look: the same material model without any ray, hence without shadows or reflections.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/light.glsl"
#include "include/weight.glsl"

layout(push_constant) uniform Push {
    vec2 offset_px;
    uint instance;
} push;

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 barycentric;
layout(location = 2) flat in uint triangle;

layout(location = 0) out vec4 radiance_and_weight;
layout(location = 1) out float node;

void main() {
    Surface s = surface_at(push.instance, triangle, barycentric.yz);

    // Both sides are drawn: the normal turns to the projector.
    vec2 at_px = gl_FragCoord.xy + push.offset_px;
    vec3 origin, direction;
    float t_max;
    frustum_ray(frame.frustum, at_px, origin, direction, t_max);
    turn_to(s, direction);
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

    // Its share of the blend, with no regard to what stands between: no ray knows this node.
    float mine = 1.0;
    if (setup.blend != 0u) {
        float total = 0.0;
        for (uint i = 0u; i < setup.projector_count; ++i) {
            float share = share_of(i, s.position, s.normal_geometric, false);
            total += share;
            mine = i == setup.projector_index ? share : mine;
        }
        mine = total > 0.0 ? mine / total : 1.0;
    }
    radiance_and_weight = vec4(sum, mine);
    node = float(instance_words(push.instance).scene_node);

    // The same arithmetic as the composite pass, so that equal surfaces get equal depth.
    gl_FragDepth = window_z(frame.frustum, at_px, direction, dot(position - origin, direction));
}
