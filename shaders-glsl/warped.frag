// Raster nodes behind a lens: each pixel's own ray against the triangles that the ideal image shows around it. So their look and depth
// are exact, with nothing resampled; what the rasteriser has decided is which triangles to ask.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/raster_look.glsl"

layout(push_constant) uniform Push {
    vec2 low_px;       // of the part of the ideal image that is drawn
    vec2 texels_a_px;
    vec2 size;         // texels
    vec2 offset_px;    // from the pixel's centre to the sample
} push;

layout(binding = 39) uniform usampler2D seen_instance_image; // 0: none; else one more than the instance
layout(binding = 40) uniform usampler2D seen_triangle_image;

layout(location = 0) out vec4 radiance_and_weight;
layout(location = 1) out float node;

// Where a ray meets the plane of a triangle: distance, barycentrics, and how far inside its edges.
float meet(Ray ray, uint instance, uint triangle, out vec2 barycentric, out float inside) {
    int at = (int(instance_words(instance).triangle_base) + int(triangle)) * 3;
    vec4 row0, row1, row2;
    instance_rows(instance, 3, row0, row1, row2);
    vec3 o = transform_point(row0, row1, row2, ray.origin);
    vec3 d = transform_vector(row0, row1, row2, ray.direction);
    return meet_triangle(o.x, o.y, o.z, d.x, d.y, d.z, LOAD(triangles, at).xyz, LOAD(triangles, at + 1).xyz,
                         LOAD(triangles, at + 2).xyz, barycentric.x, barycentric.y, inside);
}

void main() {
    vec2 at_px = gl_FragCoord.xy + push.offset_px;
    bool lit = own_ideal(at_px);
    Ray ray;
    ray.t_min = 0.0;
    frustum_ray(frame.frustum, at_px, ray.origin, ray.direction, ray.t_max);

    // The four texels around the ray's place, the nearest one first.
    vec2 texel = (at_px - push.low_px) * push.texels_a_px - 0.5;
    ivec2 nearest = ivec2(floor(texel + 0.5));
    ivec2 step = ivec2(texel.x < float(nearest.x) ? -1 : 1, texel.y < float(nearest.y) ? -1 : 1);
    float t = ray.t_max;
    uint instance = NO_INSTANCE;
    uint triangle = 0u;
    vec2 barycentric = vec2(0.0);
    uint covered = 0u;
    for (int i = 0; i < 4; ++i) {
        ivec2 at = clamp(nearest + step * ivec2(i & 1, i >> 1), ivec2(0), ivec2(push.size) - 1);
        uint seen = texelFetch(seen_instance_image, at, 0).x;
        uint of = texelFetch(seen_triangle_image, at, 0).x;
        covered += seen != 0u ? 1u : 0u;
        vec2 where;
        float inside;
        float t_here = meet(ray, seen == 0u ? 0u : seen - 1u, seen == 0u ? 0u : of, where, inside);
        if (seen != 0u && inside >= -EDGE_PAD && t_here >= 0.0 && t_here <= t) {
            t = t_here;
            instance = seen - 1u;
            triangle = of;
            barycentric = where;
        }
    }

    // Triangles so small that none of the four texels' is the ray's: amid them the nearest texel's stands for it.
    if (instance == NO_INSTANCE && covered == 4u) {
        instance = texelFetch(seen_instance_image, clamp(nearest, ivec2(0), ivec2(push.size) - 1), 0).x - 1u;
        triangle = texelFetch(seen_triangle_image, clamp(nearest, ivec2(0), ivec2(push.size) - 1), 0).x;
        float inside;
        t = meet(ray, instance, triangle, barycentric, inside);
        barycentric = max(barycentric, vec2(0.0));
        barycentric /= max(barycentric.x + barycentric.y, 1.0);
    }
    if (!lit || instance == NO_INSTANCE || !(t >= 0.0 && t <= ray.t_max)) {
        discard;
    }

    Surface s = surface_at(instance, triangle, barycentric);
    turn_to(s, ray.direction);
    radiance_and_weight = raster_look(s);
    node = float(instance_words(instance).scene_node);
    gl_FragDepth = window_z(frame.frustum, at_px, ray.direction, t);
}
