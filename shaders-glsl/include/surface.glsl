// A hit, looked at: where it is, its normals, and what its material is there.
#ifndef SURFACE_GLSL
#define SURFACE_GLSL

#include "scene.glsl"
#include "traverse.glsl"
#include "microfacet.glsl"

struct Surface {
    vec3 position;
    vec3 normal_geometric; // outward by winding; unit
    vec3 normal;           // for shading: interpolated, perturbed by the normal texture; unit; on the same side
    vec3 base;
    vec3 emissive;
    vec3 absorption_per_m;
    float metallic;
    float roughness;
    float transmission;
    float thickness;
    float ior;
    float clearcoat;
    float clearcoat_roughness;
    float specular;
    uint flags;            // the instance's
};

// Octahedral, two snorm16 (Cigolle et al., JCGT 3(2), 2014).
vec3 decode_normal(uint packed) {
    vec2 e = unpackSnorm2x16(packed);
    vec3 n = vec3(e, 1.0 - abs(e.x) - abs(e.y));
    if (n.z < 0.0) {
        n.xy = (1.0 - abs(n.yx)) * vec2(n.x >= 0.0 ? 1.0 : -1.0, n.y >= 0.0 ? 1.0 : -1.0);
    }
    return normalize(n);
}

float srgb_to_linear(float c) {
    return c <= 0.04045 ? c / 12.92 : pow((c + 0.055) / 1.055, 2.4);
}

int wrap(int i, int size, uint mode) {
    if (mode == 2u) {
        return clamp(i, 0, size - 1);
    }
    if (mode == 1u) {
        int period = 2 * size;
        int m = i % period;
        m = m < 0 ? m + period : m;
        return m < size ? m : period - 1 - m;
    }
    int m = i % size;
    return m < 0 ? m + size : m;
}

vec4 texture_texel(GpuTexture t, ivec2 at) {
    int x = wrap(at.x, int(t.width), t.flags & 3u);
    int y = wrap(at.y, int(t.height), (t.flags >> 2u) & 3u);
    vec4 c = unpackUnorm4x8(LOAD_WORD(texels, int(t.first_texel) + y * int(t.width) + x));
    if ((t.flags & 16u) != 0u) {
        c.rgb = vec3(srgb_to_linear(c.r), srgb_to_linear(c.g), srgb_to_linear(c.b));
    }
    return c;
}

// Bilinear in linear light; textures lie one after the other in one buffer, so that no driver needs descriptor indexing.
vec4 texture_at(uint index, vec2 uv) {
    GpuTexture t = textures[index];
    vec2 at = uv * vec2(t.width, t.height);
    if ((t.flags & 32u) != 0u) {
        return texture_texel(t, ivec2(floor(at)));
    }
    at -= 0.5;
    ivec2 base = ivec2(floor(at));
    vec2 f = at - vec2(base);
    return mix(mix(texture_texel(t, base), texture_texel(t, base + ivec2(1, 0)), f.x),
               mix(texture_texel(t, base + ivec2(0, 1)), texture_texel(t, base + ivec2(1, 1)), f.x), f.y);
}

// Everything about the point of a triangle with these barycentrics.
Surface surface_at(uint instance, uint triangle, vec2 barycentric) {
    InstanceWords words = instance_words(instance);
    int at = (int(words.triangle_base) + int(triangle)) * 3;
    vec3 corner = LOAD(triangles, at).xyz;
    vec3 e1 = LOAD(triangles, at + 1).xyz;
    vec3 e2 = LOAD(triangles, at + 2).xyz;
    vec4 row0, row1, row2;
    instance_rows(instance, 0, row0, row1, row2);
    vec4 inverse0, inverse1, inverse2;
    instance_rows(instance, 3, inverse0, inverse1, inverse2);

    // The point from its barycentrics: its error is bounded by the corners' rounding, not by the ray's length. The normal by the
    // inverse transpose; a mirroring transform turns the winding around, and the determinant's sign turns it back.
    Surface s;
    s.position = transform_point(row0, row1, row2, corner + barycentric.x * e1 + barycentric.y * e2);
    vec3 n = cross(e1, e2);
    s.normal_geometric = normalize(inverse0.xyz * n.x + inverse1.xyz * n.y + inverse2.xyz * n.z);
    float mirrored = dot(row0.xyz, cross(row1.xyz, row2.xyz)) < 0.0 ? -1.0 : 1.0;

    // Interpolated attributes.
    uvec4 numbers = LOAD(indices, int(words.triangle_base + triangle));
    vec3 weights = vec3(1.0 - barycentric.x - barycentric.y, barycentric);
    vec3 normal = vec3(0.0);
    vec2 uvs[3];
    for (int i = 0; i < 3; ++i) {
        uvec4 vertex = LOAD(vertices, int(words.vertex_base + numbers[i]));
        normal += weights[i] * decode_normal(vertex.x);
        uvs[i] = uintBitsToFloat(vertex.yz);
    }
    vec2 uv = weights.x * uvs[0] + weights.y * uvs[1] + weights.z * uvs[2];
    s.normal = normalize(inverse0.xyz * normal.x + inverse1.xyz * normal.y + inverse2.xyz * normal.z);

    GpuMaterial m = material_at(words.material_base + numbers.w);

    // The normal texture's tangent frame comes from the triangle's own texture coordinates.
    if (TEXTURED != 0u && m.normal_texture != NO_TEXTURE) {
        vec2 d1 = uvs[1] - uvs[0];
        vec2 d2 = uvs[2] - uvs[0];
        float det = d1.x * d2.y - d1.y * d2.x;
        if (det != 0.0) {
            vec3 tangent = transform_vector(row0, row1, row2, (e1 * d2.y - e2 * d1.y) / det);
            tangent = tangent - s.normal * dot(tangent, s.normal);
            float len = length(tangent);
            if (len > 0.0) {
                tangent /= len;
                vec3 bitangent = cross(s.normal, tangent) * (det < 0.0 ? -1.0 : 1.0) * mirrored;
                vec3 bump = texture_at(m.normal_texture, uv).xyz * 2.0 - 1.0;
                bump.xy *= m.normal_scale;
                s.normal = normalize(tangent * bump.x - bitangent * bump.y + s.normal * max(bump.z, 1e-3));
            }
        }
    }
    // A shading normal never looks through the surface.
    if (dot(s.normal, s.normal_geometric) < 0.0) {
        s.normal = -s.normal;
    }

    s.base = m.base_color.rgb;
    if (TEXTURED != 0u && m.base_color_texture != NO_TEXTURE) {
        s.base *= texture_at(m.base_color_texture, uv).rgb;
    }
    s.metallic = m.metallic;
    s.roughness = m.roughness;
    if (TEXTURED != 0u && m.metallic_roughness_texture != NO_TEXTURE) {
        vec4 t = texture_at(m.metallic_roughness_texture, uv);
        s.metallic *= t.b;
        s.roughness *= t.g;
    }
    s.emissive = m.emissive;
    if (TEXTURED != 0u && m.emissive_texture != NO_TEXTURE) {
        s.emissive *= texture_at(m.emissive_texture, uv).rgb;
    }
    s.absorption_per_m = m.absorption_per_m;
    s.transmission = m.transmission;
    s.thickness = m.thickness;
    s.ior = m.ior;
    s.clearcoat = m.clearcoat;
    s.clearcoat_roughness = m.clearcoat_roughness;
    s.specular = m.specular;
    s.flags = words.flags;
    return s;
}

