// What the eye sees of the lit props: for each of its rays, the light that one projector sends to the point that it meets. The
// projectors' own finished pictures are read, through their own calibrations, so a fault anywhere before shows here.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/primary_hit.glsl"
#include "include/weight.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(std430, binding = 25) readonly buffer Color { uint color[]; }; // that projector's picture
layout(std430, binding = 26) buffer Room { vec4 room[]; };            // linear; starts at 0

vec3 sent(ivec2 at, ivec2 size) {
    at = clamp(at, ivec2(0), size - 1);
    vec3 c = unpackUnorm4x8(color[at.y * size.x + at.x]).rgb;
    return vec3(srgb_to_linear(c.r), srgb_to_linear(c.g), srgb_to_linear(c.b));
}

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (outside_image(pixel)) {
        return;
    }
    uint index = pixel_index(pixel);
    Ray ray = sample_ray(pixel, push.sample_index);
    Hit hit = trace_closest(ray, PHYSICAL);
    vec3 seen = vec3(0.0);
    if (hit.instance != NO_INSTANCE) {
        Surface s = surface_at(hit.instance, hit.triangle, hit.barycentric);
        turn_to(s, ray.direction);
        if (share_of(push.projector, s.position, s.normal_geometric, true) > 0.0) {
            GpuFrustum f = projectors[push.projector];
            vec2 at = real_place(push.projector, s.position) - 0.5;
            ivec2 base = ivec2(floor(at));
            vec2 t = at - vec2(base);
            ivec2 size = ivec2(f.resolution_px);
            seen = mix(mix(sent(base, size), sent(base + ivec2(1, 0), size), t.x),
                       mix(sent(base + ivec2(0, 1), size), sent(base + ivec2(1, 1), size), t.x), t.y);
        }
    }
    room[index] += vec4(seen, 0.0) / float(setup.samples);
}
