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

#include "record.glsl"

// Whether any surface of the scene lets light through, and whether any material has a texture: known when pipelines are made, so
// that a scene without them pays nothing. Branches cost as much untaken as taken on a driver that runs both sides under a mask.
layout(constant_id = 2) const uint TEXTURED = 1u;
layout(constant_id = 3) const uint TRANSMISSIVE = 1u;

// Node groups have a bit set in the top byte of y; primitive groups only below it.
const uint NODE_BITS = 0xff000000u;
// The CPU builds no structure deeper than this (daemon/scene/src/bvh.rs).
const int STACK_SIZE = 24;

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

// Möller and Trumbore, JGT 2(1), 1997, of one ray (F = float) or of four (F = vec4), by component so that both round alike: t and the
// barycentrics, and how far inside its edges the ray meets the triangle's plane, in units of the triangle. A degenerate triangle gives
// infinities and NaN, which pass no comparison with `inside` and `t`.
#define DEFINE_MEET_TRIANGLE(F)                                                                                     \
    F meet_triangle(F ox, F oy, F oz, F dx, F dy, F dz, vec3 v0, vec3 e1, vec3 e2, out F u, out F v, out F inside) { \
        F px = dy * e2.z - dz * e2.y;                                                                               \
        F py = dz * e2.x - dx * e2.z;                                                                               \
        F pz = dx * e2.y - dy * e2.x;                                                                               \
        F inverse = 1.0 / (px * e1.x + py * e1.y + pz * e1.z);                                                      \
        F sx = ox - v0.x;                                                                                           \
        F sy = oy - v0.y;                                                                                           \
        F sz = oz - v0.z;                                                                                           \
        F qx = sy * e1.z - sz * e1.y;                                                                               \
        F qy = sz * e1.x - sx * e1.z;                                                                               \
        F qz = sx * e1.y - sy * e1.x;                                                                               \
        u = (sx * px + sy * py + sz * pz) * inverse;                                                                \
        v = (dx * qx + dy * qy + dz * qz) * inverse;                                                                \
        inside = min(min(u, v), 1.0 - (u + v));                                                                     \
        return (qx * e2.x + qy * e2.y + qz * e2.z) * inverse;                                                       \
    }
DEFINE_MEET_TRIANGLE(float)

// Of two surfaces at the same distance the one of the lower instance, then of the lower triangle, is met, in whatever order a walk comes
// to them: the number below which a triangle of `instance` wins against an equally near hit.
uint wins_below(uint instance, uint met_instance, uint met_triangle) {
    return met_instance == instance ? met_triangle : (met_instance != NO_INSTANCE && instance < met_instance ? 0xffffffffu : 0u);
}

// What of a ray, or of a beam of them, boxes are met with, by axis: where and how fast it passes the plane by which it enters, and the
// one by which it leaves. For a single ray both are the same.
struct Slabs {
    vec3 near_from;
    vec3 near_inverse;
    vec3 far_from;
    vec3 far_inverse;
};

Slabs slabs_of(Ray ray) {
    vec3 inverse = safe_inverse(ray.direction);
    return Slabs(ray.origin, inverse, ray.origin, inverse);
}

// The octant in which the ray travels, inverted and repeated in each byte: the order in which children are visited.
uint octant_inverse(vec3 direction) {
    uint octant = (direction.x < 0.0 ? 0u : 4u) | (direction.y < 0.0 ? 0u : 2u) | (direction.z < 0.0 ? 0u : 1u);
    return octant * 0x01010101u;
}

// Four children at once: bits of those that the ray meets, inner nodes in the top byte in visiting order, triangles below.
uint intersect_children(uint meta4, uint octant4, uvec3 near4, uvec3 far4, vec3 near_scale, vec3 near_offset, vec3 far_scale,
                        vec3 far_offset, float t_min, float t_max) {
    uint is_inner4 = (meta4 & (meta4 << 1u)) & 0x10101010u;
    uint inner_mask4 = (is_inner4 >> 4u) * 0xffu;
    uint bit_index4 = (meta4 ^ (octant4 & inner_mask4)) & 0x1f1f1f1fu;
    uint child_bits4 = (meta4 >> 5u) & 0x07070707u;
    uint mask = 0u;

    // Least and most are those of the numbers' bits. These are in the numbers' order but where both are negative, and then the ray, whose
    // t_min is not, has left the box before it begins either way; −0 alone lets it into a box too many. So a driver on the
    // CPU needs one instruction where GLSL's rule on NaN costs it three.
    int from = floatBitsToInt(t_min);
    int to = floatBitsToInt(t_max);
    for (int i = 0; i < 4; ++i) {
        int shift = i * 8;
        vec3 near = vec3((near4 >> shift) & 0xffu) * near_scale + near_offset;
        vec3 far = vec3((far4 >> shift) & 0xffu) * far_scale + far_offset;
        ivec3 n = floatBitsToInt(near);
        ivec3 f = floatBitsToInt(far);
        float enter = intBitsToFloat(max(max(n.x, n.y), max(n.z, from)));
        float leave = intBitsToFloat(min(min(f.x, f.y), min(f.z, to))) * BOX_PAD;
        if (enter <= leave) {
            mask |= ((child_bits4 >> shift) & 0xffu) << ((bit_index4 >> shift) & 0xffu);
        }
    }
    return mask;
}

