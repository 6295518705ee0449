// The part of a point's look that does not depend on the eye: emission, and diffuse light from lights and environment.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "include/frame.glsl"
#include "include/primary_hit.glsl"
#include "include/light.glsl"
#include "include/hits.glsl"
#include "include/live.glsl"
#include "include/tiles.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

// Mean over the samples so far, linear.
layout(std430, binding = 17) buffer Light { vec4 light[]; };

// What the samples so far make of the pixel.
layout(std430, binding = 30) buffer Class { uint classes[]; };

void main() {
    uvec2 pixel = listed_pixel(TILES_LIT);
    if (outside_image(pixel)) {
        return;
    }
    uint index = pixel_index(pixel);
    record_for(index, push.sample_index);
    uvec2 found = hits[hit_index(index, push.sample_index)];
    uint pixel_class = found.x & CLASS_INSTANCE;
    vec3 radiance = vec3(0.0);
    if (found.x != NO_INSTANCE) {
        Ray ray = sample_ray(pixel, push.sample_index);
        bool from_inside;
        Surface s = lit_surface(ray, found, from_inside);
        if ((s.flags & ROLE_MASK) == 0u) {
            pixel_class |= depends_on_eye(s) || setup.virtual_count > 0u ? CLASS_EYE : 0u;
            radiance = under_coat(s) * s.emissive;
            vec3 diffuse = diffuse_color(s);
            if (max(diffuse.x, max(diffuse.y, diffuse.z)) > 0.0) {
                vec3 sum = irradiance_over_pi(s.normal);
                vec3 origin = offset_origin(s.position, s.normal_geometric);
                uint i = 0u;
                while (true) {
                    if (i < setup.light_count) {
                        Ray to_light;
                        vec3 lux = unshadowed(light_of(i), s, origin, to_light);
                        if (max(lux.x, max(lux.y, lux.z)) > 0.0) {
                            sum += lux * trace_shadow(to_light) * (max(dot(s.normal, to_light.direction), 0.0) / PI);
                        }
                    }
                    if (++i >= setup.light_count) {
                        break;
                    }
                }
                radiance += diffuse * sum;
            }
        }
    }
    vec4 before = push.sample_index == 0u ? vec4(0.0) : light[index];
    light[index] = before + vec4(radiance, 1.0) / float(setup.samples);
    uint before_class = push.sample_index == 0u ? pixel_class : classes[index];
    bool mixed = ((pixel_class ^ before_class) & CLASS_INSTANCE) != 0u;
    classes[index] = before_class | (pixel_class & CLASS_EYE) | (mixed ? CLASS_MIXED : 0u);
    publish_counts(0u, 0u);
}
