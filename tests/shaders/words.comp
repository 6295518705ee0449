// Every field of the second material, light and instance, as the shaders read them out of texels.
#version 460
#extension GL_GOOGLE_include_directive : require

#include "../../shaders-glsl/include/scene.glsl"

layout(local_size_x = 1) in;

layout(std430, binding = 30) writeonly buffer Fields { uint fields[]; };

uint count = 0u;

void put(uint word) {
    fields[count++] = word;
}

void put(float value) {
    put(floatBitsToUint(value));
}

void put(vec3 value) {
    put(value.x);
    put(value.y);
    put(value.z);
}

void put(vec4 value) {
    put(value.xyz);
    put(value.w);
}

void main() {
    GpuMaterial m = material_at(1u);
    put(m.base_color);
    put(m.emissive);
    put(m.metallic);
    put(m.absorption_per_m);
    put(m.roughness);
    put(m.transmission);
    put(m.thickness);
    put(m.ior);
    put(m.clearcoat);
    put(m.clearcoat_roughness);
    put(m.normal_scale);
    put(m.specular);
    put(m.base_color_texture);
    put(m.metallic_roughness_texture);
    put(m.emissive_texture);
    put(m.normal_texture);

    GpuLight l = light_of(1u);
    put(l.position);
    put(l.kind);
    put(l.direction);
    put(l.range);
    put(l.intensity);
    put(l.cos_outer);
    put(l.cos_inner);

    for (int first = 0; first < 6; first += 3) {
        vec4 row0, row1, row2;
        instance_rows(1u, first, row0, row1, row2);
        put(row0);
        put(row1);
        put(row2);
    }
    InstanceWords words = instance_words(1u);
    put(words.node_base);
    put(words.triangle_base);
    put(words.vertex_base);
    put(words.scene_node);
    put(words.flags);
    put(words.material_base);
}
