// A corner of a raster node's triangle, pulled from the buffers that rays read.
#ifndef RASTER_CORNER_GLSL
#define RASTER_CORNER_GLSL

#include "scene.glsl"

// Where it stands, relative to the origin.
vec3 raster_corner(uint instance, uint triangle, uint corner) {
    int at = (int(instance_words(instance).triangle_base) + int(triangle)) * 3;
    vec3 p = LOAD(triangles, at).xyz;
    if (corner != 0u) {
        p += LOAD(triangles, at + int(corner)).xyz;
    }
    vec4 row0, row1, row2;
    instance_rows(instance, 0, row0, row1, row2);
    return transform_point(row0, row1, row2, p);
}

#endif
