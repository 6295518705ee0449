// How several projectors share a point (DESIGN section 2, Light from many projectors).
#ifndef WEIGHT_GLSL
#define WEIGHT_GLSL

#include "traverse.glsl"
#include "surface.glsl"
#include "primary_ray.glsl"
#include "edge.glsl"

layout(std430, binding = 13) readonly buffer Projectors { GpuFrustum projectors[]; };

// Part of the image's shorter side over which a projector fades out toward its border.
const float BORDER = 0.1;
// What is left of a projector at its very border: a point that only it lights must still be lit whole.
const float LEAST_FADE = 1e-4;

// Where a point that a projector lights falls in its image, px.
vec2 real_place(uint projector, vec3 p) {
    float clip_w;
    vec2 at = project_px(projectors[projector], p, clip_w);
    if (ANY_LENS != 0u) {
        to_real(lenses[projector], at);
    }
    return at;
}

// How well a projector lights a point with this geometric normal: cos(incidence) / distance² × fade; 0 where it does not.
float share_of(uint projector, vec3 p, vec3 n, const bool check_visibility) {
    GpuFrustum f = projectors[projector];
    float clip_w;
    vec2 ideal = project_px(f, p, clip_w);
    vec2 at = ideal;
    bool shown = ANY_LENS == 0u || to_real(lenses[projector], at);
    if (!shown || clip_w <= 0.0 || any(lessThan(at, vec2(0.0))) || any(greaterThan(at, f.resolution_px))) {
        return 0.0;
    }
    vec3 origin, direction;
    float t_max;
    frustum_ray(f, ideal, origin, direction, t_max);
    float t = dot(p - origin, direction);
    float cosine = -dot(n, direction);
    if (t <= 0.0 || t > t_max || cosine <= 0.0) {
        return 0.0;
    }

    // The centre of projection is where clip w vanishes on this ray; a parallel projector has none, and no falloff.
    float w_along = dot(f.clip_w.xyz, direction);
    float w_origin = dot(f.clip_w, vec4(origin, 1.0));
    float distance_m = abs(w_along) > 1e-12 * abs(w_origin) ? t + w_origin / w_along : 1.0;

    vec2 edge = min(at, f.resolution_px - at);
    float fade = smoothstep(0.0, 1.0, min(edge.x, edge.y) / (BORDER * min(f.resolution_px.x, f.resolution_px.y)));
    if (check_visibility && is_blocked(Ray(offset_origin(p, n), -direction, 0.0, t * (1.0 - 1e-5)), PHYSICAL)) {
        return 0.0;
    }
    return cosine / (distance_m * distance_m) * max(fade, LEAST_FADE);
}

// How a projector fades toward its occlusion edges.
float edge_fade(float edge_px) {
    return max(smoothstep(0.0, 1.0, edge_px / EDGE_REACH_PX), LEAST_FADE);
}

#ifdef OCCLUSION_EDGES
// The occlusion edges of the projector whose part is added.
layout(std430, binding = 31) readonly buffer OtherEdge { float other_edge_px[]; };

float edge_texel(ivec2 at, ivec2 size) {
    at = clamp(at, ivec2(0), size - 1);
    return other_edge_px[at.y * size.x + at.x];
}

// Its distance to an occlusion edge at a point, px, bilinear.
float edge_at(uint projector, vec3 p) {
    GpuFrustum f = projectors[projector];
    vec2 at = real_place(projector, p) - 0.5;
    ivec2 base = ivec2(floor(clamp(at, vec2(-1.0), f.resolution_px)));
    ivec2 size = ivec2(f.resolution_px);
    vec2 t = clamp(at - vec2(base), vec2(0.0), vec2(1.0));
    return mix(mix(edge_texel(base, size), edge_texel(base + ivec2(1, 0), size), t.x),
               mix(edge_texel(base + ivec2(0, 1), size), edge_texel(base + ivec2(1, 1), size), t.x), t.y);
}
#endif

#endif
