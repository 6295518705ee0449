// Rays through the device's own structures (VK_KHR_ray_query), which hold the same triangles by the same numbers as those that
// traverse.glsl walks, and whose instances have their roles for masks. Included in its place where a shader is built for them.
#ifndef RAY_QUERY_GLSL
#define RAY_QUERY_GLSL

#extension GL_EXT_ray_query : require

layout(binding = 64) uniform accelerationStructureEXT scene_structure;

// Roles fill the mask of an instance: eight bits.
const uint ROLE_BITS = 0xffu;

// What the query found, met again in the arithmetic of the other passes, so that a picture owes the device's nothing but which triangle
// was met. It is not asked again whether: the device has another idea of a triangle's edges.
Hit meet_found(Ray ray, uint instance, uint triangle, float t_of_device) {
    vec4 row0, row1, row2;
    instance_rows(instance, 3, row0, row1, row2);
    vec3 direction = transform_vector(row0, row1, row2, ray.direction);
    int at = (int(instance_words(instance).triangle_base) + int(triangle)) * 3;
    vec3 s = transform_point(row0, row1, row2, ray.origin) - LOAD(triangles, at).xyz;
    vec3 e1 = LOAD(triangles, at + 1).xyz;
    vec3 e2 = LOAD(triangles, at + 2).xyz;
    vec3 p = cross(direction, e2);
    vec3 q = cross(s, e1);
    float det = dot(e1, p);
    if (det == 0.0) {
        return Hit(t_of_device, instance, triangle, vec2(0.0));
    }
    float inverse = 1.0 / det;
    vec2 barycentric = max(vec2(dot(s, p), dot(direction, q)) * inverse, vec2(0.0));
    return Hit(dot(e2, q) * inverse, instance, triangle, barycentric / max(barycentric.x + barycentric.y, 1.0));
}

// As traverse.glsl says of its own, but that of two surfaces at the same distance either may be met.
bool traverse(Ray ray, uint roles, int goal, out Hit hit) {
    hit = Hit(ray.t_max, NO_INSTANCE, 0u, vec2(0.0));
    Hit through = hit;

    // A ray that goes nowhere, as a projector's from behind its near plane, must still be one that a device can trace: it meets nothing.
    bool goes = ray.t_max > ray.t_min && !any(isinf(ray.origin)) && !any(isnan(ray.origin)) && !any(isnan(ray.direction));
    uint flags = goal == CLOSEST ? gl_RayFlagsNoneEXT : gl_RayFlagsTerminateOnFirstHitEXT;
    flags |= goal != SHADOW || TRANSMISSIVE == 0u ? gl_RayFlagsOpaqueEXT : gl_RayFlagsNoneEXT;
    rayQueryEXT query;
    rayQueryInitializeEXT(query, scene_structure, flags, goes ? roles & ROLE_BITS : 0u, goes ? ray.origin : vec3(0.0),
                          goes ? ray.t_min : 0.0, goes ? ray.direction : vec3(0.0, 0.0, 1.0), goes ? ray.t_max : 1.0);

    // Only what lets light through stops here, and hides nothing behind it: the query keeps its length. A shadow that goes on from a
    // surface does not meet it again, since both times its distance is ours.
    while (rayQueryProceedEXT(query)) {
        count_step();
        Hit met = meet_found(ray, uint(rayQueryGetIntersectionInstanceCustomIndexEXT(query, false)),
                             uint(rayQueryGetIntersectionPrimitiveIndexEXT(query, false)), rayQueryGetIntersectionTEXT(query, false));
        if (met.t > ray.t_min && met.t < through.t) {
            through = met;
        }
    }
    bool found = rayQueryGetIntersectionTypeEXT(query, true) == gl_RayQueryCommittedIntersectionTriangleEXT;
    if (found) {
        hit = meet_found(ray, uint(rayQueryGetIntersectionInstanceCustomIndexEXT(query, true)),
                         uint(rayQueryGetIntersectionPrimitiveIndexEXT(query, true)), rayQueryGetIntersectionTEXT(query, true));
    } else if (goal == SHADOW) {
        hit = through;
    }
    return found && goal != CLOSEST;
}

#endif
