// Rays through the two-level structure: obvhs's CWBVH, eight children a node of 80 bytes (Ylitie, Karras and Laine, Efficient
// Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs, HPG 2017), one per mesh and one over the instances.
#ifndef TRAVERSE_GLSL
#define TRAVERSE_GLSL

#include "scene.glsl"
#include "counters.glsl"

struct Ray {
    vec3 origin;
    vec3 direction;
    float t_min;
    float t_max;
};

struct Hit {
    float t;
    uint instance; // NO_INSTANCE: a miss
    uint triangle; // the mesh's own number
    vec2 barycentric;
};

// Node groups have a bit set in the top byte of y; primitive groups only below it.
const uint NODE_BITS = 0xff000000u;
const int STACK_SIZE = 48;

// Far plane of a box, relative: the slab arithmetic on quantised planes loses a ray in a million without it.
const float BOX_PAD = 1.000002;
// How far outside its edges a triangle still catches a ray, so that no ray slips between two of them.
const float EDGE_PAD = 1e-6;

float safe_inverse(float x) {
    return 1.0 / (abs(x) > 1e-18 ? x : (x < 0.0 ? -1e-18 : 1e-18));
}

vec3 safe_inverse(vec3 d) {
    return vec3(safe_inverse(d.x), safe_inverse(d.y), safe_inverse(d.z));
}

// Möller and Trumbore, JGT 2(1), 1997. Returns t, or -1.
float intersect_triangle(vec3 origin, vec3 direction, vec3 v0, vec3 e1, vec3 e2, out vec2 barycentric) {
    vec3 p = cross(direction, e2);
    float det = dot(e1, p);
    barycentric = vec2(0.0);
    if (det == 0.0) {
        return -1.0;
    }
    float inverse = 1.0 / det;
    vec3 s = origin - v0;
    float u = dot(s, p) * inverse;
    vec3 q = cross(s, e1);
    float v = dot(direction, q) * inverse;
    if (u < -EDGE_PAD || v < -EDGE_PAD || u + v > 1.0 + EDGE_PAD) {
        return -1.0;
    }
    barycentric = vec2(u, v);
    return dot(e2, q) * inverse;
}

// The octant in which the ray travels, inverted and repeated in each byte: the order in which children are visited.
uint octant_inverse(vec3 direction) {
    uint octant = (direction.x < 0.0 ? 0u : 4u) | (direction.y < 0.0 ? 0u : 2u) | (direction.z < 0.0 ? 0u : 1u);
    return octant * 0x01010101u;
}

// Four children at once: bits of those that the ray meets, inner nodes in the top byte in visiting order, triangles below.
uint intersect_children(uint meta4, uint octant4, uvec3 low4, uvec3 high4, vec3 scale, vec3 offset, float t_min, float t_max) {
    uint is_inner4 = (meta4 & (meta4 << 1u)) & 0x10101010u;
    uint inner_mask4 = (is_inner4 >> 4u) * 0xffu;
    uint bit_index4 = (meta4 ^ (octant4 & inner_mask4)) & 0x1f1f1f1fu;
    uint child_bits4 = (meta4 >> 5u) & 0x07070707u;
    uint mask = 0u;
    for (int i = 0; i < 4; ++i) {
        int shift = i * 8;
        vec3 low = vec3((low4 >> shift) & 0xffu) * scale + offset;
        vec3 high = vec3((high4 >> shift) & 0xffu) * scale + offset;
        float enter = max(max(low.x, low.y), max(low.z, t_min));
        float leave = min(min(high.x, high.y), min(high.z, t_max)) * BOX_PAD;
        if (enter <= leave) {
            mask |= ((child_bits4 >> shift) & 0xffu) << ((bit_index4 >> shift) & 0xffu);
        }
    }
    return mask;
}