// Turns both normals against a ray. True where the ray is about to leave a body that refracts.
bool turn_to(inout Surface s, vec3 direction) {
    if (dot(s.normal_geometric, direction) <= 0.0) {
        return false;
    }
    s.normal_geometric = -s.normal_geometric;
    s.normal = -s.normal;
    return s.transmission > 0.0 && s.thickness > 0.0;
}

// How much of the specular lobe there is: all of it but where a dielectric is matte.
float specular_scale(Surface s) {
    float matte = s.transmission > 0.0 ? 1.0 : 1.0 - smoothstep(MATTE_FROM, 1.0, s.roughness);
    return mix(matte, 1.0, s.metallic);
}

// Reflectance of the dielectric part at normal incidence.
float dielectric_f0(Surface s) {
    float r = (s.ior - 1.0) / (s.ior + 1.0);
    return r * r * s.specular;
}

// What a clear coat leaves for the diffuse light and the emission below it, with no dependence on the eye: its loss at normal incidence.
float under_coat(Surface s) {
    return 1.0 - 0.04 * s.clearcoat;
}

// The diffuse albedo: what coat, specular lobe and transmission leave, with no dependence on the eye.
vec3 diffuse_color(Surface s) {
    return under_coat(s) * s.base * (1.0 - s.metallic) * (1.0 - s.transmission) * (1.0 - dielectric_f0(s) * specular_scale(s));
}

// Whether anything of this surface changes when the eye moves.
bool depends_on_eye(Surface s) {
    return s.clearcoat > 0.0 || s.transmission > 0.0 || (specular_scale(s) > 0.0 && (s.metallic > 0.0 || dielectric_f0(s) > 0.0));
}

// How a crossing of a surface that lets light through dims a shadow ray; its normals as the winding has them.
vec3 shadow_crossing(Surface s, vec3 direction) {
    float facing = dot(direction, s.normal_geometric);
    float eta = s.thickness > 0.0 && facing > 0.0 ? 1.0 / s.ior : s.ior;
    return s.base * (s.transmission * (1.0 - s.metallic) * (1.0 - fresnel_dielectric(facing, eta)));
}

// A point from which a secondary ray does not meet its own surface: Wächter and Binder, Ray Tracing Gems, chapter 6.
vec3 offset_origin(vec3 p, vec3 n) {
    const float ORIGIN = 1.0 / 32.0;
    const float FLOAT_SCALE = 1.0 / 65536.0;
    const float INT_SCALE = 256.0;
    ivec3 step = ivec3(INT_SCALE * n);
    vec3 moved = intBitsToFloat(floatBitsToInt(p) + ivec3(p.x < 0.0 ? -step.x : step.x, p.y < 0.0 ? -step.y : step.y,
                                                         p.z < 0.0 ? -step.z : step.z));
    return vec3(abs(p.x) < ORIGIN ? p.x + FLOAT_SCALE * n.x : moved.x, abs(p.y) < ORIGIN ? p.y + FLOAT_SCALE * n.y : moved.y,
                abs(p.z) < ORIGIN ? p.z + FLOAT_SCALE * n.z : moved.z);
}

#endif