// The edges of a node's grid: a step along each axis, m.
vec3 grid_step(uvec4 n0) {
    return vec3(uintBitsToFloat((n0.w & 0xffu) << 23u), uintBitsToFloat(((n0.w >> 8u) & 0xffu) << 23u),
                uintBitsToFloat(((n0.w >> 16u) & 0xffu) << 23u));
}

// One node against the ray.
uint intersect_node(uvec4 n0, uvec4 n1, uvec4 n2, uvec4 n3, uvec4 n4, Slabs slabs, uint octant4, float t_min, float t_max) {
    // Planes are bytes in the node's own grid: fold grid and ray into one multiply and add.
    vec3 extent = grid_step(n0);
    vec3 near_scale = extent * slabs.near_inverse;
    vec3 near_offset = (uintBitsToFloat(n0.xyz) - slabs.near_from) * slabs.near_inverse;
    vec3 far_scale = extent * slabs.far_inverse;
    vec3 far_offset = (uintBitsToFloat(n0.xyz) - slabs.far_from) * slabs.far_inverse;

    // A ray that runs down an axis enters by the high plane.
    bvec3 down = lessThan(slabs.near_inverse, vec3(0.0));
    uvec4 x = down.x ? n2.zwxy : n2;
    uvec4 y = down.y ? n3.zwxy : n3;
    uvec4 z = down.z ? n4.zwxy : n4;
    return intersect_children(n1.z, octant4, uvec3(x.x, y.x, z.x), uvec3(x.z, y.z, z.z), near_scale, near_offset, far_scale, far_offset,
                              t_min, t_max) |
           intersect_children(n1.w, octant4, uvec3(x.y, y.y, z.y), uvec3(x.w, y.w, z.w), near_scale, near_offset, far_scale, far_offset,
                              t_min, t_max);
}

// What ends a walk.
const int CLOSEST = 0; // the nearest hit
const int ANY = 1;     // the first hit of anything: visibility between physical things
const int SHADOW = 2;  // the first opaque hit; else the nearest of what lets light through

const uint ROOT = 0x80000000u;

// The group's nearest child that is left: takes it out of the group and returns its number.
uint next_child(inout uvec2 group, uint octant4) {
    uint bit = uint(findMSB(group.y));
    uint slot = (bit - 24u) ^ (octant4 & 0xffu);
    uint child = group.x + uint(bitCount(group.y & 0xffu & ~(0xffffffffu << slot)));
    group.y &= ~(1u << bit);
    return child;
}

// Fetches node `at` of a level's structure and meets it: the inner nodes among its children that are met become the group, the
// triangles or instances the leaves.
#define DEFINE_OPEN_NODE(function, nodes)                                                                                     \
    void function(int at, Slabs slabs, uint octant4, float t_min, float t_max, out uvec2 group, out uvec2 leaves) {           \
        int texel = at * 5;                                                                                                   \
        uvec4 n0 = LOAD(nodes, texel);                                                                                        \
        uvec4 n1 = LOAD(nodes, texel + 1);                                                                                    \
        uint mask = intersect_node(n0, n1, LOAD(nodes, texel + 2), LOAD(nodes, texel + 3), LOAD(nodes, texel + 4), slabs,     \
                                   octant4, t_min, t_max);                                                                    \
        group = uvec2(n1.x, (mask & NODE_BITS) | (n0.w >> 24u));                                                              \
        leaves = uvec2(n1.y, mask & ~NODE_BITS);                                                                              \
    }
DEFINE_OPEN_NODE(open_blas_node, blas_nodes)
DEFINE_OPEN_NODE(open_tlas_node, tlas_nodes)

// Loops here end at the bottom of their bodies. A driver that keeps lanes apart by masks runs what follows a `break` once more for
// nothing, and a loop whose condition stands on top one whole turn more; on lavapipe that was a third of the time.