// One node against the ray. Writes where its children and primitives begin.
uint intersect_node(uvec4 n0, uvec4 n1, uvec4 n2, uvec4 n3, uvec4 n4, vec3 origin, vec3 inverse, uint octant4, float t_min,
                    float t_max) {
    // Planes are bytes in the node's own grid: fold grid and ray into one multiply and add.
    vec3 extent = vec3(uintBitsToFloat((n0.w & 0xffu) << 23u), uintBitsToFloat(((n0.w >> 8u) & 0xffu) << 23u),
                       uintBitsToFloat(((n0.w >> 16u) & 0xffu) << 23u));
    vec3 scale = extent * inverse;
    vec3 offset = (uintBitsToFloat(n0.xyz) - origin) * inverse;

    // A ray that runs down an axis enters by the high plane.
    bvec3 down = lessThan(inverse, vec3(0.0));
    uvec4 x = down.x ? n2.zwxy : n2;
    uvec4 y = down.y ? n3.zwxy : n3;
    uvec4 z = down.z ? n4.zwxy : n4;
    return intersect_children(n1.z, octant4, uvec3(x.x, y.x, z.x), uvec3(x.z, y.z, z.z), scale, offset, t_min, t_max) |
           intersect_children(n1.w, octant4, uvec3(x.y, y.y, z.y), uvec3(x.w, y.w, z.w), scale, offset, t_min, t_max);
}

// What ends a walk.
const int CLOSEST = 0;  // the nearest hit
const int ANY = 1;      // the first hit of anything: visibility between physical things
const int SHADOW = 2;   // the first opaque hit; what lets light through dims `transmittance`

#ifdef MATERIALS_KNOWN
// How a crossing of a surface that lets light through dims a shadow ray; defined in surface.glsl.
vec3 shadow_crossing(uint instance, uint triangle, vec2 barycentric, vec3 direction_object);
#else
vec3 shadow_crossing(uint instance, uint triangle, vec2 barycentric, vec3 direction_object) {
    return vec3(0.0);
}
#endif

