// The traced image with its depth, so that rasterised things resolve against it as if all had been rasterised (PAPER.md, Hybrid
// Rendering, equations 4 to 7).
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/scene.glsl"
#include "include/primary_ray.glsl"
#include "include/random.glsl"
#include "include/look.glsl"
#include "include/closest.glsl"

layout(std430, binding = 16) readonly buffer Closest { uvec4 closest[]; };
layout(std430, binding = 17) readonly buffer Light { vec4 light[]; };
layout(std430, binding = 19) readonly buffer Weight { float inverse_weight[]; };

layout(location = 0) out vec4 radiance_and_weight;
layout(location = 1) out float node;

void main() {
    uvec2 pixel = uvec2(gl_FragCoord.xy);
    uint index = pixel.y * uint(frame.frustum.resolution_px.x) + pixel.x;
    uvec4 nearest = closest[index];
    float distance_m = uintBitsToFloat(nearest.x);
    if (isinf(distance_m)) {
        radiance_and_weight = vec4(0.0);
        node = -1.0;
        gl_FragDepth = 1.0;
        return;
    }
    radiance_and_weight = vec4(max(light[index].rgb + look[index].radiance, vec3(0.0)), 1.0 / inverse_weight[index]);
    node = float(instance_words(nearest.z).scene_node);

    // The ray of the sample that is closest, walked to its hit, and its depth there.
    vec2 at_px = vec2(pixel) + sample_offset(pixel, closest_sample(nearest));
    own_ideal(at_px);
    vec3 origin, direction;
    float t_max;
    frustum_ray(frame.frustum, at_px, origin, direction, t_max);
    gl_FragDepth = window_z(frame.frustum, at_px, direction, distance_m);
}
