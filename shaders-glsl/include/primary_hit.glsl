// What a projector's primary rays found, by sample plane. A hit is stored as (instance, triangle) alone: ray and triangle give
// distance and barycentrics again in full precision for less than the memory traffic of storing them.
#ifndef PRIMARY_HIT_GLSL
#define PRIMARY_HIT_GLSL

#include "surface.glsl"
#include "primary_ray.glsl"
#include "random.glsl"

layout(push_constant) uniform Push {
    uint sample_index; // which plane
    uint projector;    // of blending and of the room view: whose light
} push;

uint pixel_index(uvec2 pixel) {
    return pixel.y * uint(frame.frustum.resolution_px.x) + pixel.x;
}

uvec2 pixel_of(uint index) {
    uint width = uint(frame.frustum.resolution_px.x);
    return uvec2(index % width, index / width);
}

bool outside_image(uvec2 pixel) {
    return pixel.x >= uint(frame.frustum.resolution_px.x) || pixel.y >= uint(frame.frustum.resolution_px.y);
}

// The primary ray of a sample.
Ray sample_ray(uvec2 pixel, uint s) {
    Ray ray;
    ray.t_min = 0.0;
    frustum_ray(frame.frustum, vec2(pixel) + sample_offset(pixel, s), ray.origin, ray.direction, ray.t_max);
    return ray;
}

// Distance and barycentrics of a ray that is known to meet this triangle.
float meet_again(Ray ray, uint instance, uint triangle, out vec2 barycentric) {
    int at = (int(instance_words(instance).triangle_base) + int(triangle)) * 3;
    vec4 row0, row1, row2;
    instance_rows(instance, 3, row0, row1, row2);
    return intersect_triangle(transform_point(row0, row1, row2, ray.origin), transform_vector(row0, row1, row2, ray.direction),
                              texelFetch(triangles, at).xyz, texelFetch(triangles, at + 1).xyz, texelFetch(triangles, at + 2).xyz,
                              barycentric);
}

// The surface that a primary ray met, both normals turned to the side that the projector lights.
Surface lit_surface(Ray ray, uvec2 found, out bool from_inside) {
    vec2 barycentric;
    meet_again(ray, found.x, found.y, barycentric);
    Surface s = surface_at(found.x, found.y, barycentric);
    from_inside = turn_to(s, ray.direction);
    return s;
}

#endif
