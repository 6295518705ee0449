// The part of a point's look that does not depend on the eye: emission, and diffuse light from lights and environment.
#version 460
#extension GL_GOOGLE_include_directive : require

#define MATERIALS_KNOWN
#include "include/frame.glsl"
#include "include/primary_hit.glsl"
#include "include/light.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(std430, binding = 15) readonly buffer Hits { uvec2 hits[]; };

// Mean over the samples so far, linear.
layout(std430, binding = 17) buffer Light { vec4 light[]; };

// The pixels whose look depends on the eye, in this plane, for the pass that follows the eye: a list, so that it visits no other.
layout(std430, binding = 28) buffer Live {
    uvec3 live_groups; // of the indirect dispatch
    uint live_count;
    uint live[];
};

const uint LIVE_GROUP = 64u;
// Workgroups in x, after which they go on in y: every device takes 65,535 in each.
const uint LIVE_GROUPS_X = 32768u;

void append(uint index) {
    uint at = atomicAdd(live_count, 1u);
    live[at] = index;
    if (at % LIVE_GROUP == 0u) {
        uint group = at / LIVE_GROUP;
        atomicMax(live_groups.x, min(group + 1u, LIVE_GROUPS_X));
        atomicMax(live_groups.y, group / LIVE_GROUPS_X + 1u);
    }
}

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (outside_image(pixel)) {
        return;
    }
    uint index = pixel_index(pixel);
    record_for(index, push.sample_index);
    uvec2 found = hits[index];
    vec3 radiance = vec3(0.0);
    if (found.x != NO_INSTANCE) {
        Ray ray = sample_ray(pixel, push.sample_index);
        bool from_inside;
        Surface s = lit_surface(ray, found, from_inside);
        if ((s.flags & ROLE_MASK) == 0u) {
            if (depends_on_eye(s) || frame.virtual_count > 0u) {
                append(index);
            }
            radiance = under_coat(s) * s.emissive;
            vec3 diffuse = diffuse_color(s);
            if (max(diffuse.x, max(diffuse.y, diffuse.z)) > 0.0) {
                vec3 sum = irradiance_over_pi(s.normal);
                uint i = 0u;
                while (true) {
                    if (i < frame.light_count) {
                        vec3 to_light;
                        vec3 lux = arriving(light_of(i), s, to_light);
                        sum += lux * (max(dot(s.normal, to_light), 0.0) / PI);
                    }
                    if (++i >= frame.light_count) {
                        break;
                    }
                }
                radiance += diffuse * sum;
            }
        }
    }
    vec4 before = push.sample_index == 0u ? vec4(0.0) : light[index];
    light[index] = before + vec4(radiance, 1.0) / float(frame.samples);
    publish_counts(0u, 0u);
}
