// The scene's packed form. Every struct is the twin of one in daemon/scene/src/pack.rs, of the same name; a test compares
// the offsets. Positions are metres in the world frame, relative to the scene's origin.
#ifndef SCENE_GLSL
#define SCENE_GLSL

const uint NO_TEXTURE = 0xffffffffu;
const uint NO_INSTANCE = 0xffffffffu;

const uint ROLE_PROP = 1u;
const uint ROLE_VIRTUAL = 2u;
const uint ROLE_RASTER = 4u;
const uint ROLE_MASK = 8u;
const uint INSTANCE_OPAQUE = 256u;

// What each kind of ray can meet (CONTRACT: roles).
const uint PHYSICAL = ROLE_PROP | ROLE_MASK;
const uint EVERYTHING = ROLE_PROP | ROLE_VIRTUAL | ROLE_MASK;

const uint LIGHT_DIRECTIONAL = 0u;
const uint LIGHT_POINT = 1u;
const uint LIGHT_SPOT = 2u;

struct GpuMaterial {
    vec4 base_color;
    vec3 emissive;
    float metallic;
    vec3 absorption_per_m;
    float roughness;
    float transmission;
    float thickness;
    float ior;
    float clearcoat;
    float clearcoat_roughness;
    float normal_scale;
    float specular;
    uint base_color_texture;
    uint metallic_roughness_texture;
    uint emissive_texture;
    uint normal_texture;
    uint pad0;
    uvec4 pad1;
};

struct GpuTexture {
    uint first_texel;
    uint width;
    uint height;
    uint flags;
};

struct GpuLight {
    vec3 position;
    uint kind;
    vec3 direction;
    float range;
    vec3 intensity;
    float cos_outer;
    float cos_inner;
    float pad0;
    float pad1;
    float pad2;
};

// Bottom-level structures and triangles, read through texel buffers: twice as fast as storage buffers on lavapipe.
layout(binding = 0) uniform usamplerBuffer blas_nodes;
layout(binding = 1) uniform samplerBuffer triangles;
layout(binding = 2) uniform usamplerBuffer indices;
layout(binding = 3) uniform usamplerBuffer vertices;

// The top level, rewritten whole when a node moves.
layout(binding = 4) uniform usamplerBuffer instances;
layout(binding = 5) uniform usamplerBuffer tlas_nodes;
layout(binding = 6) uniform usamplerBuffer tlas_order;

layout(std430, binding = 7) readonly buffer Materials { GpuMaterial materials[]; };
layout(std430, binding = 8) readonly buffer Lights { GpuLight lights[]; };
layout(std430, binding = 9) readonly buffer Textures { GpuTexture textures[]; };
layout(binding = 10) uniform samplerBuffer texels;
layout(binding = 11) uniform samplerBuffer environment_texels;

// The words of a GpuInstance after its two matrices.
struct InstanceWords {
    uint node_base;
    uint triangle_base;
    uint vertex_base;
    uint scene_node;
    uint flags;
    uint material_base;
};

const int INSTANCE_TEXELS = 8;

InstanceWords instance_words(uint instance) {
    uvec4 a = texelFetch(instances, int(instance) * INSTANCE_TEXELS + 6);
    uvec4 b = texelFetch(instances, int(instance) * INSTANCE_TEXELS + 7);
    return InstanceWords(a.x, a.y, a.z, a.w, b.x, b.y);
}

// Rows 0 to 2 of world_from_object (first = 0) or object_from_world (first = 3).
void instance_rows(uint instance, int first, out vec4 row0, out vec4 row1, out vec4 row2) {
    int base = int(instance) * INSTANCE_TEXELS + first;
    row0 = uintBitsToFloat(texelFetch(instances, base));
    row1 = uintBitsToFloat(texelFetch(instances, base + 1));
    row2 = uintBitsToFloat(texelFetch(instances, base + 2));
}

vec3 transform_point(vec4 row0, vec4 row1, vec4 row2, vec3 p) {
    return vec3(dot(row0.xyz, p) + row0.w, dot(row1.xyz, p) + row1.w, dot(row2.xyz, p) + row2.w);
}

vec3 transform_vector(vec4 row0, vec4 row1, vec4 row2, vec3 d) {
    return vec3(dot(row0.xyz, d), dot(row1.xyz, d), dot(row2.xyz, d));
}

#endif
