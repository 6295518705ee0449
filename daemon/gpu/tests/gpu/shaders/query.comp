#version 460
#extension GL_EXT_ray_query : require

// One ray each, straight down from height 10 at (x, z), for things of its mask: distance, what it met, which triangle, and how many
// hits it was asked to judge.
layout(local_size_x = 64) in;
layout(binding = 0) uniform accelerationStructureEXT structure;
layout(std430, binding = 1) readonly buffer Rays { vec4 rays[]; }; // x, z, mask, 0
layout(std430, binding = 2) writeonly buffer Hits { vec4 hits[]; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= rays.length()) {
        return;
    }
    rayQueryEXT query;
    rayQueryInitializeEXT(query, structure, gl_RayFlagsNoneEXT, uint(rays[i].z), vec3(rays[i].x, 10.0, rays[i].y), 0.0, vec3(0.0, -1.0, 0.0),
                          100.0);
    float judged = 0.0;
    while (rayQueryProceedEXT(query)) {
        judged += 1.0;
    }
    hits[i] = vec4(-1.0, -1.0, -1.0, judged);
    if (rayQueryGetIntersectionTypeEXT(query, true) == gl_RayQueryCommittedIntersectionTriangleEXT) {
        hits[i].xyz = vec3(rayQueryGetIntersectionTEXT(query, true), rayQueryGetIntersectionInstanceCustomIndexEXT(query, true),
                           rayQueryGetIntersectionPrimitiveIndexEXT(query, true));
    }
}
