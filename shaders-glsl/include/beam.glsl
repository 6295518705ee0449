// Four rays that start close together and run much the same way, such as the samples of a pixel, walked as one. A node is entered where
// the beam that they make meets it, which costs what one ray costs; triangles are met by each ray for itself, in the arithmetic of
// traverse.glsl, so that a beam finds to the bit what its rays find one by one.
#ifndef BEAM_GLSL
#define BEAM_GLSL

#include "traverse.glsl"

// By component. All four have the same t_min; one that is left out has a t_max below that, and must be a copy of another.
struct Beam {
    vec4 origin_x;
    vec4 origin_y;
    vec4 origin_z;
    vec4 direction_x;
    vec4 direction_y;
    vec4 direction_z;
};

// Nearest hits; t_max and NO_INSTANCE where nothing is met.
struct BeamHits {
    vec4 t;
    uvec4 instance;
    uvec4 triangle;
};

DEFINE_MEET_TRIANGLE(vec4)

float least(vec4 v) {
    return min(min(v.x, v.y), min(v.z, v.w));
}

float most(vec4 v) {
    return max(max(v.x, v.y), max(v.z, v.w));
}

Beam transform_beam(vec4 row0, vec4 row1, vec4 row2, Beam b) {
    return Beam(row0.x * b.origin_x + row0.y * b.origin_y + row0.z * b.origin_z + row0.w,
                row1.x * b.origin_x + row1.y * b.origin_y + row1.z * b.origin_z + row1.w,
                row2.x * b.origin_x + row2.y * b.origin_y + row2.z * b.origin_z + row2.w,
                row0.x * b.direction_x + row0.y * b.direction_y + row0.z * b.direction_z,
                row1.x * b.direction_x + row1.y * b.direction_y + row1.z * b.direction_z,
                row2.x * b.direction_x + row2.y * b.direction_y + row2.z * b.direction_z);
}

// At a parameter t of its rays a beam lies, on each axis, between low = least origin + t × least direction and high, likewise. It enters
// a box where its high comes above the box's low plane (rays that run up), and leaves it where its low comes above the high plane.
// On an axis along which some rays run up and others down, the beam is taken to be as wide all along as it is at its end, which is
// where it leaves the structure's box; a narrow beam is narrow there.
Slabs slabs_of(Beam b, uvec4 root, float t_max) {
    vec3 origin_low = vec3(least(b.origin_x), least(b.origin_y), least(b.origin_z));
    vec3 origin_high = vec3(most(b.origin_x), most(b.origin_y), most(b.origin_z));
    vec3 direction_low = vec3(least(b.direction_x), least(b.direction_y), least(b.direction_z));
    vec3 direction_high = vec3(most(b.direction_x), most(b.direction_y), most(b.direction_z));
    bvec3 down = lessThan(direction_high, vec3(0.0));
    bvec3 up = greaterThan(direction_low, vec3(0.0));
    Slabs s;
    s.near_from = mix(origin_high, origin_low, down);
    s.near_inverse = safe_inverse(mix(direction_high, direction_low, down));
    s.far_from = mix(origin_low, origin_high, down);
    s.far_inverse = safe_inverse(mix(direction_low, direction_high, down));

    vec3 root_low = uintBitsToFloat(root.xyz);
    vec3 root_high = root_low + 255.0 * grid_step(root);
    vec3 leave = (mix(root_high, root_low, down) - s.far_from) * s.far_inverse;
    bvec3 both = not(bvec3(up.x || down.x, up.y || down.y, up.z || down.z));
    leave = mix(leave, vec3(t_max), both);
    float end = max(min(min(leave.x, leave.y), min(leave.z, t_max)) * BOX_PAD, 0.0);
    vec3 slack = (BOX_PAD - 1.0) * (max(abs(origin_low), abs(origin_high)) + end);
    s.near_from = mix(s.near_from, origin_high + end * direction_high + slack, both);
    s.far_from = mix(s.far_from, origin_low + end * direction_low - slack, both);
    s.near_inverse = mix(s.near_inverse, vec3(1e18), both);
    s.far_inverse = mix(s.far_inverse, vec3(1e18), both);
    return s;
}

void traverse_mesh(Beam b, float t_min, uint instance, InstanceWords words, inout BeamHits hits) {
    float farthest = most(hits.t);
    Slabs slabs = slabs_of(b, LOAD(blas_nodes, int(words.node_base) * 5), farthest);
    uint octant4 = octant_inverse(slabs.near_inverse);
    uvec4 wins;
    for (int i = 0; i < 4; ++i) {
        wins[i] = wins_below(instance, hits.instance[i], hits.triangle[i]);
    }

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
            open_blas_node(int(words.node_base + child), slabs, octant4, t_min, farthest, group, primitives);
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
                vec4 u, v, inside;
                vec4 t = meet_triangle(b.origin_x, b.origin_y, b.origin_z, b.direction_x, b.direction_y, b.direction_z,
                                       LOAD(triangles, at).xyz, LOAD(triangles, at + 1).xyz,
                                       LOAD(triangles, at + 2).xyz, u, v, inside);
                for (int i = 0; i < 4; ++i) {
                    if (inside[i] >= -EDGE_PAD && t[i] > t_min && (t[i] < hits.t[i] || t[i] == hits.t[i] && triangle < wins[i])) {
                        hits.t[i] = t[i];
                        hits.instance[i] = instance;
                        hits.triangle[i] = triangle;
                        wins[i] = triangle;
                    }
                }
            }
            if (primitives.y == 0u) {
                break;
            }
        }
        farthest = most(hits.t);

        if ((group.y & NODE_BITS) == 0u) {
            break;
        }
    }
}

// The nearest hits of four rays, from t_min to each one's t_max.
BeamHits trace_closest(Beam b, float t_min, vec4 t_max, uint roles) {
    BeamHits hits = BeamHits(t_max, uvec4(NO_INSTANCE), uvec4(0u));
    Slabs slabs = slabs_of(b, LOAD(tlas_nodes, 0), most(t_max));
    uint octant4 = octant_inverse(slabs.near_inverse);

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
            open_tlas_node(int(child), slabs, octant4, t_min, most(hits.t), group, entries);
        }

        if (entries.y != 0u) {
            uint bit = uint(findMSB(entries.y));
            entries.y &= ~(1u << bit);
            uint instance = LOAD_WORD(tlas_order, int(entries.x + bit));
            InstanceWords words = instance_words(instance);
            if ((words.flags & roles) != 0u) {
                vec4 row0, row1, row2;
                instance_rows(instance, 3, row0, row1, row2);
                traverse_mesh(transform_beam(row0, row1, row2, b), t_min, instance, words, hits);
            }
        }

        bool more = entries.y != 0u || (group.y & NODE_BITS) != 0u;
        if (!more && top > 0) {
            group = stack[--top];
            more = true;
        }
        if (!more) {
            break;
        }
    }
    return hits;
}

#endif
