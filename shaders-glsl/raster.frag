// A raster node's look and depth, for a projector without a lens.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/raster_look.glsl"

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
    radiance_and_weight = raster_look(s);
    node = float(instance_words(push.instance).scene_node);

    // The same arithmetic as the composite pass, so that equal surfaces get equal depth.
    gl_FragDepth = window_z(frame.frustum, at_px, direction, dot(position - origin, direction));
}