// Walks one mesh; `ray` is in its object space, where its direction has any length and its parameter is the world's.
// True when `goal` needs no more.
bool traverse_mesh(Ray ray, uint instance, InstanceWords words, const int goal, bool lets_through, inout Hit hit) {
    Slabs slabs = slabs_of(ray);
    uint octant4 = octant_inverse(slabs.near_inverse);
    bool done = false;
    float nearest = hit.t;
    uint wins = wins_below(instance, hit.instance, hit.triangle);

    uvec2 stack[STACK_SIZE];
    int top = 0;
    uvec2 group = uvec2(0u, ROOT);
    while (true) {
        // Down to a node with triangles, or until nothing is left: the nearest child of the group; its own children become the group, and
        // this one waits. Where the group is done, the one on top of the stack is next.
        uvec2 primitives;
        while (true) {
            count_step();
            uint child = next_child(group, octant4);
            if ((group.y & NODE_BITS) != 0u) {
                stack[top++] = group;
            }
            open_blas_node(int(words.node_base + child), slabs, octant4, ray.t_min, nearest, group, primitives);
            if ((group.y & NODE_BITS) == 0u && top > 0) {
                group = stack[--top];
            }
            if (primitives.y != 0u || (group.y & NODE_BITS) == 0u) {
                break;
            }
        }

        while (true) {
            count_step();
            if (primitives.y != 0u) {
                uint bit = uint(findMSB(primitives.y));
                primitives.y &= ~(1u << bit);
                uint triangle = primitives.x + bit;
                int at = (int(words.triangle_base) + int(triangle)) * 3;
                float u, v, inside;
                float t = meet_triangle(ray.origin.x, ray.origin.y, ray.origin.z, ray.direction.x, ray.direction.y, ray.direction.z,
                                        LOAD(triangles, at).xyz, LOAD(triangles, at + 1).xyz,
                                        LOAD(triangles, at + 2).xyz, u, v, inside);
                if (inside >= -EDGE_PAD && t > ray.t_min && (t < nearest || t == nearest && triangle < wins)) {
                    hit = Hit(t, instance, triangle, vec2(u, v));
                    nearest = t;
                    wins = triangle;
                    done = goal == ANY || goal == SHADOW && !lets_through;
                }
            }
            if (primitives.y == 0u || done) {
                break;
            }
        }

        if ((group.y & NODE_BITS) == 0u || done) {
            break;
        }
    }
    return done;
}

#ifdef RAY_QUERY
#include "ray_query.glsl"
#else
// Walks both levels. True when `ANY` or `SHADOW` ended early. A walk for a shadow leaves in `hit` what it met: something opaque where
// it returned true, else the nearest surface that lets light through.
bool traverse(Ray ray, uint roles, const int goal, out Hit hit) {
    Slabs slabs = slabs_of(ray);
    uint octant4 = octant_inverse(slabs.near_inverse);
    bool done = false;
    hit = Hit(ray.t_max, NO_INSTANCE, 0u, vec2(0.0));
    Hit through = hit;

    uvec2 stack[STACK_SIZE];
    int top = 0;
    uvec2 group = uvec2(0u, setup.tlas_node_count > 0u ? ROOT : 0u);
    uvec2 entries = uvec2(0u);
    while (true) {
        count_step();
        if (entries.y == 0u && (group.y & NODE_BITS) != 0u) {
            uint child = next_child(group, octant4);
            if ((group.y & NODE_BITS) != 0u) {
                stack[top++] = group;
            }
            open_tlas_node(int(child), slabs, octant4, ray.t_min, hit.t, group, entries);
        }

        // The instances of a leaf, one after the other, each with the ray in its own space.
        if (entries.y != 0u) {
            uint bit = uint(findMSB(entries.y));
            entries.y &= ~(1u << bit);
            uint instance = LOAD_WORD(tlas_order, int(entries.x + bit));
            InstanceWords words = instance_words(instance);
            if ((words.flags & roles) != 0u) {
                vec4 row0, row1, row2;
                instance_rows(instance, 3, row0, row1, row2);
                Ray inside = Ray(transform_point(row0, row1, row2, ray.origin), transform_vector(row0, row1, row2, ray.direction),
                                 ray.t_min, ray.t_max);

                // What lets light through hides nothing behind it: the walk for opaque things keeps its length.
                bool lets_through = goal == SHADOW && TRANSMISSIVE != 0u && (words.flags & (INSTANCE_OPAQUE | ROLE_MASK)) == 0u;
                Hit met = hit;
                if (lets_through) {
                    met = through;
                }
                done = traverse_mesh(inside, instance, words, goal, lets_through, met);
                if (lets_through) {
                    through = met;
                } else {
                    hit = met;
                }
            }
        }

        bool more = entries.y != 0u || (group.y & NODE_BITS) != 0u;
        if (!more && top > 0) {
            group = stack[--top];
            more = true;
        }
        if (!more || done) {
            break;
        }
    }
    if (goal == SHADOW && !done) {
        hit = through;
    }
    return done;
}
#endif

Hit trace_closest(Ray ray, uint roles) {
    Hit hit;
    traverse(ray, roles, CLOSEST, hit);
    record_closest(roles, ray, hit);
    return hit;
}

bool is_blocked(Ray ray, uint roles) {
    Hit hit;
    ++blend_rays_made;
    bool blocked = traverse(ray, roles, ANY, hit);
    record_ray(RAY_BLEND, ray, hit);
    return blocked;
}

#endif
