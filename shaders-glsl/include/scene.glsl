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
};

// What rays read, whole texels at a time: through texel buffers, or, where STORAGE_LOADS is defined, through storage buffers. Which
// serves is chosen by daemon/render/src/loads.rs.
#ifdef STORAGE_LOADS
#define SCENE_UINTS(number, name) layout(std430, binding = number) readonly buffer name { uvec4 name##_at[]; }
#define SCENE_FLOATS(number, name) layout(std430, binding = number) readonly buffer name { vec4 name##_at[]; }
#define SCENE_WORDS(number, name) layout(std430, binding = number) readonly buffer name { uint name##_at[]; }
#define LOAD(name, at) name##_at[at]
#define LOAD_WORD(name, at) name##_at[at]
#else
#define SCENE_UINTS(number, name) layout(binding = number) uniform usamplerBuffer name
#define SCENE_FLOATS(number, name) layout(binding = number) uniform samplerBuffer name
#define SCENE_WORDS(number, name) layout(binding = number) uniform usamplerBuffer name
#define LOAD(name, at) texelFetch(name, at)
#define LOAD_WORD(name, at) texelFetch(name, at).x
#endif

SCENE_UINTS(0, blas_nodes);
SCENE_FLOATS(1, triangles);
SCENE_UINTS(2, indices);
SCENE_UINTS(3, vertices);

// The top level, rewritten whole when a node moves.
SCENE_UINTS(4, instances);
SCENE_UINTS(5, tlas_nodes);
SCENE_WORDS(6, tlas_order);

SCENE_UINTS(7, materials);
SCENE_UINTS(8, lights);
layout(std430, binding = 9) readonly buffer Textures { GpuTexture textures[]; };
SCENE_WORDS(10, texels);
SCENE_FLOATS(11, environment_texels);

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
    uvec4 a = LOAD(instances, int(instance) * INSTANCE_TEXELS + 6);
    uvec4 b = LOAD(instances, int(instance) * INSTANCE_TEXELS + 7);
    return InstanceWords(a.x, a.y, a.z, a.w, b.x, b.y);
}

GpuMaterial material_at(uint index) {
    int at = int(index) * 7;
    uvec4 base = LOAD(materials, at);
    uvec4 a = LOAD(materials, at + 1);
    uvec4 b = LOAD(materials, at + 2);
    uvec4 c = LOAD(materials, at + 3);
    uvec4 d = LOAD(materials, at + 4);
    uvec4 e = LOAD(materials, at + 5);
    return GpuMaterial(uintBitsToFloat(base), uintBitsToFloat(a.xyz), uintBitsToFloat(a.w), uintBitsToFloat(b.xyz), uintBitsToFloat(b.w),
                       uintBitsToFloat(c.x), uintBitsToFloat(c.y), uintBitsToFloat(c.z), uintBitsToFloat(c.w), uintBitsToFloat(d.x),
                       uintBitsToFloat(d.y), uintBitsToFloat(d.z), d.w, e.x, e.y, e.z);
}

GpuLight light_of(uint index) {
    int at = int(index) * 4;
    uvec4 a = LOAD(lights, at);
    uvec4 b = LOAD(lights, at + 1);
    uvec4 c = LOAD(lights, at + 2);
    uvec4 d = LOAD(lights, at + 3);
    return GpuLight(uintBitsToFloat(a.xyz), a.w, uintBitsToFloat(b.xyz), uintBitsToFloat(b.w), uintBitsToFloat(c.xyz), uintBitsToFloat(c.w),
                    uintBitsToFloat(d.x));
}

// Rows 0 to 2 of world_from_object (first = 0) or object_from_world (first = 3).
void instance_rows(uint instance, int first, out vec4 row0, out vec4 row1, out vec4 row2) {
    int base = int(instance) * INSTANCE_TEXELS + first;
    row0 = uintBitsToFloat(LOAD(instances, base));
    row1 = uintBitsToFloat(LOAD(instances, base + 1));
    row2 = uintBitsToFloat(LOAD(instances, base + 2));
}

// Written out, so that one point and the four of a beam round alike.
vec3 transform_vector(vec4 row0, vec4 row1, vec4 row2, vec3 d) {
    return vec3(row0.x * d.x + row0.y * d.y + row0.z * d.z, row1.x * d.x + row1.y * d.y + row1.z * d.z,
                row2.x * d.x + row2.y * d.y + row2.z * d.z);
}

vec3 transform_point(vec4 row0, vec4 row1, vec4 row2, vec3 p) {
    return transform_vector(row0, row1, row2, p) + vec3(row0.w, row1.w, row2.w);
}

#endif