// Walks both levels. `hit.t` starts at the ray's t_max. True when `ANY` or `SHADOW` ended at a hit.
bool traverse(Ray ray, uint roles, const int goal, inout Hit hit, inout vec3 transmittance) {
    uvec2 stack[STACK_SIZE];
    int top = 0;
    int floor_of_mesh = 0;
    bool in_mesh = false;

    vec3 origin = ray.origin;
    vec3 direction = ray.direction;
    vec3 inverse = safe_inverse(direction);
    uint octant4 = octant_inverse(direction);

    uint instance = NO_INSTANCE;
    uint instance_flags = 0u;
    int node_base = 0;
    int triangle_base = 0;

    hit = Hit(ray.t_max, NO_INSTANCE, 0u, vec2(0.0));
    uvec2 group = uvec2(0u, frame.tlas_node_count > 0u ? 0x80000000u : 0u);
    uvec2 primitives = uvec2(0u);

    while (true) {
        count_step();
        if (primitives.y != 0u) {
            uint bit = uint(findMSB(primitives.y));
            primitives.y &= ~(1u << bit);
            uint primitive = primitives.x + bit;
            if (in_mesh) {
                // A triangle of the mesh; the ray's parameter is the same in object space, since its direction is not normalised there.
                int at = (triangle_base + int(primitive)) * 3;
                vec2 barycentric;
                float t = intersect_triangle(origin, direction, texelFetch(triangles, at).xyz, texelFetch(triangles, at + 1).xyz,
                                             texelFetch(triangles, at + 2).xyz, barycentric);
                if (t > ray.t_min && t < hit.t) {
                    if (goal == SHADOW && (instance_flags & (INSTANCE_OPAQUE | ROLE_MASK)) == 0u) {
                        transmittance *= shadow_crossing(instance, primitive, barycentric, direction);
                        if (max(transmittance.x, max(transmittance.y, transmittance.z)) < 1.0 / 1024.0) {
                            return true;
                        }
                    } else {
                        hit = Hit(t, instance, primitive, barycentric);
                        if (goal != CLOSEST) {
                            return true;
                        }
                    }
                }
            } else {
                // An instance: put the rest of the top level aside and enter its mesh with the ray in its space.
                uint entered = texelFetch(tlas_order, int(primitive)).x;
                InstanceWords words = instance_words(entered);
                if ((words.flags & roles) != 0u) {
                    if (primitives.y != 0u) {
                        stack[top++] = primitives;
                        primitives.y = 0u;
                    }
                    if ((group.y & NODE_BITS) != 0u) {
                        stack[top++] = group;
                    }
                    instance = entered;
                    instance_flags = words.flags;
                    node_base = int(words.node_base);
                    triangle_base = int(words.triangle_base);
                    vec4 row0, row1, row2;
                    instance_rows(entered, 3, row0, row1, row2);
                    origin = transform_point(row0, row1, row2, ray.origin);
                    direction = transform_vector(row0, row1, row2, ray.direction);
                    inverse = safe_inverse(direction);
                    octant4 = octant_inverse(direction);
                    in_mesh = true;
                    floor_of_mesh = top;
                    group = uvec2(0u, 0x80000000u);
                }
            }
        } else if ((group.y & NODE_BITS) != 0u) {
            // The nearest child of the group that is left; the others wait on the stack.
            uint bit = uint(findMSB(group.y));
            uint inner_children = group.y & 0xffu;
            group.y &= ~(1u << bit);
            if ((group.y & NODE_BITS) != 0u) {
                stack[top++] = group;
            }
            uint slot = (bit - 24u) ^ (octant4 & 0xffu);
            uint child = group.x + uint(bitCount(inner_children & ~(0xffffffffu << slot)));
            uvec4 n0, n1, n2, n3, n4;
            if (in_mesh) {
                int at = (node_base + int(child)) * 5;
                n0 = texelFetch(blas_nodes, at);
                n1 = texelFetch(blas_nodes, at + 1);
                n2 = texelFetch(blas_nodes, at + 2);
                n3 = texelFetch(blas_nodes, at + 3);
                n4 = texelFetch(blas_nodes, at + 4);
            } else {
                int at = int(child) * 5;
                n0 = texelFetch(tlas_nodes, at);
                n1 = texelFetch(tlas_nodes, at + 1);
                n2 = texelFetch(tlas_nodes, at + 2);
                n3 = texelFetch(tlas_nodes, at + 3);
                n4 = texelFetch(tlas_nodes, at + 4);
            }
            uint mask = intersect_node(n0, n1, n2, n3, n4, origin, inverse, octant4, ray.t_min, hit.t);
            group = uvec2(n1.x, (mask & NODE_BITS) | (n0.w >> 24u));
            primitives = uvec2(n1.y, mask & ~NODE_BITS);
        } else {
            // Nothing left here: leave the mesh if this was its last group, and go on with what waits.
            if (in_mesh && top == floor_of_mesh) {
                in_mesh = false;
                origin = ray.origin;
                direction = ray.direction;
                inverse = safe_inverse(direction);
                octant4 = octant_inverse(direction);
            }
            if (top == 0) {
                break;
            }
            uvec2 waiting = stack[--top];
            if ((waiting.y & NODE_BITS) != 0u) {
                group = waiting;
            } else {
                primitives = waiting;
                group = uvec2(0u);
            }
        }
    }
    return false;
}

Hit trace_closest(Ray ray, uint roles) {
    Hit hit;
    vec3 unused = vec3(1.0);
    traverse(ray, roles, CLOSEST, hit, unused);
    return hit;
}

bool is_blocked(Ray ray, uint roles) {
    Hit hit;
    vec3 unused = vec3(1.0);
    return traverse(ray, roles, ANY, hit, unused);
}

// The share of light that arrives, by channel: 0 behind anything opaque.
vec3 trace_shadow(Ray ray) {
    ++shadow_rays_made;
    Hit hit;
    vec3 transmittance = vec3(1.0);
    return traverse(ray, EVERYTHING, SHADOW, hit, transmittance) ? vec3(0.0) : transmittance;
}

#endif
